"""Records from the numbers of a message, checked: the same rules for messages and bare CDR bytes.

Content that no processor can use raises `MessageError`; callers count it as a drop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tccm_ros.arrays import Float32, Float64
from tccm_ros.errors import MessageError
from tccm_ros.records.cycle import ObjectBoxes, SurfaceCloud, ViewIntervals
from tccm_ros.records.sensors import (
    Imu,
    JointSample,
    Odometry,
    RobotDescription,
    Scan,
    TransformSample,
)

Vector = Sequence[float]
"""A few numbers: a translation, a quaternion."""

Record = (
    Scan
    | JointSample
    | Imu
    | Odometry
    | TransformSample
    | RobotDescription
    | SurfaceCloud
    | ViewIntervals
    | ObjectBoxes
)

MAX_SCAN_S = 60.0
"""Longest duration of one scan that is believed, s. Chosen: the slowest lasers take a few
seconds."""


def stamp_ns_from_message(stamp: Any) -> int:
    """Return a builtin_interfaces/Time in ns."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def frame_name(name: str) -> str:
    """Return a frame name without the leading slash that bags converted from ROS 1 have."""
    return str(name).lstrip("/")


def scan_record(stamp_ns: int, frame_id: str, numbers: Sequence[float], ranges: Float32) -> Scan:
    """Return the scan of the numbers of a sensor_msgs/LaserScan.

    Parameters
    ----------
    stamp_ns, frame_id
        Header.
    numbers
        angle_min, angle_max, angle_increment, time_increment, scan_time, range_min, range_max.
    ranges
        float32 (N,). The record's cannot be written, whether they come from a bag or from a
        message, so that kernels are compiled for one kind of array.
    """
    angle_min, _, angle_increment, time_increment, _, range_min, range_max = map(float, numbers)
    finite = (angle_min, angle_increment, time_increment, range_min)
    if not all(map(math.isfinite, finite)) or math.isnan(range_max):
        raise MessageError("scan has angles, times or limits that are not numbers")
    if not abs(time_increment) * len(ranges) <= MAX_SCAN_S:
        raise MessageError(
            f"scan has {len(ranges)} beams with {time_increment:g} s between two, "
            f"expected at most {MAX_SCAN_S:g} s in all"
        )
    ranges = ranges.view()
    ranges.flags.writeable = False
    return Scan(
        stamp_ns=stamp_ns,
        frame_id=frame_name(frame_id),
        angle_min=angle_min,
        angle_increment=angle_increment,
        time_increment=time_increment,
        range_min=range_min,
        range_max=range_max,
        ranges=ranges,
    )


def imu_record(
    stamp_ns: int, frame_id: str, rates: Sequence[float], acceleration: Sequence[float]
) -> Imu:
    """Return the record of a sensor_msgs/Imu.

    Parameters
    ----------
    stamp_ns, frame_id
        Header.
    rates
        Angular velocity about x, y and z, rad/s, and the first element of its covariance: -1 where
        there is no angular velocity.
    acceleration
        The same of the linear acceleration, m/s2. One that is not finite is taken as none.

    Raises
    ------
    MessageError
        Where there is no angular velocity, or one that is not finite.
    """
    if rates[3] == -1.0:
        raise MessageError("imu measures no angular velocity (its covariance begins with -1)")
    if not all(map(math.isfinite, rates[:3])):
        raise MessageError("imu has an angular velocity that is not finite")
    is_measured = acceleration[3] != -1.0 and all(map(math.isfinite, acceleration[:3]))
    return Imu(
        stamp_ns,
        frame_id,
        np.array(rates[:3], np.float64),
        np.array(acceleration[:3], np.float64) if is_measured else None,
    )


def joint_sample(stamp_ns: int, names: Sequence[str], positions: Float64) -> JointSample:
    """Return the joint sample of a sensor_msgs/JointState.

    Parameters
    ----------
    stamp_ns
        Stamp of the header.
    names
        Joints; without positions they are left out.
    positions
        float64 (len(names),), rad or m; joints whose position is not finite are left out.

    Raises
    ------
    MessageError
        Where there are positions, but not one for each name.
    """
    if len(positions) == 0:
        names = ()
    if len(positions) != len(names):
        raise MessageError(f"joint state has {len(names)} names and {len(positions)} positions")
    if not all(map(math.isfinite, positions.tolist())):
        known = np.isfinite(positions)
        names = [name for name, k in zip(names, known) if k]
        positions = positions[known]
    return JointSample(stamp_ns, tuple(names), positions)


def transform_sample(
    stamp_ns: int, frames: tuple[str, str], t: Vector, q: Vector, is_static: bool
) -> TransformSample:
    """Return the sample of a geometry_msgs/TransformStamped.

    Parameters
    ----------
    stamp_ns
        Stamp of the header.
    frames
        Parent and child.
    t, q
        Translation (x, y, z), m, and quaternion (x, y, z, w) of T_parent_child.
    is_static
        Whether it came on /tf_static.

    Raises
    ------
    MessageError
        As `pose_matrix` does.
    """
    parent, child = map(frame_name, frames)
    T = pose_matrix(t, q, f"transform {parent} -> {child}")
    return TransformSample(stamp_ns, parent, child, T, is_static)


def pose_matrix(t: Vector, q: Vector, what: str) -> Float64:
    """Return T float64 (4, 4) of a translation and a quaternion.

    Parameters
    ----------
    t
        (3,), x y z, m.
    q
        (4,), x y z w; it is normalised.
    what
        Subject of the error's message.

    Raises
    ------
    MessageError
        Where a number is not finite, or the quaternion's length is not within 1e-6 and 1e6.
    """
    if not all(map(math.isfinite, (*q, *t))):
        raise MessageError(f"{what} has a pose that is not finite")
    norm = math.hypot(*q)
    if not 1e-6 < norm < 1e6:
        raise MessageError(f"{what} has a quaternion {tuple(q)} that is no rotation")
    return _matrix(t, [value / norm for value in q])


def _matrix(t: Vector, unit_q: Vector) -> Float64:
    """Return T (4, 4); written out because scipy takes ten times as long for a single pose."""
    x, y, z, w = unit_q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
