"""slam_node: where the robot is, the walls, and the merged map of surfaces, live."""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from tccm_ros.errors import MapError
from tccm_ros.nodes.collision import CollisionObjects
from tccm_ros.nodes.inputs import Blocking
from tccm_ros.nodes.live_pose import LivePosePublisher
from tccm_ros.nodes.map_folder import read_map, write_map
from tccm_ros.nodes.outputs import Outputs
from tccm_ros.nodes.qos import LARGE_DEPTH, SENSOR_DEPTH, latched, sensor, surface_message
from tccm_ros.nodes.run import run
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.shared_robot import SharedRobot
from tccm_ros.records import Event, ScanPose, Surface, SurfaceCloud, ViewIntervals
from tccm_ros.results.occupancy import occupancy_grid
from tccm_ros.robot import MountKind
from tccm_ros.ros.output_messages import grid_message
from tccm_ros.ros.topic_messages import (
    SOLUTION_TOPICS,
    SURFACE_MESSAGE_TOPICS,
    SolutionMessageBuilder,
    TopicMessage,
)
from tccm_ros.sensors.depth_image import depth_stream, is_compressed
from tccm_ros.sensors.registry import default_streams
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.surfaces.track_ids import changes

GRID, GRID_TOPIC = "nav_msgs/msg/OccupancyGrid", "map"
"""For navigation, latched; saved as map.pgm and map.yaml."""

SOLVE_PERIOD_S = 2.0
"""Shortest time between two solutions, s. Chosen."""

SOLVE_FRACTION = 0.1
"""Fraction of the time that solving may take: a long solution is made less often. Chosen."""

KEYFRAMES_PER_SOLVE = 5
"""Without a new view the map is solved anew after so many keyframes. Chosen."""


