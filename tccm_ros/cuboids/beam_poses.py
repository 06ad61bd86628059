"""The poses of a scan's beams, for kernels: times in beams, and poses that can be blended."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from tccm_ros.cuboids.bin_layout import HAS_NORMAL, NORMAL
from tccm_ros.sensors.laser_scan_kernels import refine_poses

__all__ = ["in_beams", "line_step", "poses_of"]

BLEND_ANGLE = 0.01
"""Poses of a scan that turn by more than this, rad, are refined before matrices are blended: the
chord would shorten a beam by the 80,000th part (angle^2 / 8)."""


@njit(nogil=True, cache=True)
def _compose(n: Any, T_odom_base: Any, T_base_laser: Any) -> Any:
    """Return the first n T_odom_laser (n, 3, 4), and whether they turn by over `BLEND_ANGLE`."""
    T = np.empty((n, 3, 4))
    coarse = False
    for k in range(n):
        difference = 0.0
        for i in range(3):
            a, b, c = T_odom_base[k, i, 0], T_odom_base[k, i, 1], T_odom_base[k, i, 2]
            for j in range(4):
                T[k, i, j] = a * T_base_laser[k, 0, j] + b * T_base_laser[k, 1, j]
                T[k, i, j] += c * T_base_laser[k, 2, j]
                if k > 0 and j < 3:
                    difference += (T[k, i, j] - T[k - 1, i, j]) ** 2
            T[k, i, 3] += T_odom_base[k, i, 3]
        coarse = coarse or difference > 2.0 * BLEND_ANGLE**2
    return T, coarse


@njit(nogil=True, cache=True)
def poses_of(times: Any, T_odom_base: Any, T_base_laser: Any) -> Any:
    """Return times and T_odom_laser (K, 3, 4), refined where they turn far."""
    T, coarse = _compose(len(times), T_odom_base, T_base_laser)
    if not coarse:
        return times, T
    square = np.zeros((len(T), 4, 4))
    square[:, :3] = T
    return refine_poses(times, square)


@njit(nogil=True, cache=True)
def line_step(T: Any, limits: Any, step: Any) -> Any:
    """Return the larger of the steps between beams and to the scan before, rad."""
    if limits[HAS_NORMAL] == 0.0:
        return step
    square = 0.0
    for i in range(3):
        square += (T[len(T) // 2, i, 2] - limits[NORMAL + i]) ** 2
    return max(step, np.sqrt(square))


@njit(nogil=True, cache=True)
def in_beams(knots: Any, stamp: Any, period: Any) -> Any:
    """Return the knots' times in beams after the first; one knot where all beams have one time."""
    n = len(knots) if period != 0.0 else 1
    times = np.zeros(n)
    for k in range(n):
        if n > 1:
            times[k] = (knots[k] - stamp) / period
    return times
