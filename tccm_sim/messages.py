"""Write records to a bag as messages, by the type of the record."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tccm_ros.bags.writer import BagWriter
from tccm_ros.records import (
    CameraImage,
    CameraInfo,
    DepthImage,
    Imu,
    JointSample,
    Odometry,
    PointCloud,
    RobotDescription,
    Scan,
    TransformSample,
)
from tccm_ros.ros.writing import scan_message, transforms_message
from tccm_sim.sensor_messages import (
    camera_image_message,
    camera_info_message,
    compressed_depth_message,
    imu_message,
    joint_sample_message,
    odometry_message,
    point_cloud_message,
    robot_description_message,
)

COMPRESSED = "sensor_msgs/msg/CompressedImage"

WRITERS: dict[type, tuple[str, Callable[..., Any]]] = {
    JointSample: ("sensor_msgs/msg/JointState", joint_sample_message),
    Imu: ("sensor_msgs/msg/Imu", imu_message),
    Odometry: ("nav_msgs/msg/Odometry", odometry_message),
    RobotDescription: ("std_msgs/msg/String", robot_description_message),
    CameraInfo: ("sensor_msgs/msg/CameraInfo", camera_info_message),
    CameraImage: (COMPRESSED, camera_image_message),
    DepthImage: (COMPRESSED, compressed_depth_message),
    PointCloud: ("sensor_msgs/msg/PointCloud2", point_cloud_message),
    Scan: ("sensor_msgs/msg/LaserScan", scan_message),
    TransformSample: (
        "tf2_msgs/msg/TFMessage",
        lambda types, *samples: transforms_message(types, samples),
    ),
}
"""Message type and writer by type of record."""


def write_records(bag: BagWriter, topic: str, log_ns: int, *records: object, **fields: Any) -> None:
    """Write a message.

    Parameters
    ----------
    bag, topic, log_ns
        Where and when, ns.
    records
        The record, or the transforms of one message.
    fields
        Further fields of the message, as ``scan_time``.
    """
    msgtype, message = WRITERS[type(records[0])]
    bag.write(topic, msgtype, log_ns, message(bag.types, *records, **fields))
