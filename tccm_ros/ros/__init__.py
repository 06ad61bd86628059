"""Convert records to ROS messages and back, for rosidl and rosbags message classes."""

from tccm_ros.ros.reading import (
    READERS,
    joint_sample_from_message,
    odometry_from_message,
    robot_description_from_message,
    surface_cloud_from_message,
    transforms_from_message,
    view_from_message,
)
from tccm_ros.ros.types import MessageTypes
from tccm_ros.ros.writing import (
    camera_info_message,
    compressed_depth_message,
    depth_image_message,
    joint_sample_message,
    odometry_message,
    point_cloud_message,
    robot_description_message,
    scan_message,
    surface_cloud_message,
    transform_message,
    transforms_message,
    view_message,
)

__all__ = [
    "READERS",
    "MessageTypes",
    "camera_info_message",
    "compressed_depth_message",
    "depth_image_message",
    "joint_sample_from_message",
    "joint_sample_message",
    "odometry_from_message",
    "odometry_message",
    "point_cloud_message",
    "robot_description_from_message",
    "robot_description_message",
    "scan_message",
    "surface_cloud_from_message",
    "surface_cloud_message",
    "transform_message",
    "transforms_from_message",
    "transforms_message",
    "view_from_message",
    "view_message",
]
