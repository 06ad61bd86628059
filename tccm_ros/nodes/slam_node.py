"""slam_node: pose of the robot, walls and the merged map of surfaces, live."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.task import Future
from std_srvs.srv import Trigger

from tccm_ros.errors import TccmError
from tccm_ros.nodes.clock import steady_timer
from tccm_ros.nodes.intake.inputs import Blocking
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.nodes.map_session import MapSession
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.process.heap import trim_heap
from tccm_ros.nodes.publishing.live_pose import LivePosePublisher
from tccm_ros.nodes.publishing.localisation import BY_START, LocalisationPublisher
from tccm_ros.nodes.publishing.outputs import SolutionOutputs
from tccm_ros.nodes.qos import (
    LARGE_DEPTH,
    SENSOR_DEPTH,
    latched_qos,
    sensor_qos,
    surface_message_qos,
)
from tccm_ros.nodes.run import run
from tccm_ros.nodes.saving.solution_saver import SolutionSaver, Wanted
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.services.client_api import ClientApi, offered
from tccm_ros.nodes.services.keepout import tell_keepout_info
from tccm_ros.nodes.signs.reader import SignReader
from tccm_ros.nodes.solver.channel import (
    GRID,
    GRID_TOPIC,
    KEEPOUT_TOPIC,
    Localised,
    Messages,
    Solved,
)
from tccm_ros.nodes.solver.solver import Answer, Solver
from tccm_ros.records import (
    Event,
    LabelCorrection,
    ObjectBoxes,
    Scan,
    SurfaceCloud,
    ViewIntervals,
)
from tccm_ros.robot import MountKind, Stream
from tccm_ros.ros.topic_messages import SOLUTION_TOPICS, SURFACE_MESSAGE_TOPICS
from tccm_ros.sensors.camera_image import PosedPicture
from tccm_ros.sensors.detections import PosedDetections
from tccm_ros.sensors.registry import default_streams, stream_for_topic
from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement
from tccm_ros.signs.reading import missing_extra
from tccm_ros.slam.tracking import Tracker

LOOK_S = 0.5
"""Period of the check for a due solution without records, s of the wall clock: ROS time may
stop."""

NO_MAP_ODOM = "no map -> odom has come on /tf; start your localisation"
"""Reason while an external localisation has not published map -> odom."""


class SlamNode(SensorNode):
    """Feeds the SLAM processor; publishes poses with each scan and the map with each solution.

    Parameters
    ----------
    shared
        The robot of another node in this process; by default the node has its own.
    kwargs
        Arguments of `rclpy.node.Node`.
    """

    def __init__(self, shared: SharedRobot | None = None, **kwargs: Any):
        super().__init__("surface_slam", "slam", shared, **kwargs)

    def configure(self) -> None:
        """Create the tracker, the solver process, publishers and services."""
        super().configure()
        self.solver = Solver(self.config, self._on_answer)
        self.at_end(self.solver.close)
        self.signs = SignReader(self.config, self._on_signs)
        self.at_end(self.signs.close)
        self.live = LivePosePublisher(self, self.types, self.config, self.intake, self.robot)
        self._create_localisation()
        self.saver = SolutionSaver(
            self.solver,
            lambda: self.session.state,
            self.saves,
            self.localisation.name_map,
            partial(self.refuse, "saving"),
        )
        self.at_end(self.saver.close)
        self._create_outputs()
        self.session = MapSession(
            self.config,
            self.solver,
            self.live,
            self.localisation,
            self._outputs,
            self._client_api,
            self._forget,
            self.context.ok,
        )
        self.add_post_set_parameters_callback(self._on_parameters)
        self.at_end(lambda: self.remove_post_set_parameters_callback(self._on_parameters))
        self.create_service(Trigger, "~/load_map", self._on_load_map)
        self._look = steady_timer(
            self, LOOK_S, lambda: self.worker.post(self.session.solve_when_quiet)
        )

    def _create_localisation(self) -> None:
        """Create the publisher of the localisation, and its service unless another node has it."""
        self.localisation = LocalisationPublisher(
            self,
            self.types,
            self.live.map_frame,
            lambda guess: self.worker.call(lambda: self.session.take_guess(guess), self),
        )
        self._is_external = self.config.localisation.is_external
        if self._is_external:
            self.localisation.note_search(NO_MAP_ODOM, BY_START)
        else:
            self.localisation.offer_service(self, self.answer)

    def _create_outputs(self) -> None:
        """Create the publishers of the map and the services of its clients."""
        topics = {**offered(SOLUTION_TOPICS), KEEPOUT_TOPIC: GRID}
        if not self._is_external:  # an external localisation owns the grid
            topics[GRID_TOPIC] = GRID
        self._outputs = SolutionOutputs(
            self, topics, latched_qos(), self.solver.show, self.worker.post, shared=(GRID_TOPIC,)
        )
        tell_keepout_info(self, f"~/{KEEPOUT_TOPIC}")
        self._client_api = ClientApi(
            self, self.live, self.begin_named_save, self.load, self.begin_correction
        )
        self.at_end(self._client_api.close)

    def activate(self) -> None:
        """Subscribe."""
        self.listen(watch="stream")
        self._listen_to_tccm()
        if not self._is_external:
            self.localisation.listen(self)
        super().activate()

    def unsubscribe(self) -> None:
        """End the subscriptions."""
        super().unsubscribe()
        self.localisation.unsubscribe(self)

    def _on_parameters(self, _: object) -> None:
        self.worker.post(self.session.take_config)

    def _listen_to_tccm(self) -> None:
        for role in SURFACE_MESSAGE_TOPICS:
            self.record_subscriptions.to(
                role,
                surface_message_qos(),
                self.queue_computed,
                topic=f"tccm/{role}",
                watch="event",
                is_measured=False,
            )
        # Only the stamps of mapped scans matter: without a level laser they are the times of the
        # trajectory. They are read from the serialised message.
        for stream in default_streams(self.config):
            if stream.processor != "tccm":
                continue
            reader = stream_for_topic(stream, self.resolve_topic_name(stream.role)).reader
            depth = SENSOR_DEPTH if stream.mount is MountKind.TILTING else LARGE_DEPTH
            self.inputs.subscribe(
                reader.message_type,
                stream.role,
                self._on_mapped_scan,
                sensor_qos(self.config.qos.reliability, depth=depth),
                watch="event",
                raw=True,
            )

    @property
    def processor(self) -> Tracker:
        """Tracks the base."""
        return self.session.tracker

    # --- intake ---

    def takes(self, event: Event | ObjectBoxes | SurfaceCloud | ViewIntervals) -> bool:
        """Return whether an event is for the processor."""
        is_posed = isinstance(event, (PosedDetections, PosedPicture))
        return is_posed or self.processor.takes(event)

    def wanted_streams(self, processor_name: str) -> list[Stream]:
        """Return the level laser's stream, and the picture streams if signs can be read."""
        wanted = super().wanted_streams(processor_name)
        return wanted if missing_extra() else wanted + super().wanted_streams("signs")

    def add_record(self, role: str, record: Any) -> None:
        """Pass a record to the robot."""
        if type(record) is Scan:
            self.live.note_scan(record.stamp_ns)
        super().add_record(role, record)

    def _on_mapped_scan(self, data: bytes) -> None:
        if self.config.qos.stamp == "header" and not self.processor.counts["level scans"]:
            stamp_ns = raw_stamp_ns(data)
            self.worker.offer(lambda: self.session.add_tilt_scan(stamp_ns), is_droppable=True)

    # --- in the worker ---

    def process_event(self, event: Any) -> None:
        """Track the base, publish its pose and start a solution when one is due."""
        if type(event) is PosedPicture:
            self.signs.offer(event)
            return
        self.session.track(event)
        if self.worker.backlog == 0:
            self.session.solve_if_due()

    def begin(self) -> None:
        """Begin an empty map."""
        self.session.begin()

    def load(self, folder: Path, name: str = "") -> str:
        """Continue a saved map, under a name if it has one; discard the map of this run."""
        self.session.load(folder, name)
        self.saver.adopt(folder)
        return str(folder)

    def _forget(self) -> None:
        self.saver.forget()
        self.signs.begin()

    # --- from the solver and the sign reader ---

    def _on_answer(self, answer: Answer) -> None:
        if isinstance(answer, Solved):
            self._client_api.receive(answer)
            self.worker.post(lambda: self.session.take_solved(answer))
            trim_heap()
        elif isinstance(answer, Localised):
            self.worker.post(lambda: self.session.take_localised(answer))
        elif isinstance(answer, Messages):
            self.worker.post(lambda: self._outputs.publish(answer.messages))
        else:
            self.refuse("solving", TccmError(answer.error))

    def _on_signs(self, events: Sequence[SearchedPicture | SignMeasurement]) -> None:
        """Pass the results of a picture to the solver, under the stamp of the picture."""
        for event in events:
            self.worker.post(partial(self.session.add, event))

    def begin_correction(self, correction: LabelCorrection) -> Future:
        """Queue the correction of a label and a solution that contains it."""
        return self.worker.call(lambda: self.session.correct_label(correction), self)

    # --- saving ---

    def begin_save(self) -> Future:
        """Start saving the newest solution, with all input received unless that takes too long."""
        return self.saver.begin(self, self.save_folder(), self._ask_for_save)

    def begin_named_save(self, folder: Path) -> Future:
        """Start saving into the folder of a name, replacing any map there."""
        return self.saver.begin(self, folder, self._ask_for_save, is_named=True)

    def _ask_for_save(self, note: Callable[[Wanted], None]) -> None:
        """Request a solution with all records and pictures received."""

        def ask() -> None:
            note(Wanted(self.session.newest_ns, self.session.ask_solution()))

        self.worker.post(lambda: self.signs.after(lambda: self.worker.post(ask)))

    def autosave(self) -> None:
        """Save the newest solution as it is."""
        self.saver.autosave(self.save_folder(), self.session.input)

    def save_quickly(self, ending: Ending) -> None:
        """Save the newest solution at once."""
        if self.config.save.on_shutdown:
            self.saver.save_quickly(self.save_folder(), self.session.input, ending)

    def save_at_end(self, ending: Ending) -> None:
        """Save a solution with all input if it completes in time, else the newest one."""

        def is_over() -> bool:
            return ending.is_over

        numbers: list[int] = []
        self.robot.flush()
        self.worker.wait(lambda: None, is_over)
        self.signs.wait(is_over)
        self.worker.wait(lambda: numbers.append(self.session.ask_solution(is_final=True)), is_over)
        if not numbers or not self.saver.wait(numbers[0], ending):
            ending.left_out[self.get_name()] = f"the newest records, {ending.why}"
        self.saver.save_at_end(self.save_folder(), self.session.input, ending)

    # --- services ---

    async def _on_load_map(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        folder = self.save_folder()
        job = self.worker.call(lambda: self.load(folder), self)
        return await self.answer(job, response)

    # --- diagnostics ---

    def problem_without_odometry(self) -> str:
        """Return that only scan matching measures the motion of the base."""
        return (
            f"nobody publishes '{self.resolve_topic_name('odom')}', and no tf moves the base: "
            "only matching of level scans measures its motion, and fails in long corridors and "
            "fast rotations; start the odometry, or remap the topic"
        )

    def used(self) -> Mapping[str, int]:
        """Return the numbers of level scans matched and of pictures read since the start."""
        pictures = dict.fromkeys(self.config.sensors.camera_images, self.signs.counts["pictures"])
        return {"scan": self.session.scans, **pictures}

    @property
    def dropped(self) -> Counter[str]:
        """Counts of records that were not used, by reason."""
        return super().dropped + self.signs.dropped

    def problems(self) -> Iterable[str]:
        """Return problems of inputs, localisation, signs and solver."""
        scan, surfaces = map(self.resolve_topic_name, ("scan", "tccm/surfaces"))
        if self._is_external:
            if self.inputs.is_absent(surfaces):
                yield Blocking(f"nobody publishes '{surfaces}': start tccm_node, or remap")
        elif self.inputs.is_absent(scan) and self.inputs.is_absent(surfaces):
            yield Blocking(
                f"nobody publishes '{scan}' or '{surfaces}': there is nothing to map; start the "
                "level laser's driver and tccm_node, remap, or look at the namespace"
            )
        elif self.inputs.is_absent(scan):
            yield (
                f"nobody publishes '{scan}': without a level laser there are no walls and no loop "
                "closures, and the map drifts as odometry does; start its driver, or remap"
            )
        yield from self._problems_of_localisation()
        yield from self._problems_of_signs()
        yield from self.solver.problems()
        solved = self.solver.newest
        for stage in () if solved is None else solved.failed_stages:
            yield f"left out of the map, as it failed: {stage}; report it"
        yield from self._client_api.problems()

    def _problems_of_localisation(self) -> Iterable[str]:
        """Yield reasons why the robot's pose in the map is unknown or uncertain."""
        for role, laser in self.robot.robot.sensors.items():
            if laser.posed and laser.mount.is_base:
                yield (
                    f"no frames and no odometry: the laser on '{self.resolve_topic_name(role)}' is "
                    "the base, and moves as matching says; publish tf or a robot description if it "
                    "is not"
                )
        if self._is_external:
            if self.session.newest_ns and not self.processor.is_localised:
                yield f"nothing is mapped: {NO_MAP_ODOM}"
        elif not self.live.is_localised:
            reason = self.localisation.reason
            yield f"the robot is not found in the map: {reason}; map -> odom is not published"
        elif self.processor.is_unjoined:
            yield f"the robot is not found in the map: {self.localisation.reason}"

    def _problems_of_signs(self) -> Iterable[str]:
        """Yield the reason why published pictures are not read."""
        topics = map(self.resolve_topic_name, self.config.sensors.camera_images)
        missing = missing_extra() if self.config.signs.enabled else ""
        if missing and any(map(self.inputs.is_published, topics)):
            yield f"door signs are not read: {missing}; or set signs.enabled to false"
        elif self.signs.problem:
            yield f"door signs are not read: {self.signs.problem}"

    def values(self) -> Mapping[str, object]:
        """Return the counts of tracked events, of pictures and of the newest solution."""
        found: dict[str, object] = {
            **self.processor.counts,
            "solver restarts": self.solver.restarts,
            **self.signs.counts,
        }
        solved = self.solver.newest
        if solved is not None:
            found |= {"solution": solved.number, "solved in [s]": f"{solved.duration_s:.2f}"}
            found |= {f"unused {why}": n for why, n in sorted(solved.unused_detections.items())}
        return found


def raw_stamp_ns(data: bytes) -> int:
    """Return the header stamp of a serialised message (CDR), ns."""
    order = "<" if data[1] & 1 else ">"
    sec, nanosec = struct.unpack_from(f"{order}iI", data, 4)
    return int(sec) * 1_000_000_000 + int(nanosec)


def main() -> None:
    """Run the node until it is asked to stop."""
    run(SlamNode)
