"""Current inputs of approach_node: odometry, level scans, tilt cycles, localisation in the map.

The intake's thread handles all messages and runs the control loop.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node

from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.obstacle_memory import ObstacleMemory
from tccm_ros.approach.readings import Readings, TopCycle
from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.errors import FrameError, TccmError
from tccm_ros.geometry import compose2, inverse2, planar, spatial, transform, transform2
from tccm_ros.nodes.intake.inputs import Inputs
from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.nodes.intake.record_subscriptions import RecordSubscriptions
from tccm_ros.nodes.intake.refusals import Refusals
from tccm_ros.nodes.qos import latched_qos, sensor_qos, static_transforms_qos, surface_message_qos
from tccm_ros.nodes.ros_types import has_tf2_msgs
from tccm_ros.records import PosedScan, SurfaceCloud
from tccm_ros.records.building import stamp_ns_from_message
from tccm_ros.robot.robot import Robot
from tccm_ros.ros.map_records import MapLocalisation
from tccm_ros.ros.output_messages import OBSTACLE_STEP_M
from tccm_ros.ros.pointcloud import POINT_ROW, cloud_rows
from tccm_ros.sensors.laser_scan import LEVEL_SCAN, bearings, scan_stream

STALE_NS = 3_000_000_000
"""Maximum age of ~/localisation, ns. It is published once a second: older, its node is gone."""


class BaseInputs:
    """Subscribes to the inputs of the control loop.

    Parameters
    ----------
    node, config
        The node, and groups `frames`, `rig`, `scan` and `qos`.
    localisation
        Returns the newest localisation from the map's node; None before the first.
    refusals
        Log of messages that cannot be used.

    Attributes
    ----------
    intake
        Its thread handles the messages, and calls the timers that are added to it.
    """

    def __init__(
        self,
        node: Node,
        config: Config,
        localisation: Callable[[], MapLocalisation | None],
        refusals: Refusals,
    ):
        self._localisation, self._refuse = localisation, refusals.note
        self._odometry_topic = node.resolve_topic_name("odom")
        self.intake = Intake(node, partial(refusals.note, "intake"))
        self._inputs = Inputs(node, config.qos.silence, self.intake)
        scans = scan_stream(LEVEL_SCAN, config)
        self._robot = Robot(config, [scans])
        self._scan, self._scan_ns = np.zeros((0, 2)), -1
        self._laser = np.zeros(2)
        self._memory, self._cuboids_ns = ObstacleMemory(OBSTACLE_STEP_M), -1
        self._cycle: TopCycle | None = None
        self._localised: tuple[MapLocalisation, Float64] | None = None
        records = RecordSubscriptions(node, config, self._inputs, refusals, {scans.role: scans})
        records.to_sensors(self._take_sensor, watch="event")
        measured = sensor_qos(config.qos.reliability)
        subscribe = partial(records.to, take=self._take_sensor, watch="event")
        subscribe("odom", measured)
        subscribe("joint_states", measured)
        subscribe("robot_description", latched_qos())
        if has_tf2_msgs():
            subscribe("tf", measured, topic="/tf")
            subscribe("tf_static", static_transforms_qos(), topic="/tf_static")
        records.to(
            "surfaces", surface_message_qos(), self._take_cycle, topic="tccm/surfaces",
            watch="event", is_measured=False,
        )  # fmt: skip
        self._inputs.subscribe(
            "sensor_msgs/msg/PointCloud2", "tccm/obstacles", self._take_cuboids, latched_qos(),
            watch="event",
        )  # fmt: skip

    def _take_sensor(self, role: str, record: Any) -> None:
        if self._robot.motion.source is None:
            self._robot.expects_odometry = self._inputs.is_published(self._odometry_topic)
        for event in self._robot.add(role, record):
            if isinstance(event, PosedScan):
                self._take_scan(event)

    def _take_scan(self, posed: PosedScan) -> None:
        scan = posed.scan
        ranges = scan.ranges.astype(np.float64)
        is_seen = np.isfinite(ranges) & (ranges > scan.range_min)
        angles, ranges = bearings(scan)[is_seen], ranges[is_seen]
        local = np.stack(
            [ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(ranges))], axis=1
        )
        middle = len(posed.pose_stamps_ns) // 2
        T = posed.T_odom_base[middle] @ posed.T_base_laser[min(middle, len(posed.T_base_laser) - 1)]
        self._scan, self._scan_ns = transform(T, local)[:, :2], posed.scan.stamp_ns
        self._laser = T[:2, 3]

    def _take_cycle(self, role: str, cloud: SurfaceCloud) -> None:
        pose = self._pose_at(cloud.stamp_ns)
        if pose is None:
            return
        T = spatial(pose)
        viewpoint = np.array([0.0, 0.0, 1.0]) if cloud.viewpoint is None else cloud.viewpoint
        points = transform(T, cloud.points.astype(np.float64))
        seen_from = transform(T, np.asarray(viewpoint, np.float64)[None])[0]
        self._cycle = TopCycle(cloud.stamp_ns * 1e-9, points, seen_from)
        self._memory.forget_visible(self._cycle)

    def _take_cuboids(self, message: Any) -> None:
        try:
            rows = cloud_rows(message, POINT_ROW)
        except TccmError as error:
            self._refuse("tccm/obstacles", error)
            return
        points = np.stack([rows["x"], rows["y"], rows["z"]], axis=1).astype(np.float64)
        points[:, :2] = cube_middles(points[:, :2])
        points = transform(self._robot.motion.odometry.T_near_odom, points)
        self._cuboids_ns = stamp_ns_from_message(message.header.stamp)
        pose = self._pose_at(self.newest_ns)
        self._memory.add(points, np.zeros(2) if pose is None else pose[:2])

    # --- where the base is ---

    @property
    def _base(self) -> str:
        return self._robot.sensors[LEVEL_SCAN.role].mount.base or ""

    def _known_ns(self) -> tuple[int, int] | None:
        """Return the first and the newest stamp of the base's pose, ns; None without a pose.

        The pose is that of odometry or, where nobody publishes it, of tf.
        """
        try:
            tracks = self._robot.motion.tracks(self._base)
        except FrameError:  # tf has no chain to the base
            return None
        if not tracks or not all(map(len, tracks)):
            return None
        firsts, lasts = zip(*(track.stamps_ns[[0, -1]].tolist() for track in tracks))
        return max(firsts), min(lasts)

    def _pose_at(self, stamp_ns: int) -> Float64 | None:
        """Return the pose (3,) in odom at a stamp; the newest pose for newer stamps.

        None for stamps before the history.
        """
        known = self._known_ns()
        if known is None or stamp_ns < known[0]:
            return None
        at_ns = np.array([min(stamp_ns, known[1])], np.int64)
        return planar(self._robot.motion.at(at_ns, self._base)[0])

    @property
    def newest_ns(self) -> int:
        """Stamp of the base's newest pose, ns; -1 before the first."""
        known = self._known_ns()
        return -1 if known is None else known[1]

    def _map_odom(self, now_ns: int) -> tuple[Float64 | None, str]:
        """Return the pose (3,) of odom in map and an empty text, or None and the reason."""
        localisation = self._localisation()
        if localisation is None:
            return None, "nobody publishes ~/localisation of the map's node"
        if localisation.state != "tracking":
            return None, localisation.reason or localisation.state
        stamp_ns = stamp_ns_from_message(localisation.message.header.stamp)
        if now_ns - stamp_ns > STALE_NS:
            return None, f"~/localisation is {(now_ns - stamp_ns) * 1e-9:.1f} s old"
        if self._localised is None or self._localised[0] is not localisation:
            pose = self._pose_at(stamp_ns)
            if pose is None:
                return None, "odometry does not go back to the stamp of ~/localisation"
            map_odom = compose2(planar(localisation.T_map_base), inverse2(pose))
            self._localised = localisation, map_odom
        return self._localised[1], ""

    @property
    def odom_frame(self) -> str:
        """Name of the odometry frame."""
        return self._robot.motion.odom_frame

    def in_odom(self, pose: Float64) -> Float64:
        """Return a pose float64 (3,) of `Readings` in the odometry frame as others know it."""
        return compose2(inverse2(planar(self._robot.motion.odometry.T_near_odom)), pose)

    def newest(self, now_ns: int, footprint: Footprint) -> Readings | None:
        """Return the newest measurements; None before the first odometry.

        Parameters
        ----------
        now_ns
            Time of the node clock, ns.
        footprint
            Level scan points within it are on the robot itself, and are left out.
        """
        stamp_ns = self.newest_ns
        pose = self._pose_at(stamp_ns)
        if pose is None:
            return None
        map_odom, why_lost = self._map_odom(now_ns)
        local = transform2(inverse2(pose), self._scan)
        scan = self._scan[footprint.distance(local) > 0.0] if len(local) else self._scan
        return Readings(
            now_ns * 1e-9, pose, stamp_ns * 1e-9, map_odom, why_lost, scan, _seconds(self._scan_ns),
            self._laser, self._memory.points, _seconds(self._cuboids_ns), self._cycle,
            OBSTACLE_STEP_M,
        )  # fmt: skip


def cube_middles(points: Float64) -> Float64:
    """Return the middles (N, 2) of the cubes of ~/obstacles in which points (N, 2) are, in odom."""
    # Points on a side belong to the cube beyond it, also after rounding to float32.
    cubes = np.floor(points / OBSTACLE_STEP_M + 1e-3)
    return np.asarray((cubes + 0.5) * OBSTACLE_STEP_M)


def _seconds(stamp_ns: int) -> float:
    """Return a stamp in s; -inf for -1, before the first message."""
    return stamp_ns * 1e-9 if stamp_ns >= 0 else -np.inf
