"""Level strips: what few lines of a sweep saw of a narrow level surface.

The laser looks along a ledge, or onto a board just below it, so flatly that one to five lines of a
sweep lie on it: too few cells for a plane. Yet each line tells more than its few points say. Where
the lines of a tilting laser run over upright things, each lies at a height of its own, a line's
spacing above the one before. Two lines at *one* height, one further away than the other, lie on
something level. So runs of neighbouring beams at one height are found in each line, and

- a run that lies on a level plane in part lies on it as a whole;
- runs of neighbouring lines that have one height within what the noise leaves open are a strip;
- a long straight run that nothing is straight above or below of is handed over by itself: whether
  it is one of a ledge, other views tell.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.cuboids.linking import join, root_of
from tccm_ros.planes.level_runs import BEAM_GAPS, LEVEL, SIGMAS, find_runs

__all__ = ["LEAST_WIDTH", "level_strips"]

Float64 = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

LINES = 2
"""Neighbouring runs are at most so many lines apart: one line may be lost to noise."""

APART = 0.015
"""... and at least this far, m: lines nearer to each other do not tell a top from a front."""

WIDEST = 0.30
"""Runs further apart than this are not taken for one surface, m; nor are runs that are further
apart than the shorter one is long: two things of one height stand there as well as one."""

UPRIGHT_SHARE = 0.5
"""A run lies at something upright where for this share of its beams those of a neighbouring line
are straight above or below. One run of two may: it lies at the rim of a board."""

STRAIGHT = 0.015
"""Straight above or below is within this, m: nearly two deviations of what lies between two beams
of the noisiest laser."""

LEAST_POINTS = 20
"""Points of a strip."""

LEAST_WIDTH = 0.03
"""Width of a strip, m, as that of an even spread: an upright thing has none. What is narrower is a
line, and must not go on upright anywhere. A line that bends is neither."""

LEAST_LENGTH = 0.30
"""And its length, m: what is shorter and as narrow is the top of a thing."""


def level_strips(points: Float64, lines: Index, surface: Index, viewpoint: Float64) -> Index:
    """Complete the level surfaces of a sweep by what its lines tell.

    Parameters
    ----------
    points
        float64 (M, 3), m, in odom.
    lines
        int64 (M,), the scan of each point within the sweep.
    surface
        int64 (M,), the level plane of each point, -1 for none.
    viewpoint
        float64 (3,), the laser in odom.

    Returns
    -------
    int64 (M,), `surface` where a point has one. Of the others: the plane on which their run lies,
    or the number of their strip, which follow those of the planes; -1 for none.
    """
    chosen = np.flatnonzero(points[:, 2] < viewpoint[2])
    scan = lines[chosen]
    seen = points[chosen] - viewpoint
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    order = np.lexsort((azimuth, scan))
    chosen, scan, seen, azimuth = chosen[order], scan[order], seen[order], azimuth[order]
    step = _usual_step(scan, azimuth)
    of_point, runs = find_runs(scan, seen, azimuth, step)
    upright = goes_on_upright(scan, seen, azimuth, step, of_point, runs)
    strips = _strips(link_runs(runs, upright, step), upright, of_point, runs, seen)
    strips[strips >= 0] += surface.max(initial=-1) + 1
    plane = _plane_of_runs(of_point, surface[chosen], len(runs))
    of_run = np.where(plane < 0, strips, np.where(upright, -1, plane))
    completed = surface.copy()
    of_none = (of_point >= 0) & (surface[chosen] < 0)
    completed[chosen[of_none]] = of_run[of_point[of_none]]
    return completed


def _plane_of_runs(of_point: Index, surface: Index, runs: int) -> Index:
    """Return the level plane on which most points of each run lie, int64 (R,), -1 for none."""
    on = (of_point >= 0) & (surface >= 0)
    planes = surface.max(initial=0) + 1
    pairs, count = np.unique(of_point[on] * planes + surface[on], return_counts=True)
    run, of_run = np.divmod(pairs, planes)
    plane = np.full(runs, -1, np.int64)
    order = np.lexsort((-of_run, count))  # the last one stands: most points, first plane
    plane[run[order]] = of_run[order]
    return plane


def _usual_step(scan: Index, azimuth: Float64) -> float:
    """Return the angle between neighbouring beams, rad."""
    steps = np.diff(azimuth)[np.diff(scan) == 0]
    return float(np.median(steps)) if len(steps) else 0.0


@njit(nogil=True, cache=True)
def goes_on_upright(
    scan: Index, seen: Float64, azimuth: Float64, step: float, of_point: Index, runs: Float64
) -> Flags:
    """Tell of which runs the line before or after lies straight above or below; bool (R,).

    It does where it is as far away at the same bearing, whatever corners the run has.
    """
    upright = np.zeros(len(runs), np.bool_)
    own = np.empty(len(scan), np.int64)
    for r in range(len(runs)):
        row, count = runs[r], 0
        first, end = np.searchsorted(scan, int(row[0])), np.searchsorted(scan, int(row[0]) + 1)
        first += np.searchsorted(azimuth[first:end], row[1])
        while count < row[5]:
            if of_point[first] == r:
                own[count] = first
                count += 1
            first += 1
        beams = (row[2] - row[1]) / step + 1.0 if step > 0.0 else 1.0
        for line in (row[0] - 1.0, row[0] + 1.0):
            same, m = 0, 0
            k, end = np.searchsorted(scan, int(line)), np.searchsorted(scan, int(line) + 1)
            k += np.searchsorted(azimuth[k:end], row[1])
            while k < end and azimuth[k] <= row[2]:
                while m < count - 2 and azimuth[own[m + 1]] < azimuth[k]:
                    m += 1
                away = distance_at(seen, azimuth, own[m], own[m + 1], azimuth[k])
                rises = abs(seen[k, 2] - row[3]) > 2.0 * LEVEL
                same += rises and abs(away - math.hypot(seen[k, 0], seen[k, 1])) <= STRAIGHT
                k += 1
            if same >= UPRIGHT_SHARE * beams:
                upright[r] = True
    return upright


@njit(nogil=True, cache=True)
def distance_at(seen: Float64, azimuth: Float64, a: int, b: int, bearing: float) -> float:
    """Return how far away, seen from above, the line between two points is at a bearing, m."""
    wide = azimuth[b] - azimuth[a]
    share = (bearing - azimuth[a]) / wide if wide > 0.0 else 0.0
    near, far = math.hypot(seen[a, 0], seen[a, 1]), math.hypot(seen[b, 0], seen[b, 1])
    return near + min(max(share, 0.0), 1.0) * (far - near)


@njit(nogil=True, cache=True)
def link_runs(runs: Float64, upright: Flags, step: float) -> Index:
    """Put runs of neighbouring lines together that have one height; int64 (R,), their roots."""
    parent = np.arange(len(runs)).astype(np.int32)
    begin = 0
    for b in range(len(runs)):
        while runs[b, 0] - runs[begin, 0] > LINES:
            begin += 1
        for a in range(begin, b):
            if runs[a, 0] == runs[b, 0]:
                break
            low, high = max(runs[a, 1], runs[b, 1]), min(runs[a, 2], runs[b, 2])
            if (upright[a] and upright[b]) or low - high > BEAM_GAPS * step:
                continue
            noise = math.sqrt(runs[a, 4] ** 2 + runs[b, 4] ** 2)
            if abs(runs[a, 3] - runs[b, 3]) > LEVEL + SIGMAS * noise:
                continue
            apart, longest = distance_between(runs[a], runs[b])
            if APART <= apart <= min(WIDEST, longest):
                join(parent, a, b)
    roots = np.empty(len(runs), np.int64)
    for k in range(len(runs)):
        roots[k] = root_of(parent, k)
    return roots


@njit(nogil=True, cache=True)
def distance_between(a: Float64, b: Float64) -> tuple[float, float]:
    """Return how far the middle of the shorter run is from the line of the longer one, and its
    length, m.
    """
    dx, dy = a[8] - a[6], a[9] - a[7]
    ex, ey = b[8] - b[6], b[9] - b[7]
    if ex * ex + ey * ey > dx * dx + dy * dy:
        a, b, dx, dy, ex, ey = b, a, ex, ey, dx, dy
    x, y = 0.5 * (b[6] + b[8]) - a[6], 0.5 * (b[7] + b[9]) - a[7]
    apart = abs(dx * y - dy * x) / math.sqrt(dx * dx + dy * dy)
    return apart, 2.0 * math.sqrt(ex * ex + ey * ey)


def _strips(roots: Index, upright: Flags, of_point: Index, runs: Float64, seen: Float64) -> Index:
    """Return the number of each run's strip, from 0, -1 where it is too small; int64 (R,)."""
    _, group = np.unique(roots, return_inverse=True)
    on = of_point >= 0
    width, length = _extents(group[of_point[on]], seen[on, :2])
    line = runs[:, 0].astype(np.int64)
    first, last = np.full(len(width), line.max(initial=0)), np.zeros(len(width), np.int64)
    np.minimum.at(first, group, line)
    np.maximum.at(last, group, line)
    is_wide = (first < last) & (width >= LEAST_WIDTH)
    is_line = (np.bincount(group, upright) == 0) & (width < LEAST_WIDTH)
    is_large = (np.bincount(group, runs[:, 5]) >= LEAST_POINTS) & (length >= LEAST_LENGTH)
    chosen = is_large & (is_wide | is_line)
    number = np.where(chosen, np.cumsum(chosen) - 1, -1)
    return number[group]


def _extents(group: Index, xy: Float64) -> tuple[Float64, Float64]:
    """Return width and length of groups of points, float64 (G,), m, as those of an even spread."""
    count = np.bincount(group)
    x, y = (np.bincount(group, xy[:, k]) / count for k in range(2))
    dx, dy = xy[:, 0] - x[group], xy[:, 1] - y[group]
    xx, xy_, yy = (np.bincount(group, product) / count for product in (dx * dx, dx * dy, dy * dy))
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy_)
    return np.sqrt(12.0 * np.maximum(middle - half, 0.0)), np.sqrt(12.0 * (middle + half))
