"""The beams of a tilt cycle as line segments, to be traced through columns and cells."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.cuboids.cycle_builder import CycleScan
from tccm_ros.sensors.laser_scan import directions, laser_poses
from tccm_ros.sensors.laser_scan_kernels import place_beams


def scan_rays(
    cycle_scan: CycleScan, max_length: float, every: int = 1, T_frame_odom: Float64 | None = None
) -> tuple[Float64, Float64, Bool]:
    """Return the beams that hit something, and those that came back empty (+inf, REP-117).

    Parameters
    ----------
    cycle_scan
        Beams of one scan.
    max_length
        Beams are cut off at this range, m. A beam without a return passed through to here.
    every
        Step between the beams that are taken: 1 takes all, 2 every second one.
    T_frame_odom
        float64 (4, 4), the frame of the result; odom if None.

    Returns
    -------
    origins, ends
        float64 (N, 3), m.
    hits
        bool (N,), whether the beam ended on something.
    """
    scan = cycle_scan.posed.scan
    useful = np.zeros(len(scan.ranges), np.bool_)
    chosen = slice(cycle_scan.first, cycle_scan.last, every)
    useful[chosen] = (cycle_scan.keep | np.isposinf(scan.ranges))[chosen]
    ranges = np.minimum(scan.ranges, np.float32(max_length))
    times, T = laser_poses(cycle_scan.posed, T_frame_odom)
    cosines, sines = directions(scan)
    step = float(scan.time_increment)
    ends, beams = place_beams(ranges, useful, cosines, sines, 0.0, step, times, T)
    origins, _ = place_beams(np.zeros_like(ranges), useful, cosines, sines, 0.0, step, times, T)
    return origins, ends, cycle_scan.keep[beams] & (ranges[beams] < max_length)
