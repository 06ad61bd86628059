"""Feeds a running Rerun viewer: measurements of the robot's sensors, planes and part maps.

The records are posed by a robot of its own, as in the mapping nodes, which know nothing of the
viewer.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.errors import TccmError
from tccm_ros.geometry import inverse, pose_from_quaternion, transform
from tccm_ros.nodes.intake.inputs import Inputs
from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.nodes.intake.record_subscriptions import RecordSubscriptions
from tccm_ros.nodes.intake.refusals import Refusals
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.nodes.qos import latched_qos
from tccm_ros.records import CameraImage, Event, MapOdom
from tccm_ros.records.building import pose_from_message, stamp_ns_from_message
from tccm_ros.results.cycles_file import MIN_CELL_SIZE_M, coarsen
from tccm_ros.ros.pointcloud import MAP_ROW, cloud_rows
from tccm_ros.sensors.registry import default_streams
from tccm_ros.view.rerun_stream import RerunStream

MAX_BOXES = 20_000
"""Maximum number of boxes of a part map, as `rerun_sensors.MAX_POINTS` of points: cells are
enlarged until it is met."""


class RerunFeed:
    """Subscribes to the sensors and to the results of each tilt cycle, for a viewer.

    Parameters
    ----------
    node, config
        The node, and groups `frames`, `rig`, `scan`, `sensors`, `localisation` and `qos`.
    map_node, tccm_node
        Names of the nodes with the map and with the tilt cycles, within the namespace.
    viewer
        The connection to the viewer.
    """

    def __init__(
        self, node: Node, config: Config, map_node: str, tccm_node: str, viewer: RerunStream
    ):
        self._viewer = viewer
        refusals = Refusals(node.get_logger().warning)
        self._refuse = refusals.note
        self._intake = Intake(node, partial(refusals.note, "intake"))
        inputs = Inputs(node, config.qos.silence, self._intake)
        odometry = node.resolve_topic_name("odom")
        self._robot = SharedRobot(config, self._intake, lambda: inputs.is_published(odometry))
        self._robot.listen(self._show, lambda: False)
        streams = {
            stream.role: stream
            for stream in default_streams(config)
            if not stream.is_occasional and stream.record is not CameraImage
        }
        subscriptions = RecordSubscriptions(node, config, inputs, refusals, streams)
        subscriptions.to_sensors(self._robot.add, watch="event")
        subscriptions.to_robot(self._robot.add)
        for kind, topic, take, qos in (
            (TransformStamped, f"{map_node}/map_to_odom", self._take_map_odom, 10),
            (MarkerArray, f"{tccm_node}/planes", self._take_planes, latched_qos()),
            (PointCloud2, f"{tccm_node}/map_cloud", self._take_cuboids, latched_qos()),
        ):
            node.create_subscription(kind, topic, take, qos)
        self._intake.start()

    def close(self) -> None:
        """Stop handling messages."""
        self._intake.close()

    @property
    def _T_near_odom(self) -> Float64:
        return self._robot.robot.motion.odometry.T_near_odom

    def _show(self, events: Sequence[Event]) -> None:
        for event in events:
            self._viewer.add(event)

    def _take_map_odom(self, message: Any) -> None:
        p, q = message.transform.translation, message.transform.rotation
        T_map_odom = pose_from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
        T = T_map_odom @ inverse(self._T_near_odom)
        self._viewer.add(MapOdom(stamp_ns_from_message(message.header.stamp), T))

    def _take_planes(self, message: Any) -> None:
        shown = [m for m in message.markers if m.ns == "outline" and m.action == Marker.ADD]
        outlines = {marker.id: outline_of(marker, self._T_near_odom) for marker in shown}
        stamps = [stamp_ns_from_message(marker.header.stamp) for marker in message.markers]
        if stamps:
            self._viewer.show_planes(max(stamps), outlines)

    def _take_cuboids(self, message: Any) -> None:
        try:
            rows = cloud_rows(message, MAP_ROW)
        except TccmError as error:
            self._refuse("map_cloud", error)
            return
        table, cell_size = newest_part(rows, self._T_near_odom)
        self._viewer.show_part(stamp_ns_from_message(message.header.stamp), table, cell_size)


def outline_of(marker: Any, T_near_odom: Float64) -> Float64:
    """Return the edges of a marker of ~/planes as one line (N, 3) in the frame of the records."""
    T = T_near_odom @ pose_from_message(marker.pose, "a plane")
    ends = np.array([(point.x, point.y, point.z) for point in marker.points])
    return transform(T, ends.reshape(-1, 3))


def newest_part(rows: NDArray[Any], T_near_odom: Float64) -> tuple[Int64, float]:
    """Return the cuboids of the newest tilt cycle of ~/map_cloud as a coarse part map.

    Parameters
    ----------
    rows
        Cuboids, a structured array (N,) of `MAP_ROW`, in the published odometry frame.
    T_near_odom
        float64 (4, 4), to the frame of the records.

    Returns
    -------
    table : int64 (4, M)
        Rows of `coarsen`.
    cell_size : float
        Edge length of its cells, m.
    """
    rows = rows[rows["cycle"] == rows["cycle"].max(initial=0)]
    tops = np.stack([rows["x"], rows["y"], rows["z"]], axis=1).astype(np.float64)
    near = transform(T_near_odom, tops)
    cell_size = MIN_CELL_SIZE_M
    while True:
        ix, iy = np.floor(near[:, :2].T / cell_size).astype(np.int64)
        low, high = np.floor(100.0 * (near[:, 2] - rows["depth"])), np.ceil(100.0 * near[:, 2])
        table = coarsen(ix, iy, low.astype(np.int64), high.astype(np.int64))
        if table.shape[1] <= MAX_BOXES:
            return table, cell_size
        cell_size *= 2.0
