"""Laser scans: their streams, and conversion of ranges to points.

A scan is read from sensor_msgs/LaserScan. A tilting laser maps the surroundings (`TILT_SCAN`), a
level laser the walls (`LEVEL_SCAN`). Beams are selected by REP-117 and by a filter of mixed pixels.
Each beam has the pose at its own time.
"""

import math
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.cdr.reading import read_scan
from tccm_ros.config import Config
from tccm_ros.config.sensors import ScanFilterConfig
from tccm_ros.geometry import inverse, level
from tccm_ros.records import PosedScan, Scan
from tccm_ros.records.building import MAX_SCAN_S, scan_record, stamp_ns_from_message
from tccm_ros.robot import MountKind, Stream
from tccm_ros.sensors.laser_scan_kernels import mark_inside, mark_valid, place_beams, refine_poses
from tccm_ros.sensors.no_returns import NoReturns

NOTHING_SEEN = "nothing seen"
NO_LIMITS = "range_min is not below range_max"
OUT_OF_LIMITS = "no range between range_min and range_max"
LIMITS_TOO_FAR = "range_min is not below scan.max_range: are range_min and range_max millimetres?"
TOO_FAR = "all ranges beyond range_max or scan.max_range: are they millimetres?"
"""Reasons of dropped scans without a hit."""

NO_RETURNS = "ranges at range_max are taken as nothing seen"
"""Remark on scans whose driver encodes "no return" as `range_max`."""


def scan_from_message(message: Any) -> Scan:
    """Return the scan of a sensor_msgs/LaserScan; its ranges may use the memory of the message.

    Raises
    ------
    MessageError
        Where angles or limits are not finite (range_max may be infinite), or where the time
        between beams makes the scan longer than `MAX_SCAN_S`.
    """
    ranges = np.asarray(np.frombuffer(message.ranges, np.float32), np.float32)
    numbers = (
        message.angle_min,
        message.angle_max,
        message.angle_increment,
        message.time_increment,
        message.scan_time,
        message.range_min,
        message.range_max,
    )
    stamp_ns = stamp_ns_from_message(message.header.stamp)
    return scan_record(stamp_ns, message.header.frame_id, numbers, ranges)


def time_span(scan: Scan) -> tuple[int, int]:
    """Return the times of the earliest and the latest beam, ns."""
    stamp_ns, end_ns = scan.stamp_ns, scan.end_ns
    return (stamp_ns, end_ns) if end_ns >= stamp_ns else (end_ns, stamp_ns)


def rejection_reason(scan: Scan, limits: ScanFilterConfig | None = None) -> str | None:
    """Return why a scan is rejected; None if it is not.

    Parameters
    ----------
    scan
        A scan.
    limits
        Limits of the configuration, in addition to the scan's own.
    """
    if len(scan.ranges) == 0:
        return "empty"
    numbers = (scan.angle_min, scan.angle_increment, scan.time_increment)
    if not all(map(math.isfinite, numbers)):
        return "malformed"
    if abs(scan.time_increment) * len(scan.ranges) > MAX_SCAN_S:
        return "malformed"
    return _reason_of_ranges(scan, limits)


def _reason_of_ranges(scan: Scan, limits: ScanFilterConfig | None) -> str | None:
    """Return why a scan has no hit; None if it has one."""
    low, high = scan.range_min, scan.range_max
    if limits is not None:
        low, high = max(low, limits.min_range), min(high, limits.max_range)
    ranges = scan.ranges
    if ((ranges >= low) & (ranges <= high) & (ranges > 0.0)).any():
        return None
    if not scan.range_min < scan.range_max:
        return NO_LIMITS
    if not low < high:
        return LIMITS_TOO_FAR
    seen = ranges[np.isfinite(ranges) & (ranges > 0.0)]
    if not len(seen):
        return NOTHING_SEEN
    return TOO_FAR if (seen > high).all() else OUT_OF_LIMITS


def remark(scan: Scan) -> str | None:
    """Return a remark on an unusual scan that is used anyway; None for a usual one."""
    return NO_RETURNS if scan.no_returns else None


TILT_SCAN = Stream(
    role="tilt_scan",
    record=Scan,
    reader=MessageReader(
        "sensor_msgs/msg/LaserScan", lambda message: (scan_from_message(message),), read_scan
    ),
    mount=MountKind.TILTING,
    processor="tccm",
    event=PosedScan,
    time_span=time_span,
    rejection_reason=rejection_reason,
    remark=remark,
    make_cleaner=NoReturns,
    sees_robot=True,
)


def timed_scan(scan: Scan, config: Config) -> Scan:
    """Return a scan with beam times corrected by ``scan.reverse`` and ``scan.time_offset``.

    Beam i of N of a reversed scan was measured at ``stamp + (N - 1 - i) * time_increment``.
    """
    reverse, offset = config.scan.reverse, config.scan.time_offset
    if (not reverse and offset == 0.0) or rejection_reason(scan) is not None:
        return scan
    stamp_ns = scan.stamp_ns + round(offset * 1e9)
    if not reverse:
        return replace(scan, stamp_ns=stamp_ns)
    stamp_ns += scan.end_ns - scan.stamp_ns
    return replace(scan, stamp_ns=stamp_ns, time_increment=-scan.time_increment)


LEVEL_SCAN = replace(
    TILT_SCAN,
    role="scan",
    mount=MountKind.LEVEL,
    processor="slam",
    sees_robot=False,
    can_be_base=True,
    correct=timed_scan,
)


def scan_stream(stream: Stream, config: Config) -> Stream:
    """Return the stream of a laser with the range limits of a configuration."""
    return replace(stream, rejection_reason=partial(rejection_reason, limits=config.scan))


