"""Convert messages to records, for rosidl and rosbags message classes.

Messages are read by duck typing, so that live nodes (rosidl classes) and bags (rosbags typestore)
use the same code. Readers raise `MessageError` if no processor can use the content; callers count
these as drops.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float32
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.cdr.reading import read_imu, read_joint_sample, read_odometry, read_transforms
from tccm_ros.errors import MessageError
from tccm_ros.records import (
    Imu,
    JointSample,
    ObjectBoxes,
    Odometry,
    PoseCovariance,
    RobotDescription,
    SensorKind,
    SurfaceCloud,
    TransformSample,
    ViewIntervals,
)
from tccm_ros.records.building import (
    frame_name,
    imu_record,
    joint_sample,
    pose_from_message,
    stamp_ns_from_message,
    transform_samples,
)
from tccm_ros.ros.pointcloud import (
    CORNER_ROW,
    HIT_ROW,
    SURFACE_ROW,
    VIEW_ROW,
    VIEWPOINT_ROW,
    cloud_rows,
)
from tccm_ros.sensors.registry import default_streams


def joint_sample_from_message(message: Any) -> JointSample:
    """Return the positions of a sensor_msgs/JointState, without joints whose position is nan.

    A message without positions (velocities or efforts only) gives an empty sample.

    Raises
    ------
    MessageError
        If there are positions, but not one for each name.
    """
    positions = np.frombuffer(message.position, np.float64)
    return joint_sample(stamp_ns_from_message(message.header.stamp), message.name, positions)


def odometry_from_message(message: Any) -> Odometry:
    """Return the pose of a nav_msgs/Odometry.

    Raises
    ------
    MessageError
        If the pose is not finite or its quaternion is zero.
    """
    return Odometry(
        stamp_ns_from_message(message.header.stamp),
        frame_name(message.header.frame_id),
        frame_name(message.child_frame_id),
        pose_from_message(message.pose.pose, "odometry"),
    )


def imu_from_message(message: Any) -> Imu:
    """Return the angular velocity and the acceleration of a sensor_msgs/Imu.

    Raises
    ------
    MessageError
        If the angular velocity is not finite, or marked as absent.
    """
    rate, force = message.angular_velocity, message.linear_acceleration
    return imu_record(
        stamp_ns_from_message(message.header.stamp),
        frame_name(message.header.frame_id),
        (rate.x, rate.y, rate.z, float(message.angular_velocity_covariance[0])),
        (force.x, force.y, force.z, float(message.linear_acceleration_covariance[0])),
    )


def pose_covariance_from_message(message: Any) -> PoseCovariance:
    """Return the covariance of a geometry_msgs/PoseWithCovarianceStamped.

    Raises
    ------
    MessageError
        If that of x, y and yaw is not finite and positive definite.
    """
    planar = np.ix_((0, 1, 5), (0, 1, 5))
    cov = np.array(message.pose.covariance, np.float64).reshape(6, 6)[planar]
    cov = 0.5 * (cov + cov.T)
    if not np.isfinite(cov).all() or np.linalg.eigvalsh(cov)[0] <= 0.0:
        raise MessageError("external_pose has no covariance of x, y and yaw")
    stamp_ns = stamp_ns_from_message(message.header.stamp)
    return PoseCovariance(stamp_ns, frame_name(message.header.frame_id), cov)


def transforms_from_message(message: Any, *, is_static: bool = False) -> list[TransformSample]:
    """Return the transforms of a tf2_msgs/TFMessage.

    Raises
    ------
    MessageError
        If no transform is finite with a nonzero quaternion.
    """
    return transform_samples(map(_transform_row, message.transforms), is_static)


def robot_description_from_message(message: Any) -> RobotDescription:
    """Return the URDF of a std_msgs/String."""
    return RobotDescription(str(message.data))


def surface_cloud_from_message(message: Any) -> SurfaceCloud:
    """Return the surface message of a sensor_msgs/PointCloud2 with fields x y z surface.

    The fields vp_x vp_y vp_z sensor are optional; a cloud has one viewpoint, taken from its first
    row.

    Raises
    ------
    MessageError
        If fields differ, sizes are inconsistent, or points are not finite.
    """
    has_viewpoint = "vp_x" in {field.name for field in message.fields}
    rows = cloud_rows(message, VIEWPOINT_ROW if has_viewpoint else SURFACE_ROW)
    points = _float_columns(rows, ("x", "y", "z"))
    if not np.isfinite(points).all():
        raise MessageError("surface cloud has points that are not finite")
    stamp = stamp_ns_from_message(message.header.stamp)
    surface = np.ascontiguousarray(rows["surface"])
    frame = frame_name(message.header.frame_id)
    if not has_viewpoint or not len(rows):
        return SurfaceCloud(stamp, frame, points, surface)
    viewpoint = _float_columns(rows[:1], ("vp_x", "vp_y", "vp_z"))[0]
    number = int(rows["sensor"][0])
    if not np.isfinite(viewpoint).all() or number not in set(SensorKind):
        raise MessageError(f"surface cloud has no viewpoint of a known sensor, found {number}")
    return SurfaceCloud(stamp, frame, points, surface, viewpoint, SensorKind(number))


def view_from_message(message: Any) -> ViewIntervals:
    """Return the free intervals of a sensor_msgs/PointCloud2 with fields x y z_low z_high.

    Rows with a nonzero field is_hit, which is optional, are returned as hits of beams.

    Raises
    ------
    MessageError
        If fields differ, sizes are inconsistent, or values are nan.
    """
    has_hits = any(field.name == "is_hit" for field in message.fields)
    cloud = cloud_rows(message, HIT_ROW if has_hits else VIEW_ROW)
    rows = _float_columns(cloud, VIEW_ROW.names or ())
    if np.isnan(rows).any():
        raise MessageError("view has intervals that are not numbers")
    is_hit = cloud["is_hit"] != 0 if has_hits else np.zeros(len(rows), np.bool_)
    if not np.isfinite(rows[is_hit]).all():
        raise MessageError("view has hits that are not finite")
    stamp = stamp_ns_from_message(message.header.stamp)
    frame = frame_name(message.header.frame_id)
    return ViewIntervals(stamp, frame, rows[~is_hit], rows[is_hit])


def object_boxes_from_message(message: Any) -> ObjectBoxes:
    """Return the objects of a sensor_msgs/PointCloud2 with the fields of ~/object_boxes.

    Raises
    ------
    MessageError
        If fields differ, sizes are inconsistent, numbers are not finite, or a footprint has fewer
        than three corners.
    """
    rows = cloud_rows(message, CORNER_ROW)
    if not all(np.isfinite(rows[name]).all() for name in rows.dtype.names or ()):
        raise MessageError("object boxes have numbers that are not finite")
    stamp = stamp_ns_from_message(message.header.stamp)
    frame = frame_name(message.header.frame_id)
    xy = np.stack([rows["x"], rows["y"]], axis=1)
    _, first, corners = np.unique(rows["object"], return_index=True, return_counts=True)
    if (np.diff(rows["object"].astype(np.int64)) < 0).any() or corners.min(initial=3) < 3:
        raise MessageError("object boxes: expected three or more corners an object, by object")
    footprints = tuple(np.split(xy, first[1:])) if len(rows) else ()
    z = np.stack([rows["z"], rows["z_high"]], axis=1)[first]
    return ObjectBoxes(stamp, frame, footprints, z, rows["points"][first])


def _reader(
    message_type: str,
    of_message: Callable[[Any], Any],
    of_bytes: Callable[[bytes], Sequence[Any]] | None = None,
) -> MessageReader:
    """Return the reader of messages with one record each."""
    return MessageReader(message_type, lambda message: (of_message(message),), of_bytes)


READERS: Mapping[str, MessageReader] = {
    "robot_description": _reader("std_msgs/msg/String", robot_description_from_message),
    "joint_states": _reader(
        "sensor_msgs/msg/JointState", joint_sample_from_message, read_joint_sample
    ),
    "odom": _reader("nav_msgs/msg/Odometry", odometry_from_message, read_odometry),
    "imu": _reader("sensor_msgs/msg/Imu", imu_from_message, read_imu),
    "external_pose": _reader(
        "geometry_msgs/msg/PoseWithCovarianceStamped", pose_covariance_from_message
    ),
    "tf": MessageReader("tf2_msgs/msg/TFMessage", transforms_from_message, read_transforms),
    "tf_static": MessageReader(
        "tf2_msgs/msg/TFMessage",
        partial(transforms_from_message, is_static=True),
        partial(read_transforms, is_static=True),
    ),
    **{stream.role: stream.reader for stream in default_streams()},
    "surfaces": _reader("sensor_msgs/msg/PointCloud2", surface_cloud_from_message),
    "view": _reader("sensor_msgs/msg/PointCloud2", view_from_message),
    "object_boxes": _reader("sensor_msgs/msg/PointCloud2", object_boxes_from_message),
}
"""Readers that convert messages to records, by role of the topic."""


def _transform_row(message: Any) -> tuple[Any, ...]:
    t, q = message.transform.translation, message.transform.rotation
    stamp_ns = stamp_ns_from_message(message.header.stamp)
    frames = message.header.frame_id, message.child_frame_id
    return stamp_ns, frames, (t.x, t.y, t.z), (q.x, q.y, q.z, q.w)


def _float_columns(rows: NDArray[Any], names: Sequence[str]) -> Float32:
    """Return float32 columns as (N, len(names)), without change of bits."""
    return np.stack([rows[name] for name in names], axis=1).astype(np.float32, copy=False)
