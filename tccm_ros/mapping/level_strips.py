"""Level strips: what few lines of a sweep saw of a narrow level surface.

The laser looks along a ledge, or onto a board just below it, so flatly that one to five lines of a
sweep lie on it: too few cells for a plane. Yet each line tells more than its few points say. Where
the lines of a tilting laser run over upright things, each lies at a height of its own, a line's
spacing above the one before. Two lines at *one* height, one further away than the other, lie on
something level. So runs of neighbouring beams at one height are found in each line, and runs of
neighbouring lines are put together that have one height within what the noise leaves open.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.mapping.level_runs import BEAM_GAPS, LEVEL, SIGMAS, find_runs
from tccm_ros.mapping.linking import join, root_of

__all__ = ["level_strips"]

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
"""Straight above or below is within this, m: two to three deviations of the noisiest laser."""

LEAST_POINTS = 20
"""Points of a strip."""

LEAST_WIDTH = 0.03
"""Width of a strip, m, as that of an even spread: an upright thing has none."""

LEAST_LENGTH = 0.30
"""And its length, m: what is shorter and as narrow is the top of a thing."""


def level_strips(
    points: Float64, lines: Index, candidates: Flags, viewpoint: Float64
) -> NDArray[np.int32]:
    """Find the strips of a sweep.

    Parameters
    ----------
    points
        float64 (M, 3), m, in odom.
    lines
        int64 (M,), the scan of each point within the sweep.
    candidates
        bool (M,), those that may be of a strip.
    viewpoint
        float64 (3,), the laser in odom.

    Returns
    -------
    int32 (M,), number of each point's strip, from 0; -1 for none.
    """
    strips = np.full(len(points), -1, np.int32)
    chosen = np.flatnonzero(candidates & (points[:, 2] < viewpoint[2]))
    scan = lines[chosen]
    seen = points[chosen] - viewpoint
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    order = np.lexsort((azimuth, scan))
    chosen, scan, seen, azimuth = chosen[order], scan[order], seen[order], azimuth[order]
    step = _usual_step(scan, azimuth)
    of_point, runs = find_runs(scan, seen, azimuth, step)
    upright = goes_on_upright(scan, seen, azimuth, step, runs)
    roots = link_runs(runs, upright, step)
    number = _large_enough(roots, of_point, runs, seen)
    on = of_point >= 0
    strips[chosen[on]] = number[of_point[on]]
    return strips


def _usual_step(scan: Index, azimuth: Float64) -> float:
    """Return the angle between neighbouring beams, rad."""
    steps = np.diff(azimuth)[np.diff(scan) == 0]
    return float(np.median(steps)) if len(steps) else 0.0


@njit(nogil=True, cache=True)
def goes_on_upright(
    scan: Index, seen: Float64, azimuth: Float64, step: float, runs: Float64
) -> Flags:
    """Tell of which runs the line before or after lies straight above or below; bool (R,)."""
    upright = np.zeros(len(runs), np.bool_)
    for r in range(len(runs)):
        row = runs[r]
        dx, dy = row[8] - row[6], row[9] - row[7]
        length = math.sqrt(dx * dx + dy * dy)
        beams = (row[2] - row[1]) / step + 1.0 if step > 0.0 else 1.0
        for line in (row[0] - 1.0, row[0] + 1.0):
            same = 0
            k, end = np.searchsorted(scan, int(line)), np.searchsorted(scan, int(line) + 1)
            k += np.searchsorted(azimuth[k:end], row[1])
            while k < end and azimuth[k] <= row[2]:
                away = dx * (seen[k, 1] - row[7]) - dy * (seen[k, 0] - row[6])
                rises = abs(seen[k, 2] - row[3]) > 2.0 * LEVEL
                same += rises and abs(away) <= STRAIGHT * length
                k += 1
            if same >= UPRIGHT_SHARE * beams:
                upright[r] = True
    return upright


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


def _large_enough(roots: Index, of_point: Index, runs: Float64, seen: Float64) -> NDArray[np.int32]:
    """Return the number of each run's strip, -1 where it is too small; int32 (R,)."""
    number, found = np.full(len(runs), -1, np.int32), 0
    of_root = np.full(len(of_point), -1, np.int64)
    of_root[of_point >= 0] = roots[of_point[of_point >= 0]]
    for root in np.unique(roots):
        its = roots == root
        if len(np.unique(runs[its, 0])) < 2 or runs[its, 5].sum() < LEAST_POINTS:
            continue
        spread = np.linalg.eigvalsh(np.cov(seen[of_root == root, :2].T))
        width, length = np.sqrt(12.0 * np.maximum(spread, 0.0))
        if width < LEAST_WIDTH or length < LEAST_LENGTH:
            continue
        number[its] = found
        found += 1
    return number
