"""Visibility of map points: how many scans see through a point, and how many end at it.

A point that scans see through has moved. A pose from which a scan sees through walls is wrong.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel

SECTORS = 512
"""Sectors around a laser, 0.5 to 1 degree wide. Beam ends nearer than 2 m, averaged over 4 cm,
leave some empty: these count as unseen (chosen)."""

MARGIN = 0.2
"""A beam that ends this much (m) behind a point passed it: more than noise, errors of poses and
oblique walls explain (chosen)."""


@kernel
def passes_and_hits(
    points: Float64, origins: Float64, counts: Int64, ends: Float64
) -> tuple[Int64, Int64]:  # pragma: no cover - compiled
    """Return how many scans passed each point, and how many ended at it, int64 (N,) each.

    A scan passes a point where all beams in its sector and in the two beside it end behind it; of
    what lies behind their ends it knows nothing.

    Parameters
    ----------
    points
        float64 (N, 2), m.
    origins
        float64 (K, 2), the lasers.
    counts
        int64 (K,), beams of each scan; their sum is M.
    ends
        float64 (M, 2), where beams ended, scan after scan, in the same frame.
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
def _sector(x: float, y: float) -> int:  # pragma: no cover - compiled
    """Return the sector of a direction; they divide a square's edge, which needs no arctangent."""
    size = abs(x) + abs(y)
    quarter = y / size if size > 0.0 else 0.0
    if x < 0.0:
        quarter = 2.0 - quarter
    elif y < 0.0:
        quarter += 4.0
    return min(int(quarter * (SECTORS / 4)), SECTORS - 1)
