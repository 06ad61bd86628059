"""Pieces of walls: collinear planes observed along one stretch are pieces of one wall.

Panels bow, lasers have bias and poses have errors, so that lines of one wall differ by some
centimetres and degrees, and association begins a new plane for a line that fits none. Of two
surfaces with the same orientation, one behind the other, a laser sees only the front one:
observations of the same stretch within the thickness of a wall are therefore one wall. Adjacent
surfaces (the front of a cupboard, a door that is ajar) remain separate walls.

In the graph each piece remains a landmark of its own: what one plane cannot represent would
displace the keyframes. Results contain whole walls.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.slam.walls.pooled import add_pooled, extend_pooled

MIN_OVERLAP = 0.15
"""Minimum common fraction of the shorter of two pieces. The halves of panels of 2.5 to 5 m that bow
by up to 6 cm have more than 0.2 in common, adjacent surfaces less than 0.1
(``test/slam/walls/test_association.py``)."""

BIN = 0.05
"""Length (m) of a bin along a wall for its observed stretches: a tenth of a line (chosen)."""

MAX_DPHI = 0.35
"""Maximum angle (rad) between a line and its wall, and between pieces of one wall (chosen)."""


class _Members(NamedTuple):
    """The segments of each wall as linked lists: first and last of each wall, next of each."""

    first: Int64
    last: Int64
    after: Int64


@kernel
def whole_walls(ends: Float64, wall: Int64, planes: Any, thickness: float) -> Int64:
    """Return the wall that each plane is a piece of, int64 (W,): the index of its longest piece.

    Each wall takes the pieces that are one with it, the longest wall first.

    Parameters
    ----------
    ends
        float64 (N, 2, 2), segments in map.
    wall
        int64 (N,), plane of each segment, or -1.
    planes
        Planes of dtype `POOLED`.
    thickness
        Maximum rms distance (m) between the lines of two pieces over their common stretch.
    """
    count, pooled = len(planes), planes.copy()
    whole = np.arange(count)
    members = _Members(np.full(count, -1), np.full(count, -1), np.full(len(wall), -1))
    for i in range(len(wall)):
        if wall[i] >= 0:
            _append(members, wall[i], i, i)
    order = np.argsort(-pooled["mass"])
    for place in range(count):
        a = order[place]
        later = place + 1
        while later < count and whole[a] == a:
            b = order[later]
            later += 1
            if whole[b] == b and _are_one(a, b, ends, pooled, members, thickness):
                add_pooled(pooled[a], pooled[b])
                _append(members, a, members.first[b], members.last[b])
                whole[whole == b] = a
                pooled[a].low, pooled[a].high = np.inf, -np.inf
                i = members.first[a]
                while i >= 0:
                    extend_pooled(pooled[a], ends[i])
                    i = members.after[i]
                later = place + 1
    return whole


@kernel
def _append(members: _Members, wall: int, first: int, last: int) -> None:
    if members.first[wall] < 0:
        members.first[wall] = first
    else:
        members.after[members.last[wall]] = first
    members.last[wall] = last


@kernel
def _are_one(
    a: int, b: int, ends: Float64, pooled: Any, members: _Members, thickness: float
) -> bool:
    """Return whether two walls have a common stretch, and are close to each other there."""
    dphi = pooled[b].phi - pooled[a].phi
    if np.cos(dphi) < np.cos(MAX_DPHI):
        return False
    # Over the position t along the tangent of a, b is offset + slope t behind it.
    offset, slope = pooled[b].rho / np.cos(dphi) - pooled[a].rho, -np.tan(dphi)
    low, high = _extent(b, pooled[a].phi, ends, members)
    start, stop = max(low, pooled[a].low), min(high, pooled[a].high)
    if stop <= start or abs(offset + slope * 0.5 * (start + stop)) > thickness:
        return False
    first, last = min(low, pooled[a].low), max(high, pooled[a].high)
    bins = int((last - first) / BIN) + 1
    seen_a = _seen(a, pooled[a].phi, ends, members, first, bins)
    seen_b = _seen(b, pooled[a].phi, ends, members, first, bins)
    both, squares = 0, 0.0
    for k in range(bins):
        if seen_a[k] and seen_b[k]:
            both += 1
            squares += (offset + slope * (first + (k + 0.5) * BIN)) ** 2
    if both <= MIN_OVERLAP * min(seen_a.sum(), seen_b.sum()):
        return False
    return bool(squares <= both * thickness * thickness)


@kernel
def _extent(wall: int, phi: float, ends: Float64, members: _Members) -> tuple[float, float]:
    """Return the minimum and maximum position of a wall's segments along a tangent."""
    nx, ny, low, high = np.cos(phi), np.sin(phi), np.inf, -np.inf
    i = members.first[wall]
    while i >= 0:
        for e in range(2):
            t = -ny * ends[i, e, 0] + nx * ends[i, e, 1]
            low, high = min(low, t), max(high, t)
        i = members.after[i]
    return low, high


@kernel
def _seen(wall: int, phi: float, ends: Float64, members: _Members, first: float, bins: int) -> Bool:
    """Return the bins along a tangent, from `first` on, in which a wall has segments."""
    nx, ny, seen = np.cos(phi), np.sin(phi), np.zeros(bins, np.bool_)
    i = members.first[wall]
    while i >= 0:
        t0 = -ny * ends[i, 0, 0] + nx * ends[i, 0, 1] - first
        t1 = -ny * ends[i, 1, 0] + nx * ends[i, 1, 1] - first
        for k in range(int(min(t0, t1) / BIN), min(int(max(t0, t1) / BIN) + 1, bins)):
            seen[k] = True
        i = members.after[i]
    return seen
