"""Build and check records from message fields; ROS messages and raw CDR use the same code.

Content that no processor can use raises `MessageError`; callers count the message as dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tccm_ros.arrays import Bool, Float32, Float64
from tccm_ros.errors import MessageError
from tccm_ros.records.sensors import Imu, JointSample, Scan, TransformSample

Vector = Sequence[float]
"""Sequence of floats: a translation or a quaternion."""

SCAN_NUMBERS = (
    "angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min",
    "range_max",
)  # fmt: skip
"""Names of the numbers of a sensor_msgs/LaserScan, in the order of its definition."""

MAX_SCAN_S = 60.0
"""Longest plausible duration of one scan, s. Chosen: the slowest lasers take a few seconds."""


ANGLE_SLACK_BEAMS, ANGLE_SLACK = 2.0, 0.01
"""Tolerance between a scan's angles and its number of beams: a number of beams, and a fraction of
the field of view. Drivers count the last beam twice or not at all, and round the increment (the
lidar of a recorded Jackal is off by 1.6 beams)."""

NO_RETURN_SHELL, NO_RETURN_SHELL_M = 0.01, 0.02
"""Drivers encode "no return" as a range within this fraction of range_max, or within this distance
of it, m: cob_sick_s300 writes 4 cm less than 30 m, LMS1xx 1 cm less than 20 m. Gazebo adds
noise."""

NO_RETURN_BEAMS, NO_RETURN_FRACTION = 3, 0.01
"""Minimum number of beams, and minimum fraction of a scan's beams, with one identical range near
range_max for that range to mean "no return". A wall gives equal ranges only by chance and by the
rounding of ranges."""


def stamp_ns_from_message(stamp: Any) -> int:
    """Return a builtin_interfaces/Time in ns."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def pose_from_message(pose: Any, what: str = "a message") -> Float64:
    """Return T float64 (4, 4) of a geometry_msgs/Pose; errors as of `pose_matrix`."""
    p, q = pose.position, pose.orientation
    return pose_matrix((p.x, p.y, p.z), (q.x, q.y, q.z, q.w), what)


def frame_name(name: str) -> str:
    """Return a frame name without the leading slash that bags converted from ROS 1 have."""
    return str(name).lstrip("/")


def scan_record(stamp_ns: int, frame_id: str, numbers: Sequence[float], ranges: Float32) -> Scan:
    """Return the scan with the numbers of a sensor_msgs/LaserScan.

    Parameters
    ----------
    stamp_ns, frame_id
        Header.
    numbers
        The numbers named by `SCAN_NUMBERS`.
    ranges
        float32 (N,). The record's ranges are read-only, whether they come from a bag or from a
        message, so that kernels are compiled for one array type. Ranges that mean "no return" are
        +inf in the record (REP-117).

    Raises
    ------
    MessageError
        Where a number is not finite (range_max may be infinite), where the angles contradict each
        other or the number of beams, and where the time between beams makes the scan longer than
        `MAX_SCAN_S`.
    """
    angle_min, angle_max, angle_increment, time_increment, _, range_min, range_max = map(
        float, numbers
    )
    needed = (angle_min, angle_max, angle_increment, time_increment, range_min)
    if not all(map(math.isfinite, needed)) or math.isnan(range_max):
        raise MessageError(f"scan has {_not_numbers(numbers)}, expected finite numbers")
    if not abs(time_increment) * len(ranges) <= MAX_SCAN_S:
        raise MessageError(
            f"scan has {len(ranges)} beams with {time_increment:g} s between two, "
            f"expected at most {MAX_SCAN_S:g} s in all"
        )
    _check_angles(len(ranges), angle_min, angle_max, angle_increment)
    no_returns = _no_returns(ranges, range_max)
    ranges = (
        ranges.view() if no_returns is None else np.where(no_returns, np.float32(np.inf), ranges)
    )
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
        no_returns=0 if no_returns is None else int(np.count_nonzero(no_returns)),
    )


def _not_numbers(numbers: Sequence[float]) -> str:
    """Return the names and values of a scan's numbers that are not finite, as text."""
    pairs = zip(SCAN_NUMBERS, numbers, strict=True)
    return ", ".join(f"{name} {value:g}" for name, value in pairs if not math.isfinite(value))


