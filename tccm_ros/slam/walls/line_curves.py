"""Detect segments of a scan that are pieces of curved surfaces, and hence no walls.

Split and merge cuts a curve into chords. The cuts depend on noise and on the position of the laser,
so that another scan does not observe the same chords: a round hall has chords of every direction,
and each pose finds matching walls.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.kernels import kernel
from tccm_ros.slam.walls.line_fit import group_by_segment

MAX_RUN = 8
"""Maximum number of adjacent segments of one arc (chosen: a longer curve is several arcs)."""

LINE_PARAMETERS, ARC_PARAMETERS = 2, 3
"""Free parameters of a shape, without its end."""

MIN_SIGMA = 1e-4
"""Minimum noise of a point across its surface, m (chosen: for noise-free points)."""


@kernel
def curved_segments(beams: Float64, labels: Int32, max_gap: float, min_bend: float) -> Bool:
    """Return a mask of the segments that are pieces of a curve.

    Runs of adjacent segments are modelled by one line each, by one common line, or by one arc,
    whichever minimises the Bayesian information criterion over the scan (Schwarz 1978, "Estimating
    the dimension of a model"; by dynamic programming). Pieces of an arc with enough bend are pieces
    of a curve. The arc is approximated by a parabola, with an error of a millimetre over a tenth of
    a circle. The noise is estimated from the residuals of all lines.

    Parameters
    ----------
    beams
        float64 (B, 2), m, in beam order.
    labels
        int32 (B,), from `split_segments`: segments in beam order, or -1.
    max_gap
        Maximum distance between adjacent points, m.
    min_bend
        Minimum bend of an arc (rad) from the middle of the first piece to the middle of the last;
        with less bend, the pieces are of one wall.

    Returns
    -------
    bool (L,), for each segment
    """
    points, starts = group_by_segment(beams, labels, _seam(labels))
    count = len(starts) - 1
    curved = np.zeros(count, np.bool_)
    if count < 2:
        return curved
    variance = _variance(points, starts)
    parameter = np.log(max(len(points), 2))
    # Minimum cost of the pieces before each, length of the run that ends there, and whether an arc.
    costs, runs, arcs = np.zeros(count + 1), np.ones(count + 1, np.int64), curved.copy()
    for end in range(1, count + 1):
        costs[end] = np.inf
        for first in range(end - 1, max(end - 1 - MAX_RUN, -1), -1):
            next_start = starts[first + 1]
            if first < end - 1 and _length(points[next_start - 1 : next_start + 1]) > max_gap:
                break
            run = points[starts[first] : starts[end]]
            line, arc, curvature = _residuals(run)
            cost = costs[first] + line / variance + (LINE_PARAMETERS + 1) * parameter
            if cost < costs[end]:
                costs[end], runs[end], arcs[end - 1] = cost, end - first, False
            cost = costs[first] + arc / variance + (ARC_PARAMETERS + 1) * parameter
            if end - first > 1 and cost < costs[end]:
                costs[end], runs[end] = cost, end - first
                middles = (end - first - 1) / (end - first) * _length(run)
                arcs[end - 1] = curvature * middles > min_bend
    end = count
    while end > 0:
        curved[end - runs[end] : end] = arcs[end - 1]
        end -= runs[end]
    return curved


@kernel
def _seam(labels: Int32) -> int:
    """Return the beam at which a segment begins that the scan wraps around in; 0 for none."""
    seam = 0
    while seam < len(labels) and labels[seam] >= 0 and labels[seam] == labels[seam - 1]:
        seam += 1
    return seam


@kernel
def _variance(points: Float64, starts: Int64) -> float:
    """Return the variance across the lines of all segments, m2."""
    squares, freedom = 0.0, 0
    for k in range(len(starts) - 1):
        piece = points[starts[k] : starts[k + 1]]
        squares += _residuals(piece)[0]
        freedom += len(piece) - LINE_PARAMETERS
    return max(squares / max(freedom, 1), MIN_SIGMA**2)


@kernel
def _length(points: Float64) -> float:
    """Return the distance of the last point from the first."""
    return np.hypot(points[-1, 0] - points[0, 0], points[-1, 1] - points[0, 1])


@kernel
def _residuals(points: Float64) -> tuple[float, float, float]:
    """Return the squared residuals of a line and of a parabola, m2, and its curvature, 1/m.

    Both are least-squares fits across the chord from the first point to the last.
    """
    length = max(_length(points), 1e-9)
    c, s = (points[-1, 0] - points[0, 0]) / length, (points[-1, 1] - points[0, 1]) / length
    n, t1, y1 = len(points), 0.0, 0.0
    for i in range(n):
        dx, dy = points[i, 0] - points[0, 0], points[i, 1] - points[0, 1]
        t1, y1 = t1 + c * dx + s * dy, y1 + c * dy - s * dx
    t1, y1 = t1 / n, y1 / n
    t2, t3, t4, ty, tty, y2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        dx, dy = points[i, 0] - points[0, 0], points[i, 1] - points[0, 1]
        t, y = c * dx + s * dy - t1, c * dy - s * dx - y1
        tt = t * t
        t2, t3, t4 = t2 + tt, t3 + tt * t, t4 + tt * tt
        ty, tty, y2 = ty + t * y, tty + tt * y, y2 + y * y
    t2 = max(t2, 1e-12)
    line = max(y2 - ty * ty / t2, 0.0)
    # t^2 after subtraction of its linear fit: sum of squares, and sum of products with y.
    qq = max(t4 - t2 * t2 / n - t3 * t3 / t2, 1e-18)
    qy = tty - t3 * ty / t2
    return line, max(line - qy * qy / qq, 0.0), abs(2.0 * qy / qq)
