"""Live pose of the robot: map -> odom, the pose with covariance, and frames of surfaces."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.nodes.ros_types import TF_MESSAGE, has_tf2_msgs, message_class
from tccm_ros.records import TransformSample
from tccm_ros.ros.output_messages import pose_covariance_message
from tccm_ros.ros.types import MessageTypes
from tccm_ros.ros.writing import transform_message
from tccm_ros.scene.scene import Scene, frames_of_surfaces
from tccm_ros.slam.live_estimate import LivePose


class LivePosePublisher:
    """Publishes `pose`, ``~/map_to_odom`` and map -> odom on /tf.

    Parameters
    ----------
    node, types, config
        The node, its message classes, and groups `frames` and `tf`.
    intake
        Intake of the node, which runs the timer of /tf.
    robot
        Its odometry may be relative to a nearby origin (`T_near_odom`).

    Attributes
    ----------
    map_frame, odom_frame
        Names of the two frames; the second follows the odometry.
    is_localised
        Whether this session is localised in the loaded map.
    """

    def __init__(
        self, node: Node, types: MessageTypes, config: Config, intake: Intake, robot: SharedRobot
    ):
        self._types, self._config, self._robot = types, config, robot
        # An external localisation publishes map -> odom itself.
        self._is_ours = not config.localisation.is_external
        self.map_frame = config.frames.map_name
        self.odom_frame = config.frames.odom_name
        self._live: LivePose | None = None
        self._newest_ns = -1
        self.is_localised = True
        self._surface_frames: tuple[Any, ...] = ()
        self._pose = node.create_publisher(
            message_class("geometry_msgs/msg/PoseWithCovarianceStamped"), "pose", 10
        )
        self._transform = node.create_publisher(
            message_class("geometry_msgs/msg/TransformStamped"), "~/map_to_odom", 10
        )
        if config.tf.publish and has_tf2_msgs():
            self._tf_message = message_class(TF_MESSAGE)
            self._tf = node.create_publisher(self._tf_message, "/tf", QoSProfile(depth=100))
            self._tf_rate = config.tf.rate
            self._tf_timer = node.create_timer(
                1.0 / self._tf_rate, self._publish_tf, callback_group=intake.group
            )
            intake.add_timer(self._tf_timer)
        elif config.tf.publish:
            node.get_logger().info(
                "tf2_msgs is not installed: map -> odom is on ~/map_to_odom alone"
            )

    def forget(self, *, is_localised: bool = True) -> None:
        """Publish nothing until the next scan, nor before the session is localised in its map."""
        self.is_localised = is_localised
        self._live, self._newest_ns = None, -1
        self._surface_frames = ()

    def show_surfaces(self, scene: Scene) -> None:
        """Use the surfaces of a new solution as frames, if `tf.surfaces` is set."""
        frames: list[TransformSample] = []
        if self._config.tf.surfaces:
            surfaces = [known.surface for known in scene.surfaces]
            prefix = self._config.frames.prefix
            frames = frames_of_surfaces(surfaces, scene.stamp_ns, scene.frame_id, prefix)
        self._surface_frames = tuple(transform_message(self._types, frame) for frame in frames)

    def note_scan(self, stamp_ns: int) -> None:
        """Note the stamp of a scan that has arrived.

        It becomes the stamp of map -> odom while a long step runs. A scan ahead of all others by
        more than a clock jump is ignored.
        """
        ahead_ns = stamp_ns - max(self._newest_ns, self._live.stamp_ns if self._live else -1)
        if self._live is not None and 0 < ahead_ns < self._config.clock_jump * 1e9:
            self._newest_ns = stamp_ns

    def show(self, live: LivePose, cov: Float64) -> None:
        """Publish the pose at a scan, once the session is localised in its map.

        Parameters
        ----------
        live
            The live estimate.
        cov
            float64 (3, 3) of (x, y, yaw) in map.
        """
        self.correct(live)
        if self._live is None:
            return
        if self._pose.get_subscription_count():
            where = live.stamp_ns, self.map_frame, live.T_map_base
            self._pose.publish(pose_covariance_message(self._types, *where, cov))
        if self._is_ours and self._transform.get_subscription_count():
            self._transform.publish(self.transform())

    def correct(self, live: LivePose) -> None:
        """Replace the estimate at the same stamp; map -> odom may jump (REP-105)."""
        self._live = live if self.is_localised and live.stamp_ns >= 0 else None

    def _publish_tf(self) -> None:
        if self._tf_rate != self._config.tf.rate:
            self._tf_rate = self._config.tf.rate
            self._tf_timer.timer_period_ns = round(1e9 / self._tf_rate)
        transforms = self._transforms()
        if transforms:
            self._tf.publish(self._tf_message(transforms=transforms))

    def _transforms(self) -> list[Any]:
        """Return map -> odom, then the frames of surfaces with the same stamp.

        With the older stamp of its solution, tf would place a frame relative to a past robot pose.
        """
        first = self.transform()
        if first is None:
            return []
        frames = self._surface_frames if self._config.tf.surfaces else ()
        for frame in frames:
            frame.header.stamp = first.header.stamp
        return [first, *frames] if self._is_ours else list(frames)

    def transform(self) -> Any | None:
        """Return map -> odom as a geometry_msgs/TransformStamped; None before the first scan."""
        live = self._live
        if live is None:
            return None
        stamp_ns = max(live.stamp_ns, self._newest_ns)
        stamp_ns += round(self._config.tf.transform_tolerance * 1e9)
        T = spatial(live.map_odom) @ self._robot.robot.motion.odometry.T_near_odom
        sample = TransformSample(stamp_ns, self.map_frame, self.odom_frame, T, False)
        return transform_message(self._types, sample)
