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

from collections.abc import Sequence
from typing import Any

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.slam.walls.pooled import join_pooled

MIN_OVERLAP = 0.15
"""Minimum common fraction of the shorter of two pieces. The halves of panels of 2.5 to 5 m that bow
by up to 6 cm have more than 0.2 in common, adjacent surfaces less than 0.1
(``test/slam/walls/test_association.py``)."""

BIN = 0.05
"""Length (m) of a bin along a wall for its observed stretches: a tenth of a line (chosen)."""

MAX_DPHI = 0.35
"""Maximum angle (rad) between a line and its wall, and between pieces of one wall (chosen)."""


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
    pooled, whole = planes.copy(), np.arange(len(planes))
    segments = [ends[wall == w] for w in whole]
    order = np.argsort(-pooled["mass"])
    for place, a in enumerate(order):
        later = order[place + 1 :] if whole[a] == a else order[:0]
        while (b := _join_piece(a, later[whole[later] == later], pooled, segments, thickness)) >= 0:
            segments[a] = np.concatenate([segments[a], segments[b]])
            whole[whole == b] = a
    return whole


def _join_piece(
    a: int, others: Int64, pooled: Any, segments: Sequence[Float64], thickness: float
) -> int:
    """Join the first of other planes that is a piece of wall a; return it, or -1 for none."""
    alike = np.cos(pooled["phi"][others] - pooled["phi"][a]) >= np.cos(MAX_DPHI)
    for b in others[alike]:
        if _join_if_one(pooled[a], pooled[b], segments[a], segments[b], thickness):
            return int(b)
    return -1


@kernel
def _join_if_one(
    one: Any, other: Any, ends: Float64, ends_other: Float64, thickness: float
) -> bool:
    """Join another plane to a wall if it is a piece of it; return whether it is."""
    is_one = _are_one(one, other, ends, ends_other, thickness)
    if is_one:
        join_pooled(one, other, ends, ends_other)
    return is_one


@kernel
def _are_one(one: Any, other: Any, ends: Float64, ends_other: Float64, thickness: float) -> bool:
    """Return whether two walls have a common stretch, and are close to each other there."""
    dphi = other.phi - one.phi
    # Over the position t along the tangent of the one, the other is offset + slope t behind it.
    offset, slope = other.rho / np.cos(dphi) - one.rho, -np.tan(dphi)
    along = _along(ends_other, one.phi)
    low, high = along.min(), along.max()
    start, stop = max(low, one.low), min(high, one.high)
    if stop <= start or abs(offset + slope * 0.5 * (start + stop)) > thickness:
        return False
    first, last = min(low, one.low), max(high, one.high)
    bins = int((last - first) / BIN) + 1
    seen = _seen(_along(ends, one.phi) - first, bins)
    seen_other = _seen(along - first, bins)
    both = np.flatnonzero(seen & seen_other)
    if len(both) <= MIN_OVERLAP * min(seen.sum(), seen_other.sum()):
        return False
    distances = offset + slope * (first + (both + 0.5) * BIN)
    return bool((distances**2).sum() <= len(both) * thickness * thickness)


@kernel
def _along(ends: Float64, phi: float) -> Float64:
    """Return the positions (N, 2) of the ends of segments along a tangent."""
    return -np.sin(phi) * ends[:, :, 0] + np.cos(phi) * ends[:, :, 1]


@kernel
def _seen(along: Float64, bins: int) -> Bool:
    """Return the bins along a tangent in which segments with ends at `along`, (N, 2), are."""
    seen = np.zeros(bins, np.bool_)
    for i in range(len(along)):
        low, high = along[i].min(), along[i].max()
        seen[int(low / BIN) : int(high / BIN) + 1] = True
    return seen
