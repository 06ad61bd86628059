"""tccm_node: planes, objects and the surface message of each tilt cycle, live."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rclpy.task import Future
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool, Trigger

from tccm_ros.atomic import output_folder
from tccm_ros.calibrate.rig_check import RigCheck
from tccm_ros.errors import MapError
from tccm_ros.geometry import inverse
from tccm_ros.mapping.tccm import CyclePlanes, CycleResult, TccmProcessor
from tccm_ros.nodes.intake.drops import PAUSED
from tccm_ros.nodes.intake.inputs import Blocking
from tccm_ros.nodes.intake.joint_timing_watch import JointTimingWatch
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.nodes.interfaces import has_interfaces, missing_interfaces
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.process.heap import trim_heap
from tccm_ros.nodes.publishing.outputs import Outputs
from tccm_ros.nodes.qos import latched_qos, sensor_qos, surface_message_qos
from tccm_ros.nodes.run import run
from tccm_ros.nodes.saving.map_folder import keep_previous
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.services.box_service import BoxService
from tccm_ros.records import Event, MapReset, Posed
from tccm_ros.results.cuboids_file import cuboids_archive
from tccm_ros.ros.topic_messages import CYCLE_TOPICS, SURFACE_MESSAGE_TOPICS, CycleMessageBuilder
from tccm_ros.ros.writing import scan_message
from tccm_ros.sensors.level_projection import LevelProjector

CUBOIDS_FILE = "cuboids.npz"
"""File that ~/save_map writes."""


class TccmNode(SensorNode):
    """Feeds the TCCM processor and publishes the results of each tilt cycle.

    Parameters
    ----------
    shared
        The robot of another node in this process; by default the node has its own.
    kwargs
        Arguments of `rclpy.node.Node`.
    """

    def __init__(self, shared: SharedRobot | None = None, **kwargs: Any):
        super().__init__("tccm", "tccm", shared, **kwargs)

    def configure(self) -> None:
        """Create the processor, publishers and services."""
        super().configure()
        self.processor = TccmProcessor(self.config)
        self.is_paused = False
        self._passed_by: Counter[str] = Counter()
        self._has_saved = False
        self._frame_id = self.config.frames.odom_name
        self._rig_check = RigCheck()
        self._rig_problems: tuple[str, ...] = ()
        self._joint_timing = JointTimingWatch(
            self.config, next(iter(self.config.sensors.tilt_scans), ""), self.get_logger().warning
        )
        self._message_builder = CycleMessageBuilder(
            self.bulk_types,
            self.config,
            lambda: inverse(self.robot.robot.motion.odometry.T_near_odom),
        )
        profiles = {
            topic: surface_message_qos() if topic in SURFACE_MESSAGE_TOPICS else latched_qos()
            for topic in CYCLE_TOPICS
        }
        self._outputs = Outputs(
            self,
            self.bulk_types,
            CYCLE_TOPICS,
            profiles,
            self.worker.post,
            always=SURFACE_MESSAGE_TOPICS,
        )
        self._level = LevelProjector(self.config)
        self._level_scans = (
            self.create_publisher(LaserScan, "~/level_scan", sensor_qos("reliable"))
            if self._level.is_on
            else None
        )
        self.create_service(Trigger, "~/take_view", self._on_take_view)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self._boxes = BoxService(self, self.processor) if has_interfaces() else None

    def activate(self) -> None:
        """Subscribe."""
        self.listen(watch="needed")
        super().activate()

    @property
    def dropped(self) -> Counter[str]:
        """Counts of scans that were not used, by reason."""
        return super().dropped + self.processor.dropped + self._passed_by

    # --- intake ---

    def takes(self, event: Event) -> bool:
        """Return whether an event is for the processor.

        While paused, only a reset of the map is. Joint angles are paused with the scans, because
        tilt cycles without scans would age the map.
        """
        return self.processor.takes(event) and (not self.is_paused or type(event) is MapReset)

    def queue_events(self, events: Sequence[Any]) -> None:
        """Queue events for the worker; during a pause, only count the sensor measurements."""
        if self.is_paused:
            measured = (e for e in events if isinstance(e, Posed) and self.processor.takes(e))
            self._passed_by[PAUSED] += sum(1 for _ in measured)
        super().queue_events(events)

    # --- in the worker ---

    def process_event(self, event: Event) -> None:
        """Feed one event to the processor and publish the cycles that it completes.

        Planes are published as soon as they are known.
        """
        self._publish(self.processor.add(event, self._publish_planes))
        self._joint_timing.add(event)
        self._publish_level_scan(event)
        self._note_map()

    def _publish_level_scan(self, event: Event) -> None:
        """Publish the level scan of an event, and pass it to a SLAM node in this process."""
        scan = self._level.project(event)
        if scan is not None and self._level_scans is not None:
            self._level_scans.publish(scan_message(self.types, scan))
            if self.robot.is_shared:
                self.robot.add("scan", scan)

    def begin(self) -> None:
        """Reset to an empty map."""
        self.processor.reset()
        self._note_map()
        self._has_saved = False
        self._rig_check.clear()
        self._rig_problems = ()

    def end_input(self) -> None:
        """Close the open tilt cycle."""
        self._publish(self.processor.finish(self._publish_planes))
        self._note_map()

    def _note_map(self) -> None:
        if self._boxes is not None:
            self._boxes.refresh()

    def _write(self, *, is_asked: bool) -> str:
        """Write cuboids.npz and return a sentence about it.

        Raises
        ------
        MapError
            If nothing is mapped.
        """
        folder, cuboids = self.save_folder(), self.processor.map.cuboids()
        if not len(cuboids):
            raise MapError(
                f"{folder}: not written, no tilt cycle has been mapped: is there a tilt scan, and "
                "does the joint move?"
            )
        archive = cuboids_archive(cuboids, self.config, self._frame_id)
        if is_asked or not self._has_saved:
            keep_previous(folder, [CUBOIDS_FILE])
        with output_folder(folder) as made:
            (made / CUBOIDS_FILE).write_bytes(archive)
        self._has_saved = True
        trim_heap()
        return f"{folder}: {len(cuboids)} cuboids"

    def _save(self) -> str:
        self.end_input()
        return self._write(is_asked=True)

    def begin_save(self) -> Future:
        """Start writing cuboids.npz, including the open tilt cycle."""
        return self.worker.call(self._save, self)

    def autosave(self) -> None:
        """Write cuboids.npz without the open tilt cycle."""
        self.worker.post(lambda: self.saves.attempt(lambda: self._write(is_asked=False)))

    def save_at_end(self, ending: Ending) -> None:
        """Write cuboids.npz including the open tilt cycle, which takes little time."""
        self.robot.flush()
        self.worker.wait(self.end_input, lambda: ending.is_over)
        self.saves.at_end(lambda: self._write(is_asked=False), ending, self.worker.wait)

    def _publish_planes(self, found: CyclePlanes) -> None:
        self._outputs.publish([self._message_builder.planes(found)])

    def _publish(self, results: Iterable[CycleResult]) -> None:
        for result in results:
            rest = self._message_builder.after_planes(result, self.processor.map.cuboids)
            self._outputs.publish(rest)
            self._frame_id = result.frame_id
            self._rig_check.add(result)
            self._rig_problems = tuple(self._rig_check.problems())
            trim_heap()

    # --- services ---

    def _on_take_view(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        self.worker.post(lambda: self.processor.take_view())
        response.success, response.message = True, "the view is taken when the tilt cycle ends"
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> Any:
        self.is_paused = request.data
        response.success = True
        return response

    # --- diagnostics ---

    def problem_without_odometry(self) -> str:
        """Return that the base is assumed to stand still."""
        return Blocking(
            f"nobody publishes '{self.resolve_topic_name('odom')}', and no tf moves the base: it "
            "is taken to stand still; start the odometry, or remap the topic"
        )

    def used(self) -> Mapping[str, int]:
        """Return the number of records used in cycles, by role."""
        return {role: self.processor.used[role] for role in self.roles}

    def problems(self) -> Iterable[str]:
        """Return problems of the records, of the rig, and of missing interfaces."""
        missing = filter(None, [missing_interfaces()])
        return [
            *super().problems(), *self._rig_problems, *self._joint_timing.problems, *missing
        ]  # fmt: skip

    def values(self) -> Mapping[str, object]:
        """Return the counts of cycles and scans used, and whether the node is paused."""
        return {**dict(self.processor.counts), "paused": self.is_paused}


def main() -> None:
    """Run the node until it is asked to stop."""
    run(TccmNode)
