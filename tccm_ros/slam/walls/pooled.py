"""Pooled moments of a wall's segments: adding a segment is exact, and gives the line of all."""

from __future__ import annotations

from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.kernels import kernel

WALL_FIELDS = (
    "mass", "x", "y", "xx", "xy", "yy", "cos", "sin", "phi", "rho", "low", "high"
)  # fmt: skip
POOLED = np.dtype([(name, np.float64) for name in WALL_FIELDS])
"""A wall: moments of its segments weighted by length (m), the sum of their orientations, the line
of all, and its minimum and maximum position along the tangent."""


@kernel
def pool_segment(w: Any, a: Float64, b: Float64, facing: float) -> None:
    """Add the segment a-b to a wall of dtype `POOLED`, without its extent."""
    length = np.hypot(b[0] - a[0], b[1] - a[1])
    cx, cy = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])
    hx, hy = 0.5 * (b[0] - a[0]), 0.5 * (b[1] - a[1])
    w.mass += length
    w.x += length * cx
    w.y += length * cy
    w.xx += length * (cx * cx + hx * hx / 3.0)
    w.xy += length * (cx * cy + hx * hy / 3.0)
    w.yy += length * (cy * cy + hy * hy / 3.0)
    w.cos += length * np.cos(facing)
    w.sin += length * np.sin(facing)
    fit_pooled(w)


@kernel
def join_pooled(w: Any, other: Any, ends: Float64, ends_other: Float64) -> None:
    """Add another wall; `ends` (N, 2, 2) are the segments of each."""
    w.mass += other.mass
    w.x += other.x
    w.y += other.y
    w.xx += other.xx
    w.xy += other.xy
    w.yy += other.yy
    w.cos += other.cos
    w.sin += other.sin
    fit_pooled(w)
    w.low, w.high = np.inf, -np.inf
    for i in range(len(ends)):
        extend_pooled(w, ends[i])
    for i in range(len(ends_other)):
        extend_pooled(w, ends_other[i])


@kernel
def fit_pooled(w: Any) -> None:
    """Fit the least-squares line of all segments, with their orientation."""
    mx, my = w.x / w.mass, w.y / w.mass
    sxx, sxy, syy = w.xx / w.mass - mx * mx, w.xy / w.mass - mx * my, w.yy / w.mass - my * my
    phi = 0.5 * np.arctan2(2.0 * sxy, sxx - syy) + 0.5 * np.pi
    if np.cos(phi) * w.cos + np.sin(phi) * w.sin < 0.0:
        phi -= np.pi
    w.phi = phi
    w.rho = np.cos(phi) * mx + np.sin(phi) * my


@kernel
def extend_pooled(w: Any, ends: Float64) -> None:
    """Extend a wall along its tangent to the ends (2, 2) of a segment."""
    nx, ny = np.cos(w.phi), np.sin(w.phi)
    for e in range(2):
        t = -ny * ends[e, 0] + nx * ends[e, 1]
        w.low, w.high = min(w.low, t), max(w.high, t)
