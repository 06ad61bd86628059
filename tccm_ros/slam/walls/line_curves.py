"""Pieces of curved surfaces among the segments of a scan: they are no walls.

Split and merge cuts a curve into chords. Where it cuts depends on noise and on where the laser
stands, so that a chord is no surface that another scan sees again: among the chords of a round hall
there is one for every direction, and each pose finds walls that agree with it.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.kernels import kernel

MAX_RUN = 8
"""Neighbours that one arc may explain, at most (chosen: a longer curve is several arcs)."""

LINE_PARAMETERS, ARC_PARAMETERS = 2, 3
"""Free parameters of a shape; where it ends is one more."""

MIN_SIGMA = 1e-4
"""Noise of a point across its surface, at least, m (chosen: of points without noise)."""


@kernel
def curved_segments(
    beams: Float64, labels: Int32, max_gap: float, min_bend: float
) -> Bool:  # pragma: no cover - compiled
    """Tell which segments are pieces of a curve.

    Runs of neighbours are explained by a line for each, by one line, or by one arc, whichever has
    the smallest Bayesian information criterion over the scan (Schwarz 1978, "Estimating the
    dimension of a model"; by dynamic programming). Pieces of an arc that bends are pieces of a
    curve. The arc is a parabola here, which differs by a millimetre over a tenth
    of a circle. The noise is what the lines of all pieces leave.

    Parameters
    ----------
    beams
        float64 (B, 2), m, in beam order.
    labels
        int32 (B,), as of `split_segments`: segments in beam order, or -1.
    max_gap
        Largest distance between neighbours, m.
    min_bend
        Pieces are of one wall where the arc bends by less (rad) from the middle of the first to the
        middle of the last.

    Returns
    -------
    bool (L,), for each segment
    """
    points, starts = _by_segment(beams, labels)
    count = len(starts) - 1
    curved = np.zeros(count, np.bool_)
    if count < 2:
        return curved
    variance = _variance(points, starts)
    parameter = np.log(max(len(points), 2))
    # The least cost of the pieces before each, the run that ends there, and whether it is an arc.
    costs, runs, arcs = np.zeros(count + 1), np.ones(count + 1, np.int64), curved.copy()
    for end in range(1, count + 1):
        costs[end] = np.inf
        for first in range(end - 1, max(end - 1 - MAX_RUN, -1), -1):
            if first < end - 1 and _gap(points, starts[first + 1]) > max_gap:
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
            if arc / variance > costs[end]:  # a longer run leaves no less
                break
    end = count
    while end > 0:
        curved[end - runs[end] : end] = arcs[end - 1]
        end -= runs[end]
    return curved


@kernel
def _by_segment(
    beams: Float64, labels: Int32
) -> tuple[Float64, Int64]:  # pragma: no cover - compiled
    """Return the points of all segments, one after the other, and where each starts.

    A scan may wrap around within a segment: its points begin where the label does.
    """
    n, count = len(beams), 0
    for i in range(n):
        count = max(count, labels[i] + 1)
    starts = np.zeros(count + 1, np.int64)
    for i in range(n):
        if labels[i] >= 0:
            starts[labels[i] + 1] += 1
    starts = np.cumsum(starts)
    points, fill = np.empty((starts[count], 2)), starts[:-1].copy()
    seam = 0
    while seam < n and labels[seam] >= 0 and labels[seam] == labels[seam - 1]:
        seam += 1
    for i in range(n):
        k = labels[(seam + i) % n]
        if k >= 0:
            points[fill[k]] = beams[(seam + i) % n]
            fill[k] += 1
    return points, starts


@kernel
def _variance(points: Float64, starts: Int64) -> float:  # pragma: no cover - compiled
    """Return the variance across the lines of all segments, m2."""
    squares, freedom = 0.0, 0
    for k in range(len(starts) - 1):
        piece = points[starts[k] : starts[k + 1]]
        squares += _residuals(piece)[0]
        freedom += len(piece) - LINE_PARAMETERS
    return max(squares / max(freedom, 1), MIN_SIGMA**2)


@kernel
def _gap(points: Float64, i: int) -> float:  # pragma: no cover - compiled
    """Return the distance of a point from the one before it."""
    return np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])


@kernel
def _length(points: Float64) -> float:  # pragma: no cover - compiled
    return np.hypot(points[-1, 0] - points[0, 0], points[-1, 1] - points[0, 1])


@kernel
def _residuals(points: Float64) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the squared residuals of a line and of a parabola, m2, and its curvature, 1/m.

    Both are least squares across the chord from the first point to the last.
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
    # The square of t, without what a line explains of it: its square sum, and its sum with y.
    qq = max(t4 - t2 * t2 / n - t3 * t3 / t2, 1e-18)
    qy = tty - t3 * ty / t2
    return line, max(line - qy * qy / qq, 0.0), abs(2.0 * qy / qq)
