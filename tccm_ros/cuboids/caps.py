"""Caps of cuboids: separate moments of the points at a cuboid's top.

Where a vertical board ends in a horizontal surface, the highest cuboid of a cell contains points of
both. Points of the surface are at the top; their moments are stored separately and can be
subtracted exactly. A part map with points computes the caps with its cuboids; part maps in an
integration map have no points, so the integration map has no caps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.kernels import kernel

CAP_DEPTH = 150
"""Depth of a cap, ticks. Chosen: 15 mm, the height noise of a horizontal surface to both sides."""


@dataclass(frozen=True, slots=True, eq=False)
class Caps:
    """The caps of a map's cuboids.

    Attributes
    ----------
    of
        int32 (N,): row of each cuboid's cap; -1 if all its points are within the cap's depth, so
        that the cap is the whole cuboid. Length 0 where caps are unknown.
    moments
        float64 (C, 10), ticks: count, sums and products as in `Cuboids`.
    """

    of: Int32
    moments: Float64


def no_caps() -> Caps:
    """Return the unknown caps of a map without points."""
    return Caps(np.zeros(0, np.int32), np.zeros((0, 10)))


@kernel
def sum_caps(points: Any, counts: Any, first: Any, tops: Any, of: Any, sums: Any) -> Any:
    """Sum the moments of the points at the tops of cuboids.

    Parameters
    ----------
    points
        int64 (M, 2), see `part_map.PartPoints`.
    counts, first, tops
        int64 (N,), int32 (N,) and int32 (N,): number of points, first point and top, ticks, of each
        cuboid.
    of, sums
        int32 (N,) and float64 (N, 10), initially zero; written: the fields of `Caps`.

    Returns
    -------
    int
        Number of caps.
    """
    caps = 0
    for k in range(len(first)):
        begin, end = first[k], first[k] + counts[k]
        lowest = np.int64(tops[k]) - CAP_DEPTH
        into, in_cap = sums[caps], 0
        for i in range(begin, end):
            word = points[i, 0]
            z = word >> 32
            if z < lowest:
                continue
            x, y = float((word >> 16) & 0xFFFF), float(word & 0xFFFF)
            h = float(z)
            in_cap += 1
            into[0] += 1.0
            into[1] += x
            into[2] += y
            into[3] += h
            into[4] += x * x
            into[5] += x * y
            into[6] += x * h
            into[7] += y * y
            into[8] += y * h
            into[9] += h * h
        if in_cap < end - begin:
            of[k] = caps
            caps += 1
        else:
            of[k] = -1
            into[:] = 0.0
    return caps
