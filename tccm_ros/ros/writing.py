"""Convert records to messages, for rosidl and rosbags message classes.

Messages are built by a `MessageTypes` object: rosidl classes in a live node, rosbags' typestore in
a bag.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tccm_ros.errors import MessageError
from tccm_ros.records import (
    CameraImage,
    CameraInfo,
    DepthImage,
    Imu,
    JointSample,
    ObjectBoxes,
    Odometry,
    PointCloud,
    RobotDescription,
    Scan,
    SurfaceCloud,
    TransformSample,
    ViewIntervals,
)
from tccm_ros.ros.pointcloud import (
    CORNER_ROW,
    HIT_ROW,
    SURFACE_ROW,
    VIEW_ROW,
    VIEWPOINT_ROW,
    cloud_message,
)
from tccm_ros.ros.types import (
    MessageTypes,
    header_message,
    pose_message,
    quaternion_message,
    vector_message,
)
from tccm_ros.sensors.compressed_depth import write_compressed_depth


def scan_message(types: MessageTypes, scan: Scan, *, scan_time: float = 0.0) -> Any:
    """Return a sensor_msgs/LaserScan.

    Parameters
    ----------
    types
        Message classes.
    scan
        The scan.
    scan_time
        Time between two scans, s; 0 if unknown.
    """
    return types.make(
        "sensor_msgs/msg/LaserScan",
        header=header_message(types, scan.stamp_ns, scan.frame_id),
        angle_min=float(scan.angle_min),
        angle_max=float(scan.angle_min + scan.angle_increment * max(len(scan.ranges) - 1, 0)),
        angle_increment=float(scan.angle_increment),
        time_increment=float(scan.time_increment),
        scan_time=float(scan_time),
        range_min=float(scan.range_min),
        range_max=float(scan.range_max),
        ranges=types.array("f4", scan.ranges),
    )


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


def transform_message(types: MessageTypes, sample: TransformSample) -> Any:
    """Return a geometry_msgs/TransformStamped."""
    transform = types.make(
        "geometry_msgs/msg/Transform",
        translation=vector_message(types, sample.T_parent_child[:3, 3]),
        rotation=quaternion_message(types, sample.T_parent_child),
    )
    return types.make(
        "geometry_msgs/msg/TransformStamped",
        header=header_message(types, sample.stamp_ns, sample.parent),
        child_frame_id=sample.child,
        transform=transform,
    )


def transforms_message(types: MessageTypes, samples: Sequence[TransformSample]) -> Any:
    """Return a tf2_msgs/TFMessage."""
    transforms = [transform_message(types, sample) for sample in samples]
    return types.make("tf2_msgs/msg/TFMessage", transforms=transforms)


def robot_description_message(types: MessageTypes, description: RobotDescription) -> Any:
    """Return a std_msgs/String with the URDF."""
    return types.make("std_msgs/msg/String", data=description.urdf)


def surface_cloud_message(types: MessageTypes, cloud: SurfaceCloud) -> Any:
    """Return the surface message ~/surfaces, a PointCloud2 (docs/reference/nodes.md)."""
    eye = cloud.viewpoint
    rows = np.zeros(len(cloud.points), SURFACE_ROW if eye is None else VIEWPOINT_ROW)
    for k, name in enumerate("xyz"):
        rows[name] = cloud.points[:, k]
        if eye is not None:
            rows[f"vp_{name}"] = eye[k]
    rows["surface"] = cloud.surface
    if eye is not None:
        rows["sensor"] = cloud.sensor
    return cloud_message(types, cloud.stamp_ns, cloud.frame_id, rows)


def view_message(types: MessageTypes, view: ViewIntervals) -> Any:
    """Return ~/view, a sensor_msgs/PointCloud2 (docs/reference/nodes.md)."""
    passed = len(view.intervals)
    rows = np.zeros(passed + len(view.hits), HIT_ROW if len(view.hits) else VIEW_ROW)
    for k, name in enumerate(VIEW_ROW.names or ()):
        rows[name][:passed] = view.intervals[:, k]
        rows[name][passed:] = view.hits[:, k]
    if len(view.hits):
        rows["is_hit"][passed:] = 1
    return cloud_message(types, view.stamp_ns, view.frame_id, rows)


def object_boxes_message(types: MessageTypes, boxes: ObjectBoxes) -> Any:
    """Return ~/object_boxes, a sensor_msgs/PointCloud2 (docs/reference/nodes.md)."""
    corners = [len(footprint) for footprint in boxes.footprints]
    rows = np.zeros(sum(corners), CORNER_ROW)
    if corners:
        rows["x"], rows["y"] = np.concatenate(boxes.footprints).T
    rows["z"], rows["z_high"] = np.repeat(boxes.z, corners, axis=0).T
    rows["points"] = np.repeat(boxes.points, corners)
    rows["object"] = np.repeat(np.arange(len(corners)), corners)
    return cloud_message(types, boxes.stamp_ns, boxes.frame_id, rows)
