"""Base class of both nodes: parameters, watched inputs, the robot and a worker for the processor.

The intake reads messages and passes their records to the robot, which poses them. A worker thread
feeds the resulting events to the processor and publishes the results, so a long step never blocks
the intake. An overloaded node drops whole scans and counts them.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.errors import one_line
from tccm_ros.nodes.clock import ClockWatch, is_clock_missing, steady_timer
from tccm_ros.nodes.intake.diagnostics import Diagnostics, message_counts
from tccm_ros.nodes.intake.drops import DropWatch
from tccm_ros.nodes.intake.inputs import Blocking, Inputs, Watch
from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.nodes.intake.record_subscriptions import RecordSubscriptions
from tccm_ros.nodes.intake.refusals import Refusals
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.nodes.params import GROUPS, declare_config, follow_changes
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.process.kernel_loader import KernelLoader
from tccm_ros.nodes.process.worker import BACKLOG, Worker
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.saving.saves import Saves
from tccm_ros.records import (
    Event,
    MapReset,
    ObjectBoxes,
    Odometry,
    RollPitch,
    StreamComplete,
    SurfaceCloud,
    TiltAngle,
    ViewIntervals,
)
from tccm_ros.robot import MountKind, Robot, Stream
from tccm_ros.robot.base_motion import MotionSource
from tccm_ros.sensors.registry import default_streams

NOT_DROPPED = (
    MapReset, ObjectBoxes, Odometry, RollPitch, StreamComplete, SurfaceCloud, TiltAngle,
    ViewIntervals,
)  # fmt: skip
"""Events that an overloaded node keeps as long as it can; only posed sensor data are droppable."""


class SensorNode(Node):
    """A node that turns sensor messages into posed events and feeds them to a processor.

    Construction has two steps, `configure` and `activate`. A plain node runs both at once, a
    managed node on request of its lifecycle manager (`nodes.managed`).

    Parameters
    ----------
    name
        Name of the node.
    processor_name
        The processor whose streams the node subscribes to (`Stream.processor`).
    shared
        The robot of another node in this process, whose intake feeds it; by default the node has
        its own.

    Attributes
    ----------
    robot
        Converts records to posed events.
    roles, measured_roles
        Roles of the processor's streams; the second without occasional streams.
    is_active
        Whether the node processes messages.
    types, bulk_types
        Message classes: rosidl's, and those that hold point tables as arrays (`Outputs`).
    """

    def __init__(self, name: str, processor_name: str, shared: SharedRobot | None, **kwargs: Any):
        self._ends = ExitStack()
        super().__init__(name, **kwargs)
        self._processor_name, self._shared = processor_name, shared
        self.is_active = False
        try:
            self.start_all()
        except Exception:
            self.destroy_node()  # otherwise other nodes see a node that does nothing
            raise

    def start_all(self) -> None:
        """Configure and activate the node, and start loading the kernels."""
        self.configure()
        self.activate()
        self.kernels.start()

    def declare(self) -> None:
        """Declare the parameters."""
        self.config = declare_config(self, groups=GROUPS[self._processor_name])
        follow_changes(self, self.config)

    def configure(self) -> None:
        """Create everything except the subscriptions; subclasses add their own parts.

        Raises
        ------
        ConfigError
            If a parameter is invalid.
        """
        self.declare()
        name, processor_name, shared = self.get_name(), self._processor_name, self._shared
        self.types = RosidlMessages()
        self.bulk_types = TypestoreMessages()
        self.intake = shared.intake if shared else Intake(self, partial(self.refuse, "intake"))
        self.at_end(self.intake.close)
        has_stamps = self.config.qos.stamp == "header"
        max_lag_s = self.config.sync_timeout if has_stamps else math.inf
        self.inputs = Inputs(self, self.config.qos.silence, self.intake, max_lag_s)
        self.refusals = Refusals(self.get_logger().error)
        self.overload: Counter[str] = Counter()
        self.longest_step_s = 0.0
        self.saves = Saves(name, self.get_logger().warning)
        self.worker = Worker(name, partial(self.refuse, "processing"))
        self.robot = shared or SharedRobot(self.config, self.intake, self._is_odometry_published)
        self.robot.check_shared(self.config)
        self.owns_robot = shared is None
        self._streams = {s.role: s for s in self.wanted_streams(processor_name)}
        self.roles = frozenset(self._streams)
        self.measured_roles = frozenset(r for r, s in self._streams.items() if not s.is_occasional)
        self.record_subscriptions = RecordSubscriptions(
            self, self.config, self.inputs, self.refusals, self._streams
        )
        self._drops = DropWatch()
        self._clock_watch = ClockWatch(self, self.config.clock_jump, self.restart)
        self.at_end(self._clock_watch.close)
        self.kernels = KernelLoader(
            processor_name, self.config, self._log_progress, self._become_ready
        )
        self.robot.hold()
        self.worker.post(self.kernels.wait_until_loaded)
        self.robot.listen(self.queue_events, lambda: self.worker.backlog > BACKLOG // 2)
        self.create_service(Trigger, "~/save_map", self._on_save_map)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.diagnostics = Diagnostics(
            self,
            self.inputs,
            self.refusals,
            self.all_problems,
            self._all_values,
            lambda: {self.resolve_topic_name(role): n for role, n in self.used().items()},
        )
        if self.config.save.autosave_minutes > 0.0:
            steady_timer(self, 60.0 * self.config.save.autosave_minutes, self.autosave)

    # --- for subclasses ---

    def wanted_streams(self, processor_name: str) -> list[Stream]:
        """Return the streams that the node subscribes to: those for its processor."""
        return [s for s in default_streams(self.config) if s.processor == processor_name]

    @abstractmethod
    def takes(self, event: Event) -> bool:
        """Return whether an event is for the processor."""

    @abstractmethod
    def process_event(self, event: Any) -> None:
        """Feed one event to the processor and publish the results (in the worker)."""

    @abstractmethod
    def begin(self) -> None:
        """Reset the processor to an empty map (in the worker)."""

    def end_input(self) -> None:
        """Process events that wait for later ones, as at the end of a bag (in the worker)."""

    @abstractmethod
    def begin_save(self) -> Future:
        """Start saving the map with all input received; return a future of a sentence."""

    @abstractmethod
    def autosave(self) -> None:
        """Save the current map without closing open tilt cycles or flushing waiting scans."""

    def save_quickly(self, ending: Ending) -> None:
        """Save the newest available result; called first when the node is asked to stop."""

    @abstractmethod
    def save_at_end(self, ending: Ending) -> None:
        """Save the map with the input received last, as far as `ending` leaves time."""

    @property
    def dropped(self) -> Counter[str]:
        """Counts of records that were not used, by reason."""
        return self.robot.dropped(self.roles)

    def problems(self) -> Iterable[str]:
        """Return problems beyond those of the inputs, one line each."""
        return ()

    @abstractmethod
    def problem_without_odometry(self) -> str:
        """Return the consequence of having neither odometry nor tf for the base."""

    @abstractmethod
    def used(self) -> Mapping[str, int]:
        """Return how many sensor records the processor has used, by role."""

    def values(self) -> Mapping[str, object]:
        """Return the values for /diagnostics beside the message counts."""
        return {}

    # --- inputs ---

    def listen(self, *, watch: Watch) -> None:
        """Subscribe to the sensors and, if this node owns the robot, to tf, joints and odometry.

        `watch` is the rule for silent sensors.
        """
        self.record_subscriptions.to_sensors(self.add_record, watch=watch)
        if self.owns_robot:
            self.record_subscriptions.to_robot(self.add_record)

    def add_record(self, role: str, record: Any) -> None:
        """Pass a record to the robot."""
        self.robot.add(role, record)

    def queue_events(self, events: Sequence[Any]) -> None:
        """Queue events for the worker; drop scans when it cannot keep up."""
        for event in filter(self.takes, events):
            if type(event) is MapReset:
                self._clock_watch.note_stamps()
                self.get_logger().warning(f"{event.reason}: the map begins anew")
            is_droppable = not isinstance(event, NOT_DROPPED)
            if not self.worker.offer(partial(self._work, event), is_droppable=is_droppable):
                self.overload["overload" if is_droppable else "overload: samples"] += 1

    def queue_computed(self, role: str, record: Any) -> None:
        """Queue another node's result, unless it dates from before the clock went back."""
        now_ns = self.robot.robot.message_time_ns
        latest_ns = (now_ns or 0) + self.config.clock_jump * 1e9
        if self._clock_watch.just_went_back and record.stamp_ns > latest_ns:
            self.overload[f"clock jump: {role}"] += 1
        else:
            self.queue_events([record])

    def refuse(self, what: str, error: Exception) -> None:
        """Count and report a message that cannot be used, or a failed step."""
        self.refusals.note(what, error)

    # --- in the worker ---

    def _work(self, event: Any) -> None:
        start = time.monotonic()
        self.process_event(event)
        self.longest_step_s = max(self.longest_step_s, time.monotonic() - start)

    def _is_odometry_published(self) -> bool:
        return self.inputs.is_published(self.resolve_topic_name("odom"))

    # --- services ---

    async def answer(self, job: Future, response: Any) -> Any:
        """Fill a Trigger response with the result of a job, or with the reason for its failure.

        Parameters
        ----------
        job
            The worker's job; its result is a sentence or None.
        response
            The response to fill.
        """
        try:
            response.message = await job or ""
        except Exception as error:
            response.success, response.message = False, one_line(error)
            self.get_logger().error(response.message)
        else:
            response.success = True
        return response

    async def _on_save_map(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        with self.robot.lock:  # the save covers the records before the flush, not those after it
            self.robot.flush()
            job = self.begin_save()
        return await self.answer(job, response)

    async def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        return await self.answer(self.worker.call(self.begin, self), response)

    def save_folder(self) -> Path:
        """Return the folder for saved maps."""
        return Path(self.config.save.directory).expanduser()

    # --- lifecycle ---

    def restart(self, reason: str) -> None:
        """Begin a new map after the clock went back."""
        with self.robot.lock:
            self.queue_events([MapReset(reason)])
            self.robot.robot.begin_anew()

    def activate(self) -> None:
        """Start processing messages; subclasses subscribe first."""
        self.intake.start()
        self.is_active = True

    def deactivate(self) -> None:
        """Stop processing messages, finish the queued ones and keep the map."""
        self.is_active = False
        self.intake.stop()
        self.unsubscribe()
        self.robot.flush()
        self.worker.wait(self.end_input)

    def unsubscribe(self) -> None:
        """Destroy the subscriptions; the intake must be stopped."""
        self.inputs.unsubscribe()

    def at_end(self, close: Callable[[], object]) -> None:
        """Register a function that ends a part; `release` calls the last one first."""
        self._ends.callback(close)

    def release(self) -> None:
        """End the parts created by `configure`, except the worker, which `close` ends.

        After a `configure` that failed half-way, these are the parts created until then.
        """
        self._ends.close()

    def _log_progress(self, text: str) -> None:
        dropped = self.robot.too_early.total()
        lost = f", {dropped} are dropped" if dropped else ""
        self.get_logger().info(f"{text}; {self.robot.early} records wait{lost}")

    def _become_ready(self) -> None:
        """Process the records kept while kernels were loading, then report readiness."""
        self.robot.release(self.refuse)
        if self.context.ok() and self.is_active:
            self.log_ready()

    def log_ready(self) -> None:
        """Log one line with the known sensors and the inputs that are still silent."""
        known = describe_sensors(self.robot.robot, self.roles)
        optional = (r for r, stream in self._streams.items() if stream.mount is MountKind.ANY)
        silent = self.inputs.awaited(set(map(self.resolve_topic_name, optional)))
        waits = f"; waits for {', '.join(silent)}" if silent else ""
        self.get_logger().info(f"ready: {known}{waits}")

    @property
    def is_loading(self) -> bool:
        """Whether its kernels are being loaded, in a thread that cannot be ended."""
        kernels = vars(self).get("kernels")
        return kernels is not None and not kernels.is_loaded

    def close(self, ending: Ending | None = None) -> None:
        """Finish the queued jobs and save if configured.

        Before the kernels are loaded there is nothing to save: only the compilation is stopped.

        Parameters
        ----------
        ending
            The end of the process; None if only the node ends, which has no time limit.
        """
        ending = ending or Ending()
        if self.is_loading:
            self.kernels.stop()
            return
        if self.config.save.on_shutdown:
            self.save_at_end(ending)
        self.worker.wait(lambda: None, lambda: ending.is_over)
        if self.worker.skipped:
            ending.left_out[self.get_name()] = f"{self.worker.skipped} records, {ending.why}"
        self.worker.close()

    def destroy_node(self) -> None:
        """End the threads before the resources they use are destroyed."""
        self.release()
        super().destroy_node()

    # --- diagnostics ---

    def all_problems(self) -> list[str]:
        """Return the current problems, one line each; none while the node is inactive."""
        if not self.is_active:
            return []
        drops = self._drops.problems(self.dropped + self.overload)
        return [*self.inputs.problems(), *self._problems(), *drops]

    def _problems(self) -> Iterable[str]:
        if is_clock_missing(self):
            yield "use_sim_time is set but nobody publishes /clock; start the player or simulator"
        if self.get_node_names_and_namespaces().count((self.get_name(), self.get_namespace())) > 1:
            yield (
                f"another node is called {self.get_fully_qualified_name()}, and what both publish "
                "is mixed up; end one (one that was killed is gone in half a minute), or give it "
                "another namespace (-r __ns:=/robot2)"
            )
        streams = self._streams
        needed = frozenset(r for r in self.measured_roles if streams[r].processor != "signs")
        yield from map(Blocking, self.robot.problems(needed))
        yield from map(str, self.robot.problems(self.roles - needed))
        if self.robot.robot.motion.source is MotionSource.STILL:
            yield self.problem_without_odometry()
        yield from self.problems()

    def _all_values(self) -> dict[str, object]:
        return {
            **message_counts(self.inputs, self.refusals, self.dropped + self.overload),
            **self.values(),
            "active": self.is_active,
            "ready": self.kernels.is_done,
            "waiting": self.worker.backlog,
            "longest step [s]": f"{self.longest_step_s:.3f}",
        }


def describe_sensors(robot: Robot, roles: Collection[str]) -> str:
    """Return a description of the known sensors and odometry.

    Parameters
    ----------
    robot
        The robot as known from its records.
    roles
        Roles of the sensors to describe.
    """
    parts = []
    for role in sorted(roles):
        mount = robot.sensors[role].mount
        if mount.base is not None:
            joint = f", joint '{mount.tilt_joint}'" if mount.tilt_joint else ""
            parts.append(f"{role} on base '{mount.base}'{joint}")
    source = robot.motion.source
    if source is not None:
        parts.append(f"odometry: {source.value} in '{robot.motion.odom_frame}'")
    return ", ".join(parts) or "nothing is known of the robot yet"
