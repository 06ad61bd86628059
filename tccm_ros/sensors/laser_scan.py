"""From ranges to points: REP-117, mixed pixels, the pose of each beam's own time."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.geometry import inverse, level
from tccm_ros.records import PosedScan, Scan
from tccm_ros.robot.self_shapes import SelfShapes
from tccm_ros.sensors.laser_scan_kernels import mark_inside, mark_valid, place_beams, refine_poses

__all__ = [
    "ScanPoints",
    "beam_stamps",
    "bearings",
    "directions",
    "laser_poses",
    "project",
    "project_level",
    "valid_beams",
]

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class ScanPoints:
    """The hits of a scan.

    Attributes
    ----------
    points
        float64 (N, 3), m, in the odometry frame.
    beams
        int32 (N,), index of the beam, increasing.
    stamps_ns
        int64 (N,), time of the beam.
    """

    points: Float64
    beams: NDArray[np.int32]
    stamps_ns: NDArray[np.int64]


def bearings(scan: Scan) -> Float64:
    """Return the bearings of the beams, float64 (N,), rad."""
    steps = np.arange(len(scan.ranges), dtype=np.float64)
    return float(scan.angle_min) + steps * float(scan.angle_increment)


def beam_stamps(scan: Scan) -> NDArray[np.int64]:
    """Return the times of the beams, int64 (N,): beam i at ``stamp + i * time_increment``."""
    since = np.arange(len(scan.ranges)) * (scan.time_increment * 1e9)
    return scan.stamp_ns + np.rint(since).astype(np.int64)


def valid_beams(scan: Scan, config: Config) -> Bool:
    """Return which beams hit something, bool (N,).

    Dropped are nan and infinite ranges (REP-117), 0, ranges outside the scan's own limits or
    those of the group `scan`, and mixed pixels at edges.
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
    )


@lru_cache(maxsize=16)
def _directions(angle_min: float, increment: float, count: int) -> tuple[Float64, Float64]:
    angles = angle_min + np.arange(count) * increment
    return np.cos(angles), np.sin(angles)


def directions(scan: Scan) -> tuple[Float64, Float64]:
    """Return cosines and sines of the bearings, float64 (N,) each (cached: do not write)."""
    return _directions(scan.angle_min, scan.angle_increment, len(scan.ranges))


def laser_poses(posed: PosedScan, T_frame_odom: Float64 | None = None) -> tuple[Float64, Float64]:
    """Return the laser's poses over the scan, close enough to blend between.

    Parameters
    ----------
    posed
        A scan with its poses.
    T_frame_odom
        float64 (4, 4); the poses are given in that frame, in odom if None.

    Returns
    -------
    times float64 (M,), s since the scan's stamp, and T_frame_laser float64 (M, 3, 4).
    """
    T = posed.T_odom_base @ posed.T_base_laser
    if T_frame_odom is not None:
        T = T_frame_odom @ T
    times = (posed.knots_ns - posed.scan.stamp_ns) * 1e-9
    return refine_poses(times, np.ascontiguousarray(T))


def project(posed: PosedScan, config: Config, shapes: SelfShapes | None = None) -> ScanPoints:
    """Return the hits of a scan in the odometry frame, each with the pose of its own time.

    Parameters
    ----------
    posed
        A scan with its poses.
    config
        Group `scan`.
    shapes
        The robot's own shapes at the scan's stamp (`LaserKinematics.self_shapes`); points in them
        are dropped. None: no self filter.
    """
    points, beams = _place(posed, valid_beams(posed.scan, config), None)
    if shapes is not None and config.scan.self_filter and len(shapes.kinds):
        T_odom_shape = posed.T_odom_base[_stamp_knot(posed)] @ shapes.T_base_shape
        padding = config.scan.self_padding
        inside = mark_inside(points, shapes.kinds, shapes.half, inverse(T_odom_shape), padding)
        points, beams = points[~inside], beams[~inside]
    since = np.rint(beams * (posed.scan.time_increment * 1e9)).astype(np.int64)
    return ScanPoints(points, beams, posed.scan.stamp_ns + since)


def project_level(posed: PosedScan, config: Config) -> tuple[Float64, NDArray[np.int32]]:
    """Return the hits of a level scan as the base saw them at the scan's stamp.

    Returns
    -------
    points float64 (N, 2), m, in the base frame at the scan's stamp, levelled (without its roll
    and pitch), and their beams int32 (N,).
    """
    T_level_odom = inverse(level(posed.T_odom_base[_stamp_knot(posed)]))
    points, beams = _place(posed, valid_beams(posed.scan, config), T_level_odom)
    return points[:, :2], beams


def _stamp_knot(posed: PosedScan) -> int:
    """Return the knot at the scan's stamp: the last one where beams are stamped backwards."""
    return 0 if posed.knots_ns[0] == posed.scan.stamp_ns else -1


def _place(
    posed: PosedScan, valid: Bool, T_frame_odom: Float64 | None
) -> tuple[Float64, NDArray[np.int32]]:
    times, T = laser_poses(posed, T_frame_odom)
    cosines, sines = directions(posed.scan)
    step = float(posed.scan.time_increment)
    return place_beams(posed.scan.ranges, valid, cosines, sines, 0.0, step, times, T)
