"""The edge of a surface where the base approaches it, as tilt cycles measured it.

Points of a surface end up to one distance of scan lines before its edge. So the edge is taken half
that distance outside of the outermost points, in strips across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.approach.target import Target
from tccm_ros.arrays import Bool, Float64, Int64

STRIP_M = 0.02
"""Width of the strips across an edge, m: a few beams of each scan line at 1 m (0.25 to 0.5 deg)."""

DEPTH_M = 0.25
"""Points further inside of an edge than this say nothing of it, m."""

OUTSIDE_M = 0.12
"""An edge is looked for so far outside of where it is expected, m: what two corrections of 6 cm
make. Chosen."""

HALF_WIDTH_M = 0.35
"""Half the length of edge that is fitted, m: the width of a base."""

ROUND_RAD = 1.1
"""The same of a circle, as an angle: its sides tell where the middle is, and beyond 60 deg a sensor
sees the edge at a slant."""

SAME_LINE_M = 0.003
"""Points of one scan line differ by less, m: the noise of a laser at half a metre."""

MAX_PITCH_M = 0.06
"""Scan lines further from each other say nothing of an edge to 2 cm, m: half of it is the error."""

MIN_STRIPS = 5
"""Strips of which an edge is made, at least: 10 cm."""

OUTLIER_M = 0.008
"""A strip further from the fit is left out, m: three times a laser's noise."""