def _check_angles(count: int, angle_min: float, angle_max: float, increment: float) -> None:
    """Raise MessageError where the angles of a scan contradict each other or its beams.

    `angle_max` may be 2 pi away: some drivers wrap it into (-pi, pi].
    """
    if count < 2:
        return
    swept, span = (count - 1) * increment, angle_max - angle_min
    slack = max(ANGLE_SLACK_BEAMS * abs(increment), ANGLE_SLACK * abs(span))
    misfit = abs(swept - span)
    is_wrapped = abs(misfit - 2.0 * math.pi) <= slack < abs(swept + span)
    if increment == 0.0 or (misfit > slack and not is_wrapped):
        raise MessageError(
            f"scan of {count} beams has an angle_increment of {increment:.4g}, but goes from "
            f"angle_min {angle_min:.4g} to angle_max {angle_max:.4g}"
        )
    if abs(swept) > 2.0 * math.pi + slack:
        raise MessageError(
            f"scan covers {swept:.4g} rad by its angle_increment, expected at most 6.28; are "
            "its angles in degrees?"
        )


def _no_returns(ranges: Float32, range_max: float) -> Bool | None:
    """Return a mask of the beams whose range encodes "no return"; None if there is none.

    A range of exactly `range_max` is a no-return. Where many beams have the same range near
    `range_max`, or a range beyond it, all beams near it are no-returns: noise was added to some.
    """
    if not 0.0 < range_max < math.inf:
        return None
    shell = max(NO_RETURN_SHELL * range_max, NO_RETURN_SHELL_M)
    is_near = np.abs(ranges - np.float32(range_max)) <= shell
    near = ranges[is_near]
    if not len(near):
        return None
    many = max(NO_RETURN_BEAMS, NO_RETURN_FRACTION * len(ranges))
    if len(near) >= many:
        beyond = np.count_nonzero(near >= np.float32(range_max))
        if max(beyond, np.unique(near, return_counts=True)[1].max()) >= many:
            return np.asarray(is_near)
    is_at_max = ranges == np.float32(range_max)
    return is_at_max if is_at_max.any() else None


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
        the IMU has no gyroscope.
    acceleration
        The same for the linear acceleration, m/s2; a value that is not finite becomes None.

    Raises
    ------
    MessageError
        Where the angular velocity is missing or not finite.
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
        Joint names; ignored where the message has no positions.
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
        Whether the transform came on /tf_static.

    Raises
    ------
    MessageError
        As `pose_matrix` does.
    """
    parent, child = map(frame_name, frames)
    T = pose_matrix(t, q, f"transform {parent} -> {child}")
    return TransformSample(stamp_ns, parent, child, T, is_static)


def transform_samples(
    rows: Iterable[tuple[int, tuple[str, str], Vector, Vector]], is_static: bool
) -> list[TransformSample]:
    """Return the samples of a tf2_msgs/TFMessage; the matrix of an invalid transform is NaN.

    One invalid transform does not invalidate the message: a publisher sends all joints at once,
    including a gripper finger without an encoder.

    Parameters
    ----------
    rows, is_static
        Arguments of `transform_sample`.

    Raises
    ------
    MessageError
        Where no transform of the message is valid.
    """
    samples, faults = [], []
    for stamp_ns, frames, t, q in rows:
        try:
            samples.append(transform_sample(stamp_ns, frames, t, q, is_static))
        except MessageError as error:
            parent, child = map(frame_name, frames)
            nothing = np.full((4, 4), np.nan)
            samples.append(TransformSample(stamp_ns, parent, child, nothing, is_static))
            faults.append(error)
    if faults and len(faults) == len(samples):
        raise faults[0]
    return samples


def pose_matrix(t: Vector, q: Vector, what: str) -> Float64:
    """Return T float64 (4, 4) of a translation and a quaternion.

    Parameters
    ----------
    t
        (3,), x y z, m.
    q
        (4,), x y z w; it is normalised.
    what
        Subject of the error message.

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