class SlamNode(SensorNode):
    """Feeds the SLAM processor; publishes poses as scans come and the map now and then.

    Parameters
    ----------
    shared
        The robot of another node in this process; by default the node has its own.
    kwargs
        Those of `rclpy.node.Node`.
    """

    def __init__(self, shared: SharedRobot | None = None, **kwargs: Any):
        super().__init__("surface_slam", "slam", shared, **kwargs)
        self.processor = SurfaceSlam(self.config)
        self.newest_ns = 0
        self._unsolved: Counter[str] = Counter()
        self._next_solve_s = 0.0
        self._shown_ns = -1
        self._surfaces: tuple[Surface, ...] = ()
        self._has_tilt_scan = False
        self.live = LivePosePublisher(self, self.types, self.config, self.intake)
        self._message_builder = SolutionMessageBuilder(self.bulk_types, self.live.map_frame)
        topics = {**SOLUTION_TOPICS, GRID_TOPIC: GRID}
        profiles = dict.fromkeys(topics, latched())
        self._outputs = Outputs(
            self, self.bulk_types, topics, profiles, self.worker.post, shared=(GRID_TOPIC,)
        )
        self._boxes = CollisionObjects(self, self.types, self.live.map_frame)
        self.listen(watch="stream")
        self._listen_to_tccm()
        self.create_service(Trigger, "~/load_map", self._on_load_map)
        self.start()

    def _listen_to_tccm(self) -> None:
        for role in SURFACE_MESSAGE_TOPICS:
            self.subscribe(
                role,
                surface_message(),
                self.offer_computed,
                topic=f"tccm/{role}",
                watch="event",
                is_measured=False,
            )
        # Of what is mapped only the stamps count: those of the trajectory, where there is no
        # level laser. They are read from the serialised message.
        for stream in default_streams(self.config):
            if stream.processor != "tccm":
                continue
            if stream.companion is not None:
                compressed = is_compressed(self.resolve_topic_name(stream.role))
                stream = depth_stream(stream.role, compressed=compressed)
            depth = SENSOR_DEPTH if stream.mount is MountKind.TILTING else LARGE_DEPTH
            self.inputs.subscribe(
                stream.reader.message_type,
                stream.role,
                self._on_mapped_scan,
                sensor(self.config.qos.reliability, depth=depth),
                watch="event",
                raw=True,
            )

    # --- intake ---

    def takes(self, event: Event | SurfaceCloud | ViewIntervals) -> bool:
        """Return whether an event is for the processor."""
        return self.processor.takes(event)

    def take(self, role: str, record: Any) -> None:
        """Give a record to the robot."""
        if role in self.roles:
            self.live.note_scan(record.stamp_ns)
        super().take(role, record)

    def _on_mapped_scan(self, data: bytes) -> None:
        if self.config.qos.stamp == "header" and not self.processor.counts["level scans"]:
            stamp_ns, self._has_tilt_scan = raw_stamp_ns(data), True
            self.worker.offer(lambda: self.processor.add_pose_stamp(stamp_ns), is_droppable=True)

    # --- in the worker ---

    def feed(self, event: Any) -> None:
        """Give one event to the processor; publish poses, and a solution when it is due."""
        self.newest_ns = max(self.newest_ns, getattr(event, "stamp_ns", 0))
        resets = self.processor.counts["resets"]
        poses = self.processor.add(event)
        if self.processor.counts["resets"] != resets:
            self._forget()
        self._unsolved["clouds"] += type(event) is SurfaceCloud
        self._show_poses(poses)
        if self.worker.backlog == 0:
            self._solve_when_due()

    def _show_poses(self, poses: Iterable[ScanPose]) -> None:
        self._unsolved["keyframes"] += sum(pose.keyframe >= 0 for pose in poses)
        live = self.processor.current_pose()
        has_scan = self.processor.counts["level scans"] or self._has_tilt_scan
        if has_scan and live.stamp_ns > self._shown_ns and self.context.ok():
            self._shown_ns = live.stamp_ns
            self.live.odom_frame = self.processor.odom_frame
            self.live.show(live)

    def _solve_when_due(self) -> None:
        new = self._unsolved
        if not (new["clouds"] or new["keyframes"] >= KEYFRAMES_PER_SOLVE):
            return
        start = time.monotonic()
        if start < self._next_solve_s or self._waits_for_scan:
            return
        self._show(self.processor.solve(every_covariance=False))
        duration_s = time.monotonic() - start
        self._next_solve_s = start + max(SOLVE_PERIOD_S, duration_s / SOLVE_FRACTION)

    @property
    def _waits_for_scan(self) -> bool:
        """Whether nothing places this session in the map that was loaded yet."""
        return bool(self.processor.saved_keyframes) and not self.processor.counts["level scans"]

    def _show(self, solution: SurfaceSolution) -> None:
        self._unsolved.clear()
        self.live.note_solution(solution)
        self._outputs.publish(self._message_builder.of(solution, self.newest_ns))
        self._outputs.publish([TopicMessage(GRID_TOPIC, GRID, self._grid)])
        self._boxes.publish(solution.surfaces, self.newest_ns)
        for change in changes(self._surfaces, solution.surfaces):
            self.get_logger().info(str(change))
        self._surfaces = solution.surfaces

    def _grid(self) -> Any:
        """Return the level scans as a nav_msgs/OccupancyGrid; empty without a level laser."""
        grid = occupancy_grid(self.processor.walls.saved())
        cells, size, origin = np.zeros((0, 0), np.int8), 0.05, np.eye(4)
        if grid is not None:
            cells, size, origin[:2, 3] = grid.cells, grid.resolution, grid.origin
        frame = self.live.map_frame
        return grid_message(self.bulk_types, self.newest_ns, frame, cells, size, origin)

    def write(self, folder: Path) -> None:
        """Solve with all that has come and write the map."""
        if self._waits_for_scan:
            raise MapError("no level scan since the map was loaded: there is nothing new to save")
        solution = self.processor.solve()
        self._show(solution)
        write_map(folder, self.processor, solution, self.live.map_frame)

    def load(self, folder: Path) -> None:
        """Go on with a saved map; what was mapped since the start is forgotten."""
        saved = read_map(folder)
        self._begin_with(SurfaceSlam.from_saved(self.config, saved))
        self.live.is_localised = not saved.views or bool(self.processor.saved_keyframes)
        self._show(self.processor.solve())

    def begin(self) -> None:
        """Forget everything."""
        self._begin_with(SurfaceSlam(self.config))
        self.live.is_localised = True

    def _begin_with(self, processor: SurfaceSlam) -> None:
        self.processor = processor
        self._forget()

    def _forget(self) -> None:
        self.live.forget()
        self._shown_ns = -1
        self._surfaces = ()
        self._has_tilt_scan = False
        self.newest_ns = 0
        self._unsolved.clear()

    # --- services ---

    async def _on_load_map(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        folder = self.save_folder()
        job = self.worker.call(lambda: self.load(folder), self)
        return await self.answer(job, response, str(folder))

    # --- diagnostics ---

    def problem_without_odometry(self) -> str:
        """Return that matching alone tells how the base moves."""
        return (
            f"nobody publishes '{self.resolve_topic_name('odom')}', and no tf moves the base: "
            "matching of level scans alone tells its motion, and fails in long corridors and fast "
            "rotations; start the odometry, or remap the topic"
        )

    def used(self) -> Mapping[str, int]:
        """Return the level scans that were matched."""
        return {"scan": self.processor.counts["level scans"]}

    def problems(self) -> Iterable[str]:
        """Return which inputs the map lacks, and whether the robot knows where it is in it."""
        scan, surfaces = map(self.resolve_topic_name, ("scan", "tccm/surfaces"))
        if self.inputs.is_absent(scan) and self.inputs.is_absent(surfaces):
            yield Blocking(
                f"nobody publishes '{scan}' or '{surfaces}': there is nothing to map; start the "
                "level laser's driver and tccm_node, remap, or look at the namespace"
            )
        elif self.inputs.is_absent(scan):
            yield (
                f"nobody publishes '{scan}': without a level laser there are no walls and no loop "
                "closures, and the map drifts as odometry does; start its driver, or remap"
            )
        if not self.live.is_localised:
            yield "not yet found in the map that was loaded: map -> odom is not published; drive on"

    def values(self) -> Mapping[str, object]:
        """Return what has come of the input."""
        return dict(self.processor.counts)


def raw_stamp_ns(data: bytes) -> int:
    """Return the header stamp of a serialised message (CDR), ns."""
    order = "<" if data[1] & 1 else ">"
    sec, nanosec = struct.unpack_from(f"{order}iI", data, 4)
    return int(sec) * 1_000_000_000 + int(nanosec)


def main() -> None:
    """Run the node until it is told to stop."""
    run(SlamNode)
