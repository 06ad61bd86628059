"""What both nodes share: parameters, watched inputs, a worker that owns the processor, diagnostics.

The intake reads messages and queues their records; a worker thread gives them to the processor and
publishes the results. So a long step never blocks the intake, and what an overloaded node drops is
whole scans, counted.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.errors import TccmError, one_line
from tccm_ros.nodes.clock import (
    is_clock_missing,
    on_backward_jump,
    stamp_on_receipt,
    steady_timer,
)
from tccm_ros.nodes.diagnostics import Diagnostics
from tccm_ros.nodes.drops import DropWatch
from tccm_ros.nodes.inputs import Inputs, Watch
from tccm_ros.nodes.intake import Intake
from tccm_ros.nodes.params import declare_config, follow_changes
from tccm_ros.nodes.qos import latched, sensor, static_transforms
from tccm_ros.nodes.readers import record_reader
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.tf import has_tf2_msgs
from tccm_ros.nodes.worker import Worker
from tccm_ros.records import RobotDescription, Scan, TransformSample
from tccm_ros.robot.synchroniser import Synchroniser

__all__ = ["LASER_SCAN", "SensorNode", "is_latched"]

LASER_SCAN = "sensor_msgs/msg/LaserScan"

MAX_KNOWN = 1000
"""Latched records (fixed transforms, the robot description) that are kept for a new start."""


class SensorNode(Node):
    """A node that turns sensor messages into records and feeds them to a processor.

    A subclass makes its processor, then calls `listen` and, when it is complete, `start`.

    Attributes
    ----------
    types, bulk_types
        Message classes: rosidl's, and those that hold tables of points as arrays (`Outputs`).
    """

    def __init__(self, name: str, **kwargs: Any):
        super().__init__(name, **kwargs)
        self.config = declare_config(self)
        follow_changes(self, self.config)
        self.types = RosidlMessages()
        self.bulk_types = TypestoreMessages()
        self.intake = Intake(self, partial(self.refuse, "intake"))
        self.inputs = Inputs(self, self.config.qos.silence, self.intake)
        self.refused: Counter[str] = Counter()
        self.overload: Counter[str] = Counter()
        self.longest_step_s = 0.0
        self.worker = Worker(name, partial(self.refuse, "processing"))
        self._known: dict[str, Any] = {}
        self._odometry_topic = self.resolve_topic_name("odom")
        self._drops = DropWatch()
        self._jump = on_backward_jump(self, self.config.clock_jump, self.restart)

    # --- for subclasses ---

    @property
    @abstractmethod
    def synchroniser(self) -> Synchroniser:
        """What gives the scans their poses."""

    @property
    @abstractmethod
    def dropped(self) -> Counter[str]:
        """Scans that were not used, by reason."""

    @abstractmethod
    def feed(self, record: Any) -> None:
        """Give one record to the processor and publish what comes of it (in the worker)."""

    @abstractmethod
    def begin(self) -> None:
        """Forget everything (in the worker)."""

    @abstractmethod
    def end_input(self) -> None:
        """Work on what waits for more input, as at the end of a bag (in the worker)."""

    @abstractmethod
    def write(self, folder: Path) -> None:
        """Write the map as it is (in the worker)."""

    def problems(self) -> Iterable[str]:
        """Return what is wrong beside the inputs, one line each."""
        return ()

    def values(self) -> Mapping[str, object]:
        """Return the figures for /diagnostics beside the counts of messages."""
        return {}

    # --- inputs ---

    def listen(self, scan_topic: str, *, is_needed: bool = True) -> None:
        """Subscribe to a laser and to what places it."""
        measured = sensor(self.config.qos.reliability)
        self.subscribe(
            "scan", measured, topic=scan_topic, watch="needed" if is_needed else "stream"
        )
        self.subscribe("odom", measured)
        self.subscribe("joint_states", measured)
        self.subscribe("robot_description", latched(), watch="event")
        if has_tf2_msgs():
            self.subscribe("tf", measured, topic="/tf", watch="event")
            self.subscribe("tf_static", static_transforms(), topic="/tf_static", watch="event")

    def subscribe(
        self,
        role: str,
        qos: QoSProfile,
        *,
        topic: str = "",
        watch: Watch = "stream",
        is_measured: bool = True,
    ) -> None:
        """Subscribe to the messages of a role (`messages.READERS`), which become records.

        The topic has the role's name if it is not given. What is not measured but computed
        (`is_measured`) keeps its stamp in any case.
        """
        type_name, read = record_reader(role)
        on_receipt = is_measured and self.config.qos.stamp == "receive"

        def callback(data: bytes) -> None:
            try:
                records = read(data)
            except TccmError as error:
                self.refuse(topic or role, error)
                return
            for record in records:
                self.take(stamp_on_receipt(self, record) if on_receipt else record)

        self.inputs.subscribe(type_name, topic or role, callback, qos, watch=watch, raw=True)

    def take(self, record: Any) -> None:
        """Queue a record for the worker; scans are dropped when it cannot keep up."""
        self._remember(record)
        is_scan = isinstance(record, Scan)
        if not self.worker.offer(partial(self._work, record), is_droppable=is_scan):
            self.overload["overload" if is_scan else "overload: samples"] += 1

    def _remember(self, record: Any) -> None:
        """Keep what is sent only once: a processor that begins anew needs it again."""
        if is_latched(record):
            key = f"tf {record.child}" if isinstance(record, TransformSample) else "description"
            if key in self._known or len(self._known) < MAX_KNOWN:
                self._known[key] = record

    def refuse(self, what: str, error: Exception) -> None:
        """Count a message that cannot be used, and say why the first time."""
        self.refused[what] += 1
        if self.refused[what] == 1:
            self.get_logger().error(f"{what}: {one_line(error)}")

    # --- in the worker ---

    def _work(self, record: Any) -> None:
        start = time.monotonic()
        if isinstance(record, Scan):
            self._expect_odometry()
        self.feed(record)
        self.longest_step_s = max(self.longest_step_s, time.monotonic() - start)

    def _expect_odometry(self) -> None:
        """Note, before the first scan is placed, whether somebody publishes odometry."""
        sync = self.synchroniser
        if sync.motion.mode is None:
            sync.expects_odometry = self.inputs.is_published(self._odometry_topic)

    def begin_anew(self) -> None:
        """Forget everything but what is sent only once (in the worker)."""
        self.begin()
        self.feed_known()

    def feed_known(self) -> None:
        """Give what is sent only once to a new processor (in the worker)."""
        for record in list(self._known.values()):
            self.feed(record)

    def save(self, folder: Path) -> None:
        """Write the map of all that has come, as at the end of a bag (in the worker)."""
        self.end_input()
        self.write(folder)

    # --- services ---

    async def answer(self, job: Callable[[], object], response: Any, done: str = "") -> Any:
        """Have the worker do a job and answer a Trigger request with how that went."""
        try:
            await self.worker.call(job, self)
        except Exception as error:
            response.success, response.message = False, one_line(error)
            self.get_logger().error(response.message)
        else:
            response.success, response.message = True, done
        return response

    def save_folder(self) -> Path:
        """Return where maps are saved."""
        return Path(self.config.save.directory).expanduser()

    # --- lifecycle ---

    def restart(self, reason: str) -> None:
        """Begin anew, because the clock went back."""
        self.get_logger().warning(f"{reason}: the map begins anew")
        self.worker.post(self.begin_anew)

    def start(self) -> None:
        """Take messages and publish /diagnostics from now on."""
        self.diagnostics = Diagnostics(self, self.all_problems, self._all_values)
        if self.config.save.autosave_minutes > 0.0:
            steady_timer(self, 60.0 * self.config.save.autosave_minutes, self._autosave)
        self.intake.start()

    def _autosave(self) -> None:
        """Have the map written; the open sweep and the scans that wait are not disturbed."""
        self.worker.post(lambda: self.write(self.save_folder()))

    def close(self) -> None:
        """Finish what waits; save, if asked to."""
        if self.config.save.on_shutdown:
            self.worker.wait(lambda: self.save(self.save_folder()))
        self.worker.close()

    def destroy_node(self) -> None:
        """End the intake before its subscriptions are gone."""
        self.intake.close()
        super().destroy_node()

    # --- diagnostics ---

    def all_problems(self) -> list[str]:
        """Return what is wrong now, one line each."""
        found = [*self.inputs.problems(), *self._problems()]
        return [*found, *self._drops.problems(self.dropped + self.overload)]

    def _problems(self) -> Iterable[str]:
        if is_clock_missing(self):
            yield "use_sim_time is set but nobody publishes /clock; start the player or simulator"
        if self.get_node_names_and_namespaces().count((self.get_name(), self.get_namespace())) > 1:
            yield (
                f"another node is called {self.get_fully_qualified_name()}, and what both publish "
                "is mixed up; end one (one that was killed is gone in half a minute), or give it "
                "another namespace (-r __ns:=/robot2)"
            )
        problem = self.synchroniser.problem
        if problem is not None:
            yield str(problem)
        yield from self.problems()

    def _all_values(self) -> dict[str, object]:
        received = {f"received {topic}": n for topic, n in self.inputs.counts().items()}
        lost = {f"lost {topic}": n for topic, n in self.inputs.lost().items()}
        refused = {f"refused {topic}": n for topic, n in sorted(self.refused.items())}
        dropped = {
            f"dropped: {why}": n for why, n in sorted((self.dropped + self.overload).items())
        }
        steps = {
            "waiting": self.worker.backlog,
            "longest step [s]": f"{self.longest_step_s:.3f}",
        }
        return {**received, **lost, **refused, **dropped, **self.values(), **steps}


def is_latched(record: Any) -> bool:
    """Return whether a record is sent only once: the robot description, a fixed transform."""
    return isinstance(record, RobotDescription) or (
        isinstance(record, TransformSample) and record.is_static
    )
