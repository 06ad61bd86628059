"""Visibility of map points: how many scans see through a point, and how many end at it.

A point that scans see through has moved. A pose from which a scan sees through walls is wrong.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel

SECTORS = 512
"""Number of sectors around a laser; they are 0.5 to 1 degree wide. The ends of beams shorter than 2
m, averaged over 4 cm, leave some sectors empty, which then are unobserved (chosen)."""

MARGIN = 0.2
"""A beam that ends this much (m) behind a point has passed it; more than noise, pose errors and
oblique walls cause (chosen)."""


@kernel
def passes_and_hits(
    points: Float64, origins: Float64, counts: Int64, ends: Float64
) -> tuple[Int64, Int64]:
    """Return the number of scans that passed each point and that ended at it, int64 (N,) each.

    A scan passes a point if all beams in its sector and the two adjacent ones end behind it. Space
    behind the ends of beams is unobserved.

    Parameters
    ----------
    points
        float64 (N, 2), m.
    origins
        float64 (K, 2), positions of the lasers.
    counts
        int64 (K,), number of beams of each scan; their sum is M.
    ends
        float64 (M, 2), ends of beams, scan after scan, in the same frame.
    """
    ranges = np.full((len(counts), SECTORS), np.inf)
    i = 0
    for k in range(len(counts)):
        for _ in range(counts[k]):
            x, y = ends[i, 0] - origins[k, 0], ends[i, 1] - origins[k, 1]
            sector = _sector(x, y)
            ranges[k, sector] = min(ranges[k, sector], np.sqrt(x * x + y * y))
            i += 1
    passes, hits = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    for k in range(len(counts)):
        near = ranges[k].copy()
        for s in range(SECTORS):
            near[s] = min(ranges[k, s - 1], ranges[k, s], ranges[k, (s + 1) % SECTORS])
        for i in range(len(points)):
            x, y = points[i, 0] - origins[k, 0], points[i, 1] - origins[k, 1]
            end = near[_sector(x, y)]
            behind = end - np.sqrt(x * x + y * y)
            if end < np.inf and behind > MARGIN:
                passes[i] += 1
            elif abs(behind) <= MARGIN:
                hits[i] += 1
    return passes, hits


@kernel
def _sector(x: float, y: float) -> int:
    """Return the sector of a direction; sectors divide a square's edge, without an arctangent."""
    size = abs(x) + abs(y)
    quarter = y / size if size > 0.0 else 0.0
    if x < 0.0:
        quarter = 2.0 - quarter
    elif y < 0.0:
        quarter += 4.0
    return min(int(quarter * (SECTORS / 4)), SECTORS - 1)
