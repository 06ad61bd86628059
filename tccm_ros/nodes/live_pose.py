"""Where the robot is now: map -> odom and the pose with its covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.node import Node

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.nodes.intake import Intake
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.nodes.solver_channel import Solved
from tccm_ros.nodes.tf import TfPublisher, has_tf2_msgs
from tccm_ros.records import TransformSample
from tccm_ros.ros.output_messages import pose_covariance_message
from tccm_ros.ros.types import MessageTypes
from tccm_ros.ros.writing import transform_message
from tccm_ros.slam.odometry_model import odometry_covariance
from tccm_ros.slam.se2 import between, compose
from tccm_ros.slam.wall_slam import LivePose


class LivePosePublisher:
    """Publishes `pose`, ``~/map_to_odom`` and map -> odom on /tf.

    Parameters
    ----------
    node, types, config
        The node, its message classes, and groups `frames`, `tf` and `odometry`.
    intake
        Of the node: calls back when /tf is due.

    Attributes
    ----------
    map_frame, odom_frame
        Names of the two frames; the second follows the odometry.
    is_localised
        Whether the place of this session in a map that was loaded is known.
    """

    def __init__(self, node: Node, types: MessageTypes, config: Config, intake: Intake):
        self._types, self._config = types, config
        self.map_frame = config.frames.map_name
        self.odom_frame = config.frames.odom_name
        self._live: LivePose | None = None
        self._newest_ns = -1
        self._keyframe: tuple[Float64, Float64] | None = None
        self._T_map_front = np.zeros(3)
        self.is_localised = True
        self._pose = node.create_publisher(
            message_class("geometry_msgs/msg/PoseWithCovarianceStamped"), "pose", 10
        )
        self._transform = node.create_publisher(
            message_class("geometry_msgs/msg/TransformStamped"), "~/map_to_odom", 10
        )
        self._tf = self._start_tf(node, intake)

    def _start_tf(self, node: Node, intake: Intake) -> TfPublisher | None:
        if not self._config.tf.publish:
            return None
        if not has_tf2_msgs():
            node.get_logger().info(
                "tf2_msgs is not installed: map -> odom is on ~/map_to_odom alone"
            )
            return None
        return TfPublisher(node, intake, self._config.tf, self.transform)

    def forget(self, *, is_localised: bool = True) -> None:
        """Publish nothing until the next scan, and before this session is found in its map."""
        self.is_localised = is_localised
        self._live, self._keyframe, self._newest_ns = None, None, -1
        self._T_map_front = np.zeros(3)

    def note_scan(self, stamp_ns: int) -> None:
        """Note the stamp of a scan that has come in.

        While a long step runs, map -> odom is still stamped with the newest scan. A scan that lies
        ahead of all others by more than a clock jump does not count.
        """
        ahead_ns = stamp_ns - max(self._newest_ns, self._live.stamp_ns if self._live else -1)
        if self._live is not None and 0 < ahead_ns < self._config.clock_jump * 1e9:
            self._newest_ns = stamp_ns

    def show(self, live: LivePose) -> None:
        """Publish the pose of a scan; nothing before it is known in a map that was loaded."""
        live = live._replace(
            pose=compose(self._T_map_front, live.pose),
            map_odom=compose(self._T_map_front, live.map_odom),
        )
        self._live = live if self.is_localised else None
        if self._live is None:
            return
        if self._pose.get_subscription_count():
            cov = live_covariance(live, self._keyframe, self._config)
            T = spatial(live.pose)
            self._pose.publish(
                pose_covariance_message(self._types, live.stamp_ns, self.map_frame, T, cov)
            )
        if self._transform.get_subscription_count():
            self._transform.publish(self.transform())

    def note_solution(self, solved: Solved) -> None:
        """Take over where a solution puts this session, and how well it knows the newest keyframe.

        The next pose is corrected by it: map -> odom jumps, as REP-105 allows.
        """
        self.is_localised = solved.is_localised
        self._T_map_front = solved.T_map_front
        self._keyframe = solved.keyframe

    def transform(self) -> Any | None:
        """Return map -> odom as a geometry_msgs/TransformStamped, None before the first scan."""
        live = self._live
        if live is None:
            return None
        stamp_ns = max(live.stamp_ns, self._newest_ns)
        stamp_ns += round(self._config.tf.transform_tolerance * 1e9)
        sample = TransformSample(
            stamp_ns, self.map_frame, self.odom_frame, spatial(live.map_odom), False
        )
        return transform_message(self._types, sample)


def live_covariance(
    live: LivePose, keyframe: tuple[Float64, Float64] | None, config: Config
) -> Float64:
    """Return the covariance float64 (3, 3) of the live pose: (x, y, yaw) in map.

    Parameters
    ----------
    live
        The live pose.
    keyframe
        Pose and covariance (in its own frame) of the newest solved keyframe; None: the origin,
        which is known by definition.
    config
        Group `odometry`: the motion since that keyframe is trusted as odometry is, at least.
    """
    start, cov = keyframe if keyframe is not None else (np.zeros(3), np.zeros((3, 3)))
    delta = between(start, live.pose)
    # The keyframe's error, seen from the live pose: its yaw error acts over the way since then.
    lever = np.eye(3)
    lever[:2, 2] = (-delta[1], delta[0])
    R_map_keyframe = np.eye(3)
    R_map_keyframe[:2, :2] = _rotation(start[2])
    end = np.eye(3)
    end[:2, :2] = _rotation(live.pose[2])
    known = R_map_keyframe @ lever @ cov @ lever.T @ R_map_keyframe.T
    result: Float64 = known + end @ odometry_covariance(delta, config.odometry) @ end.T
    return result


def _rotation(yaw: float) -> Float64:
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
