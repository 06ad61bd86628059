"""Measurement of the approached edge of a surface from tilt cycles.

The outermost points of a surface are up to one scan line spacing inside its edge. The edge is
therefore estimated half that spacing outside the outermost points, in strips across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.approach.target import Target
from tccm_ros.arrays import Bool, Float64, Int64

STRIP_M = 0.02
"""Width of the strips across an edge, m: a few beams of each scan line at 1 m (0.25 to 0.5 deg)."""

DEPTH_M = 0.25
"""Points further inside an edge than this are ignored, m."""

OUTSIDE_M = 0.12
"""Search distance outside the expected edge, m: two corrections of 6 cm. Chosen."""

HALF_WIDTH_M = 0.35
"""Half the fitted length of an edge, m: the width of a base."""

ROUND_RAD = 1.1
"""Half the fitted arc of a circle, as an angle: its sides determine the centre, and beyond 60 deg
the sensor sees the edge at a grazing angle."""

SAME_LINE_M = 0.003
"""Points of one scan line differ by less than this, m: the noise of a laser at half a metre."""

MAX_PITCH_M = 0.06
"""Maximum spacing of scan lines, m: the error of the edge is half of it, and 2 cm are required."""

MIN_STRIPS = 5
"""Minimum number of strips of an edge: 10 cm."""

OUTLIER_M = 0.008
"""A strip with a larger residual is an outlier, m: three times a laser's noise."""

ROUNDS = 6
"""Number of fits; the set of outliers no longer changes after them."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredEdge:
    """The edge of a surface where the base approaches it.

    Attributes
    ----------
    point
        float64 (2,), on the edge, ahead of the base.
    normal
        float64 (2,), outwards, of unit length.
    sigma
        Standard deviation of the point's position across the edge, m.
    middle
        float64 (2,), centre of a round edge; None for a straight one.
    """

    point: Float64
    normal: Float64
    sigma: float
    middle: Float64 | None = None

    def facing(self, place: Float64) -> tuple[Float64, Float64]:
        """Return the point of the edge that faces a position (2,), and the normal there.

        For a straight edge this is always the measured point.
        """
        if self.middle is None:
            return self.point, self.normal
        normal = (place - self.middle) / np.hypot(*(place - self.middle))
        return self.middle + np.hypot(*(self.point - self.middle)) * normal, normal


def measured_edge(
    points: Float64, target: Target, near: Float64, normal: Float64
) -> MeasuredEdge | None:
    """Return the edge of a surface near a point of its outline; None with too few measurements.

    Parameters
    ----------
    points
        float64 (N, 2), points of the surface, m.
    target
        Expected surface; the radius of a round one is not estimated.
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
    # The strips of the second round are perpendicular to the edge measured in the first.
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
    """Return the edge of a round surface: a circle of known radius, fitted to the facing arc."""
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
        # The base keeps its path: the normal points from the new centre to the same point ahead.
        normal = (near - middle) / np.hypot(*(near - middle))
        found = MeasuredEdge(middle + radius * normal, normal, sigma, middle)
    return found


def _extent(target: Target, near: Float64, normal: Float64) -> tuple[float, float]:
    """Return both ends along the straight side through a point, m, within `HALF_WIDTH_M`."""
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
    """Return the middle and the outer end of each strip; None if there are too few strips.

    Parameters
    ----------
    along, out
        float64 (N,), coordinates along the edge, and outwards from the expected edge.
    width
        Width of a strip, in the unit of `along`.
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
    # Points of a strip are sorted from the outermost inwards; the reversed assignment keeps the
    # first.
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
    """Return least-squares coefficients of the inliers, and the first one's standard deviation.

    None with too few inliers.
    """
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