def bearings(scan: Scan) -> Float64:
    """Return the bearings of the beams, float64 (N,), rad."""
    steps = np.arange(len(scan.ranges), dtype=np.float64)
    return float(scan.angle_min) + steps * float(scan.angle_increment)


def beam_stamps(scan: Scan) -> Int64:
    """Return the times of the beams, int64 (N,): beam i at ``stamp + i * time_increment``."""
    since = np.arange(len(scan.ranges)) * (scan.time_increment * 1e9)
    return scan.stamp_ns + np.rint(since).astype(np.int64)


def valid_beams(scan: Scan, config: Config, *, line_ends: bool = True) -> Bool:
    """Return a mask of the beams with a valid hit, bool (N,).

    Rejected are NaN and infinite ranges (REP-117), 0, ranges outside the scan's own limits or those
    of the group `scan`, and mixed pixels at edges.

    Parameters
    ----------
    scan
        A scan.
    config
        Group `scan`.
    line_ends
        Whether to keep the last hit of a straight line before a step away from the laser, which
        marks the edge of a surface.
    """
    limits = config.scan
    low, high = max(scan.range_min, limits.min_range), min(scan.range_max, limits.max_range)
    return mark_valid(
        scan.ranges,
        low,
        high,
        scan.angle_increment,
        limits.shadow_angle,
        limits.shadow_jump,
        line_ends,
    )


@lru_cache(maxsize=16)
def _directions(angle_min: float, increment: float, count: int) -> tuple[Float64, Float64]:
    angles = angle_min + np.arange(count) * increment
    return np.cos(angles), np.sin(angles)


def directions(scan: Scan) -> tuple[Float64, Float64]:
    """Return cosines and sines of the bearings, float64 (N,) each (cached: do not write)."""
    return _directions(scan.angle_min, scan.angle_increment, len(scan.ranges))


def laser_poses(posed: PosedScan, T_frame_odom: Float64 | None = None) -> tuple[Float64, Float64]:
    """Return the laser's poses over the scan, dense enough for linear blending.

    Parameters
    ----------
    posed
        A posed scan.
    T_frame_odom
        float64 (4, 4), target frame of the poses; None for odom.

    Returns
    -------
    times float64 (M,), s since the scan's stamp, and T_frame_laser float64 (M, 3, 4).
    """
    T = posed.T_odom_base @ posed.T_base_laser
    if T_frame_odom is not None:
        T = T_frame_odom @ T
    times = (posed.pose_stamps_ns - posed.scan.stamp_ns) * 1e-9
    return refine_poses(times, np.ascontiguousarray(T))


def project(
    posed: PosedScan, chosen: Bool, T_frame_odom: Float64 | None = None
) -> tuple[Float64, Int32]:
    """Return the points of selected beams, each with the pose at its own time.

    Parameters
    ----------
    posed
        A posed scan.
    chosen
        bool (N,), beams with a valid hit.
    T_frame_odom
        float64 (4, 4), from odom to the frame of the points; None for odom.

    Returns
    -------
    points float64 (M, 3), m, and beam indices int32 (M,).
    """
    times, T = laser_poses(posed, T_frame_odom)
    cosines, sines = directions(posed.scan)
    step = float(posed.scan.time_increment)
    return place_beams(posed.scan.ranges, chosen, cosines, sines, step, times, T)


def used_beams(posed: PosedScan, config: Config) -> Bool:
    """Return a mask of the beams with a valid hit outside the robot itself, bool (N,).

    Only hits near the robot's shapes are projected here; `CycleBuilder` projects all hits later.
    """
    valid, shapes = valid_beams(posed.scan, config), posed.own_shapes
    if shapes is None or not len(shapes.kinds):
        return valid
    padding = config.scan.self_padding
    T_odom_shape = posed.T_odom_base[_stamp_sample(posed)] @ shapes.T_base_shape
    near = valid & (posed.scan.ranges <= _max_range(posed, T_odom_shape, shapes.half + padding))
    points, beams = project(posed, near)
    inside = mark_inside(points, shapes.kinds, shapes.half, inverse(T_odom_shape), padding)
    valid[beams[inside]] = False
    return valid


def _max_range(posed: PosedScan, T_odom_shape: Float64, half: Float64) -> float:
    """Return a range, m, beyond which no hit is inside a shape with half extents (S, 3).

    The laser moves linearly between its poses, so its distance from a shape's centre is maximal at
    one of them. The factor covers the shortening of a beam by blended poses (`BLEND_ANGLE`).
    """
    lasers = np.einsum("kij,kj->ki", posed.T_odom_base, posed.T_base_laser[:, :, 3])[:, None, :3]
    to_middle = np.linalg.norm(T_odom_shape[:, :3, 3] - lasers, axis=-1)
    return 1.00001 * float((to_middle + np.linalg.norm(half, axis=-1)).max())


def project_level(posed: PosedScan, config: Config) -> tuple[Float64, Int32]:
    """Return the points of a level scan in the base frame at the scan's stamp.

    Returns
    -------
    points float64 (N, 2), m, in the base frame at the scan's stamp without roll and pitch, and beam
    indices int32 (N,).
    """
    T_level_odom = inverse(level(posed.T_odom_base[_stamp_sample(posed)]))
    # Matching compares scans from different places; the visible end of a wall moves with the robot.
    chosen = valid_beams(posed.scan, config, line_ends=False)
    points, beams = project(posed, chosen, T_level_odom)
    return points[:, :2], beams


def _stamp_sample(posed: PosedScan) -> int:
    """Return the index of the pose sample at the scan's stamp.

    It is the first, or the last (-1) where the time increment is negative.
    """
    return 0 if posed.pose_stamps_ns[0] == posed.scan.stamp_ns else -1
