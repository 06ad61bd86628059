"""The beams of a sweep as lines, for what they passed through."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.cuboids.cycle_builder import SweepScan
from tccm_ros.sensors.laser_scan import directions, laser_poses
from tccm_ros.sensors.laser_scan_kernels import place_beams

__all__ = ["sweep_beams"]


def sweep_beams(
    sweep_scan: SweepScan, longest: float, every: int = 1, T_frame_odom: Float64 | None = None
) -> tuple[Float64, Float64, Bool]:
    """Return the beams that hit something, and those that came back empty (+inf, REP-117).

    Parameters
    ----------
    sweep_scan
        Beams of one scan.
    longest
        Beams are cut off here, m: what came back empty saw through to here.
    every
        Takes one beam in so many.
    T_frame_odom
        float64 (4, 4), the frame that is wanted; odom if None.

    Returns
    -------
    origins, ends
        float64 (N, 3), m.
    hits
        bool (N,), whether the beam ended on something.
    """
    scan = sweep_scan.posed.scan
    useful = np.zeros(len(scan.ranges), np.bool_)
    chosen = slice(sweep_scan.first, sweep_scan.last, every)
    useful[chosen] = (sweep_scan.keep | np.isposinf(scan.ranges))[chosen]
    ranges = np.minimum(scan.ranges, np.float32(longest))
    times, T = laser_poses(sweep_scan.posed, T_frame_odom)
    cosines, sines = directions(scan)
    step = float(scan.time_increment)
    ends, beams = place_beams(ranges, useful, cosines, sines, 0.0, step, times, T)
    origins, _ = place_beams(np.zeros_like(ranges), useful, cosines, sines, 0.0, step, times, T)
    return origins, ends, sweep_scan.keep[beams] & (ranges[beams] < longest)