ROUNDS = 6
"""Fits after which outliers no longer change."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredEdge:
    """An edge where the base approaches it.

    Attributes
    ----------
    point
        float64 (2,), on the edge, ahead of the base.
    normal
        float64 (2,), outwards, of unit length.
    sigma
        Standard deviation of the point's position across the edge, m.
    middle
        float64 (2,), of a round one; None of a straight one.
    """

    point: Float64
    normal: Float64
    sigma: float
    middle: Float64 | None = None

    def facing(self, place: Float64) -> tuple[Float64, Float64]:
        """Return the point of the edge that a base at a place (2,) faces, and the normal there.

        A round edge is faced from anywhere, a straight one where it was measured.
        """
        if self.middle is None:
            return self.point, self.normal
        normal = (place - self.middle) / np.hypot(*(place - self.middle))
        return self.middle + np.hypot(*(self.point - self.middle)) * normal, normal


def measured_edge(
    points: Float64, target: Target, near: Float64, normal: Float64
) -> MeasuredEdge | None:
    """Return the edge of a surface near a point of its outline, None where too little is seen.

    Parameters
    ----------
    points
        float64 (N, 2), points of the surface, m.
    target
        Where the surface is expected; of a round one the radius is taken as it is.
    near, normal
        float64 (2,), a point of the expected outline and its outward normal.
    """
    fit = _round_edge if target.is_round else _straight_edge
    return fit(points, target, near, normal)


def _straight_edge(
    points: Float64, target: Target, near: Float64, normal: Float64
) -> MeasuredEdge | None:
    low, high = _extent(target, near, normal)
    found = None
    # The direction of strips follows the fit: the second one is across the measured edge.
    for _ in range(2):
        tangent = np.array([-normal[1], normal[0]])
        along, out = (points - near) @ tangent, (points - near) @ normal
        is_near = (along >= low) & (along <= high) & (out > -DEPTH_M) & (out < OUTSIDE_M)
        ends = _strip_ends(along[is_near], out[is_near], STRIP_M)
        if ends is None:
            return None
        middles, edge = ends
        line = _robust_fit(np.stack([np.ones(len(middles)), middles], axis=1), edge)
        if line is None:
            return None
        (offset, slope), sigma = line
        point = near + offset * normal
        turned = normal - slope * tangent
        normal = turned / np.hypot(*turned)
        near, found = point, MeasuredEdge(point, normal, sigma)
    return found


def _round_edge(
    points: Float64, target: Target, near: Float64, normal: Float64
) -> MeasuredEdge | None:
    """Fit the centre of a circle of known radius to the part that faces the base."""
    middle, radius = target.middle, target.radius
    found = None
    for _ in range(3):
        ahead = np.arctan2(normal[1], normal[0])
        from_middle = points - middle
        angles = np.arctan2(from_middle[:, 1], from_middle[:, 0]) - ahead
        angles = (angles + np.pi) % (2.0 * np.pi) - np.pi
        out = np.hypot(*from_middle.T) - radius
        is_near = (np.abs(angles) <= ROUND_RAD) & (out > -DEPTH_M) & (out < OUTSIDE_M)
        ends = _strip_ends(angles[is_near], out[is_near], STRIP_M / radius)
        if ends is None:
            return None
        at, edge = ends
        rows = np.stack([np.cos(at + ahead), np.sin(at + ahead)], axis=1)
        circle = _robust_fit(rows, edge)
        if circle is None:
            return None
        shift, sigma = circle
        middle = middle + shift
        # The base keeps to where it goes: the point ahead stays, and the circle turns its normal.
        normal = (near - middle) / np.hypot(*(near - middle))
        found = MeasuredEdge(middle + radius * normal, normal, sigma, middle)
    return found


def _extent(target: Target, near: Float64, normal: Float64) -> tuple[float, float]:
    """Return how far the straight side through a point goes each way, at most `HALF_WIDTH_M`."""
    tangent = np.array([-normal[1], normal[0]])
    starts, ends = target.outline, np.roll(target.outline, -1, axis=0)
    middles, ways = 0.5 * (starts + ends), ends - starts
    lengths = np.hypot(*ways.T)
    is_along = ways @ tangent > 0.98 * lengths
    across = np.abs((middles - near) @ normal)
    over = np.abs((middles - near) @ tangent) - 0.5 * lengths
    score = np.where(is_along, across + np.maximum(over, 0.0), np.inf)
    k = int(score.argmin())
    if not np.isfinite(score[k]):
        return -HALF_WIDTH_M, HALF_WIDTH_M
    low, high = sorted([(starts[k] - near) @ tangent, (ends[k] - near) @ tangent])
    # Strips at a corner end at the other side.
    return max(low + STRIP_M, -HALF_WIDTH_M), min(high - STRIP_M, HALF_WIDTH_M)


def _strip_ends(along: Float64, out: Float64, width: float) -> tuple[Float64, Float64] | None:
    """Return the middle and the end of each strip, None where too few are seen.

    Parameters
    ----------
    along, out
        float64 (N,), along the edge, and outwards from where it is expected.
    width
        Of a strip, as `along`.
    """
    if len(along) < 2 * MIN_STRIPS:
        return None
    strips = np.floor(along / width).astype(np.int64)
    order = np.lexsort((-out, strips))
    along, out, strips = along[order], out[order], strips[order]
    starts: Int64 = np.flatnonzero(np.r_[True, np.diff(strips) > 0])
    outermost = np.repeat(out[starts], np.diff(np.r_[starts, len(strips)]))
    behind = outermost - out
    number = np.cumsum(np.r_[0, np.diff(strips) > 0])
    is_next: Bool = behind > SAME_LINE_M
    first_next = np.full(len(starts), np.nan)
    # The points of a strip come from the outermost inwards: written backwards, the first one stays.
    first_next[number[is_next][::-1]] = behind[is_next][::-1]
    if np.isnan(first_next).all() or len(starts) < MIN_STRIPS:
        return None
    pitch = float(np.nanmedian(first_next))
    if pitch > MAX_PITCH_M:
        return None
    is_first = behind < max(0.5 * pitch, 0.5 * SAME_LINE_M)
    counts = np.bincount(number[is_first], minlength=len(starts))
    middles = np.bincount(number[is_first], along[is_first], len(starts)) / counts
    ends = np.bincount(number[is_first], out[is_first], len(starts)) / counts + 0.5 * pitch
    return middles, ends


def _robust_fit(rows: Float64, values: Float64) -> tuple[Float64, float] | None:
    """Return least-squares coefficients without outliers, and the deviation of the first."""
    used = np.abs(values - np.median(values)) < 0.05
    for _ in range(ROUNDS):
        if used.sum() < MIN_STRIPS:
            return None
        found, *_ = np.linalg.lstsq(rows[used], values[used], rcond=None)
        off = np.abs(values - rows @ found)
        used = off < max(OUTLIER_M, 2.5 * float(np.median(off)))
    rms = float(np.sqrt(np.mean((values[used] - rows[used] @ found) ** 2)))
    return np.asarray(found, np.float64), rms / float(
        np.sqrt(max(int(used.sum()) - rows.shape[1], 1))
    )
