"""Convert records of sensors to messages: what a robot's drivers send."""

from __future__ import annotations

import io
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tccm_ros.errors import MessageError
from tccm_ros.records import (
    CameraImage,
    CameraInfo,
    DepthImage,
    Imu,
    JointSample,
    Odometry,
    PointCloud,
    RobotDescription,
)
from tccm_ros.ros.pointcloud import cloud_message
from tccm_ros.ros.types import (
    MessageTypes,
    header_message,
    pose_message,
    vector_message,
)

MIN_DEPTH, MAX_DEPTH, QUANTISATION = 0.1, 10.0, 100.0
"""Quantised depths are between these, m; `depth_max` and `depth_quantization` are the defaults of
compressed_depth_image_transport."""

HEADER = struct.Struct("<iff")
"""Header of a compressed depth image: format, and A and B of the quantisation (0 for none)."""


def depth_image_message(types: MessageTypes, image: DepthImage) -> Any:
    """Return a sensor_msgs/Image."""
    height, width = image.depth.shape
    pixels = np.ascontiguousarray(image.depth)
    return types.make(
        "sensor_msgs/msg/Image",
        header=header_message(types, image.stamp_ns, image.frame_id),
        height=height,
        width=width,
        encoding=image.encoding,
        is_bigendian=0,
        step=width * pixels.itemsize,
        data=types.array("u1", pixels.view(np.uint8).ravel()),
    )


def compressed_depth_message(types: MessageTypes, image: DepthImage) -> Any:
    """Return a sensor_msgs/CompressedImage of image_transport's compressedDepth, as PNG."""
    text, data = write_compressed_depth(image.depth)
    return types.make(
        "sensor_msgs/msg/CompressedImage",
        header=header_message(types, image.stamp_ns, image.frame_id),
        format=text,
        data=types.array("u1", np.frombuffer(data, np.uint8)),
    )


def camera_image_message(types: MessageTypes, image: CameraImage) -> Any:
    """Return a sensor_msgs/CompressedImage of a compressed picture, else a sensor_msgs/Image."""
    header = header_message(types, image.stamp_ns, image.frame_id)
    data = types.array("u1", image.data)
    if image.encoding == "compressed":
        kind = "png" if bytes(image.data[:4]) == b"\x89PNG" else "jpeg"
        return types.make(
            "sensor_msgs/msg/CompressedImage", header=header, format=f"rgb8; {kind}", data=data
        )
    width, height = image.size
    return types.make(
        "sensor_msgs/msg/Image",
        header=header,
        height=height,
        width=width,
        encoding=image.encoding,
        is_bigendian=0,
        step=len(image.data) // height,
        data=data,
    )


def camera_info_message(types: MessageTypes, camera: CameraInfo) -> Any:
    """Return a sensor_msgs/CameraInfo."""
    x, y, width, height = camera.region
    return types.make(
        "sensor_msgs/msg/CameraInfo",
        header=header_message(types, camera.stamp_ns, camera.frame_id),
        height=camera.height,
        width=camera.width,
        distortion_model=camera.model,
        d=types.array("f8", camera.D),
        k=np.asarray(camera.K, np.float64).ravel(),
        r=np.eye(3).ravel(),
        p=np.asarray(camera.P, np.float64).ravel(),
        binning_x=camera.binning[0],
        binning_y=camera.binning[1],
        roi=types.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=x,
            y_offset=y,
            height=height,
            width=width,
            do_rectify=False,
        ),
    )


def point_cloud_message(types: MessageTypes, cloud: PointCloud) -> Any:
    """Return a sensor_msgs/PointCloud2 with fields x y z and, if the points have times, t (ns).

    Raises
    ------
    MessageError
        If a point's time is before the stamp or more than 4 s after it.
    """
    layout = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if cloud.since_ns is not None:
        layout.append(("t", "<u4"))
    rows = np.zeros(len(cloud.points), layout)
    for k, name in enumerate("xyz"):
        rows[name] = cloud.points[:, k]
    if cloud.since_ns is not None:
        if len(rows) and not 0 <= cloud.since_ns.min() <= cloud.since_ns.max() < 2**32:
            raise MessageError("point cloud has times outside 0 to 4.29 s after its stamp")
        rows["t"] = cloud.since_ns
    return cloud_message(types, cloud.stamp_ns, cloud.frame_id, rows)


def joint_sample_message(types: MessageTypes, sample: JointSample) -> Any:
    """Return a sensor_msgs/JointState with names and positions."""
    return types.make(
        "sensor_msgs/msg/JointState",
        header=header_message(types, sample.stamp_ns, ""),
        name=list(sample.names),
        position=types.array("f8", sample.positions),
    )


def odometry_message(types: MessageTypes, odometry: Odometry) -> Any:
    """Return a nav_msgs/Odometry with zero twist and covariances."""
    pose = types.make(
        "geometry_msgs/msg/PoseWithCovariance", pose=pose_message(types, odometry.T_odom_base)
    )
    return types.make(
        "nav_msgs/msg/Odometry",
        header=header_message(types, odometry.stamp_ns, odometry.frame_id),
        child_frame_id=odometry.child_frame_id,
        pose=pose,
    )


def imu_message(types: MessageTypes, imu: Imu) -> Any:
    """Return a sensor_msgs/Imu; the covariance of a quantity not measured begins with -1."""
    unknown, force = np.array([-1.0, *[0.0] * 8]), imu.acceleration
    return types.make(
        "sensor_msgs/msg/Imu",
        header=header_message(types, imu.stamp_ns, imu.frame_id),
        angular_velocity=vector_message(types, imu.angular_velocity),
        linear_acceleration=vector_message(types, np.zeros(3) if force is None else force),
        orientation_covariance=unknown,
        linear_acceleration_covariance=unknown.copy() if force is None else np.zeros(9),
    )


def robot_description_message(types: MessageTypes, description: RobotDescription) -> Any:
    """Return a std_msgs/String with the URDF."""
    return types.make("std_msgs/msg/String", data=description.urdf)


def write_compressed_depth(depth: NDArray[Any]) -> tuple[str, bytes]:
    """Return format and data of a compressed depth image, as PNG.

    Parameters
    ----------
    depth
        uint16 (H, W), mm, or float32 (H, W), m; there, depths above `MAX_DEPTH` are left out.
    """
    a = b = 0.0
    numbers = depth
    if depth.dtype != np.uint16:
        a = QUANTISATION * (QUANTISATION + 1.0)
        b = 1.0 - a / MAX_DEPTH
        known = np.isfinite(depth) & (depth > MIN_DEPTH) & (depth < MAX_DEPTH)
        numbers = np.where(known, a / np.where(known, depth, 1.0) + b, 0.0)
        numbers = np.clip(np.rint(numbers), 0, 65535).astype(np.uint16)
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(numbers)).save(stream, "PNG")
    encoding = "16UC1" if depth.dtype == np.uint16 else "32FC1"
    return f"{encoding}; compressedDepth png", HEADER.pack(0, a, b) + stream.getvalue()
