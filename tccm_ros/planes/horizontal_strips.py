"""Horizontal strips: narrow horizontal surfaces on which only a few scan lines of a cycle lie.

The laser sees a ledge, or a board just below it, at so flat an angle that only one to five scan
lines of a tilt cycle are on it: too few cells for a plane. On a vertical object successive lines
differ in height by the line spacing. Two lines at *one* height, one further away than the other,
are on a horizontal surface. *Runs* of neighbouring beams at one height are therefore found in each
line:

- a run with a part on a horizontal plane belongs to that plane as a whole;
- runs of neighbouring lines whose heights agree within their noise form a strip;
- a long straight run without points straight above or below it is a strip by itself; other views
  decide whether it belongs to a ledge.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.planes.inliers import MIN_INSIDE
from tccm_ros.robust import GATE, MAJORITY, UNIFORM_WIDTH
from tccm_ros.union_find import find_root, merge_sets

TOLERANCE = 0.006
"""Maximum distance of a run's points from its mean height, m. Chosen: three standard deviations of
the noisiest laser at a grazing angle."""

MAX_RISE = 0.0015
"""Maximum rise of a run from end to end beyond its noise, m: a laser that is not exactly level.
With the flatness of surfaces, 1.3 mm, random flat 201 has an overlap of .932 in place of .938."""

MIN_BEAMS = 6
"""Minimum number of beams of a run, so that its slope is significant. Chosen."""

MAX_BEAMS = 3.5
"""Maximum angle between neighbours of a run, in steps between beams: two lost beams. Chosen."""

SPLIT_FRACTION = 0.7
"""A run is split if two straight lines leave less than this fraction of the squared residuals of
one line. Chosen."""

RUN = np.dtype(
    [
        ("line", np.int64),
        ("first", np.float64),  # azimuth of the first beam, rad
        ("last", np.float64),  # and of the last
        ("height", np.float64),  # mean, m
        ("height_sigma", np.float64),  # its standard error, m
        ("points", np.int64),
        ("begin", np.float64, 2),  # x and y of the middle of its first half, m
        ("end", np.float64, 2),  # and of its second half
    ],
    align=True,
)
"""A run: neighbouring beams of one line that end at one height."""

Runs = NDArray[Any]
"""An array of `RUN`."""

MAX_LINES = 2
"""Maximum difference of the line numbers of linked runs: one line may be missing. Chosen."""

MAX_OFFSET = 0.015
"""Maximum horizontal distance of points straight above each other, and minimum distance of linked
runs, as nearer lines may also be on a front, m. Chosen: nearly two standard deviations of the
difference of two beams of the noisiest laser."""

MIN_WIDTH = 0.03
"""Minimum width of a strip of several lines, m, from the variance of a uniform distribution: a
vertical object has no width. A narrower strip is a line, whose runs must not be vertical. A wide
strip of one bent line is rejected. Chosen."""

MIN_LENGTH = 0.30
"""Minimum length of a strip, m: shorter ones are tops of objects. The distance of linked
runs is at most this, and at most the length of the shorter run: otherwise two objects of one height
are as likely as one. Chosen."""


def horizontal_strips(points: Float64, lines: Int64, surface: Int64, viewpoint: Float64) -> Int64:
    """Return the horizontal surfaces of a tilt cycle, completed by the runs in its scan lines.

    Parameters
    ----------
    points
        float64 (M, 3), m, in odom.
    lines
        int64 (M,), the scan of each point within the tilt cycle.
    surface
        int64 (M,), the horizontal plane of each point, -1 for none.
    viewpoint
        float64 (3,), position of the laser in odom.

    Returns
    -------
    int64 (M,): `surface` where it is not -1, else the plane of the point's run, else the number of
    its strip, which follows the numbers of planes; -1 for none.
    """
    chosen = np.flatnonzero(points[:, 2] < viewpoint[2])
    scan = lines[chosen]
    seen = points[chosen] - viewpoint
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    order = np.lexsort((azimuth, scan))
    chosen, scan, seen, azimuth = chosen[order], scan[order], seen[order], azimuth[order]
    step = _beam_step(scan, azimuth)
    of_point, runs = find_runs(scan, seen, azimuth, step)
    is_vertical = find_vertical_runs(scan, seen, azimuth, step, of_point, runs)
    strips = _strips(link_runs(runs, is_vertical, step), is_vertical, of_point, runs, seen)
    strips[strips >= 0] += surface.max(initial=-1) + 1
    plane = _plane_of_runs(of_point, surface[chosen], len(runs))
    of_run = np.where(plane < 0, strips, np.where(is_vertical, -1, plane))
    completed = surface.copy()
    of_none = (of_point >= 0) & (surface[chosen] < 0)
    completed[chosen[of_none]] = of_run[of_point[of_none]]
    return completed


def _plane_of_runs(of_point: Int64, surface: Int64, runs: int) -> Int64:
    """Return the horizontal plane on which most points of each run lie, int64 (R,), -1 for none."""
    on = (of_point >= 0) & (surface >= 0)
    planes = surface.max(initial=0) + 1
    pairs, count = np.unique(of_point[on] * planes + surface[on], return_counts=True)
    run, of_run = np.divmod(pairs, planes)
    plane = np.full(runs, -1, np.int64)
    order = np.lexsort((-of_run, count))  # the last assignment stays: most points, first plane
    plane[run[order]] = of_run[order]
    return plane


def _beam_step(scan: Int64, azimuth: Float64) -> float:
    """Return the angle between neighbouring beams, rad."""
    steps = np.diff(azimuth)[np.diff(scan) == 0]
    return float(np.median(steps)) if len(steps) else 0.0


@kernel
def find_vertical_runs(
    scan: Int64, seen: Float64, azimuth: Float64, step: float, of_point: Int64, runs: Runs
) -> Bool:
    """Return which runs have points of the line before or after straight above or below them.

    These points have the same horizontal distance at the same bearing, also at corners of the run.

    Parameters
    ----------
    scan, seen, azimuth, step
        As in `find_runs`.
    of_point, runs
        Results of `find_runs`.

    Returns
    -------
    bool (R,)
    """
    is_vertical = np.zeros(len(runs), np.bool_)
    own = np.empty(len(scan), np.int64)
    for r in range(len(runs)):
        run, count = runs[r], 0
        at, end = np.searchsorted(scan, run.line), np.searchsorted(scan, run.line + 1)
        at += np.searchsorted(azimuth[at:end], run.first)
        while count < run.points:
            if of_point[at] == r:
                own[count] = at
                count += 1
            at += 1
        beams = (run.last - run.first) / step + 1.0 if step > 0.0 else 1.0
        for line in (run.line - 1, run.line + 1):
            same, m = 0, 0
            k, end = np.searchsorted(scan, line), np.searchsorted(scan, line + 1)
            k += np.searchsorted(azimuth[k:end], run.first)
            while k < end and azimuth[k] <= run.last:
                while m < count - 2 and azimuth[own[m + 1]] < azimuth[k]:
                    m += 1
                away = distance_at(seen, azimuth, own[m], own[m + 1], azimuth[k])
                rises = abs(seen[k, 2] - run.height) > 2.0 * MAX_RISE
                same += rises and abs(away - math.hypot(seen[k, 0], seen[k, 1])) <= MAX_OFFSET
                k += 1
            if same >= MAJORITY * beams:
                is_vertical[r] = True
    return is_vertical


@kernel
def distance_at(seen: Float64, azimuth: Float64, a: int, b: int, bearing: float) -> float:
    """Return the horizontal distance of the line between two points at a bearing, m.

    Parameters
    ----------
    seen, azimuth
        As in `find_runs`.
    a, b
        Indices of the points.
    bearing
        rad, clipped to the bearings of the points.
    """
    wide = azimuth[b] - azimuth[a]
    fraction = (bearing - azimuth[a]) / wide if wide > 0.0 else 0.0
    near, far = math.hypot(seen[a, 0], seen[a, 1]), math.hypot(seen[b, 0], seen[b, 1])
    return near + min(max(fraction, 0.0), 1.0) * (far - near)


@kernel
def link_runs(runs: Runs, is_vertical: Bool, step: float) -> Int64:
    """Return connected sets of runs: runs of equal height in neighbouring lines are linked.

    Parameters
    ----------
    runs
        (R,), `RUN`, by line.
    is_vertical
        bool (R,), of `find_vertical_runs`.
    step
        Angle between neighbouring beams, rad.

    Returns
    -------
    int64 (R,), the first run of each run's connected set.
    """
    parent = np.arange(len(runs)).astype(np.int32)
    begin = 0
    for b in range(len(runs)):
        one = runs[b]
        while one.line - runs[begin].line > MAX_LINES:
            begin += 1
        for a in range(begin, b):
            other = runs[a]
            if other.line == one.line:
                break
            low, high = max(other.first, one.first), min(other.last, one.last)
            if (is_vertical[a] and is_vertical[b]) or low - high > MAX_BEAMS * step:
                continue
            noise = math.sqrt(other.height_sigma**2 + one.height_sigma**2)
            if abs(other.height - one.height) > MAX_RISE + GATE * noise:
                continue
            distance, longest = distance_between(other, one)
            if MAX_OFFSET <= distance <= min(MIN_LENGTH, longest):
                merge_sets(parent, a, b)
    roots = np.empty(len(runs), np.int64)
    for k in range(len(runs)):
        roots[k] = find_root(parent, k)
    return roots


@kernel
def distance_between(a: Any, b: Any) -> tuple[float, float]:
    """Return the distance of two runs and the length of the shorter one, m.

    The distance is that of the middle of the shorter run from the line through the longer one.
    """
    dx, dy = a.end[0] - a.begin[0], a.end[1] - a.begin[1]
    ex, ey = b.end[0] - b.begin[0], b.end[1] - b.begin[1]
    if ex * ex + ey * ey > dx * dx + dy * dy:
        a, b, dx, dy, ex, ey = b, a, ex, ey, dx, dy
    x = 0.5 * (b.begin[0] + b.end[0]) - a.begin[0]
    y = 0.5 * (b.begin[1] + b.end[1]) - a.begin[1]
    distance = abs(dx * y - dy * x) / math.sqrt(dx * dx + dy * dy)
    return distance, 2.0 * math.sqrt(ex * ex + ey * ey)


def _strips(roots: Int64, is_vertical: Bool, of_point: Int64, runs: Runs, seen: Float64) -> Int64:
    """Return the number of each run's strip, from 0, -1 where it is too small; int64 (R,)."""
    _, group = np.unique(roots, return_inverse=True)
    on = of_point >= 0
    width, length = _extents(group[of_point[on]], seen[on, :2])
    line = runs["line"]
    first, last = np.full(len(width), line.max(initial=0)), np.zeros(len(width), np.int64)
    np.minimum.at(first, group, line)
    np.maximum.at(last, group, line)
    is_wide = (first < last) & (width >= MIN_WIDTH)
    is_line = (np.bincount(group, is_vertical) == 0) & (width < MIN_WIDTH)
    is_large = (np.bincount(group, runs["points"]) >= MIN_INSIDE) & (length >= MIN_LENGTH)
    chosen = is_large & (is_wide | is_line)
    number = np.where(chosen, np.cumsum(chosen) - 1, -1)
    return number[group]


def _extents(group: Int64, xy: Float64) -> tuple[Float64, Float64]:
    """Return width and length of groups of points, float64 (G,), m, from their variances.

    Points are taken as uniformly distributed.
    """
    count = np.bincount(group)
    x, y = (np.bincount(group, xy[:, k]) / count for k in range(2))
    dx, dy = xy[:, 0] - x[group], xy[:, 1] - y[group]
    xx, xy_, yy = (np.bincount(group, product) / count for product in (dx * dx, dx * dy, dy * dy))
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy_)
    variances = np.maximum(middle - half, 0.0), middle + half
    return UNIFORM_WIDTH * np.sqrt(variances[0]), UNIFORM_WIDTH * np.sqrt(variances[1])


@kernel
def find_runs(scan: Int64, seen: Float64, azimuth: Float64, step: float) -> tuple[Int64, Runs]:
    """Return the horizontal runs of all lines.

    Parameters
    ----------
    scan, azimuth
        int64 (N,) and float64 (N,): line and bearing of the points, which are sorted by both.
    seen
        float64 (N, 3), the points relative to the laser, m.
    step
        Angle between neighbouring beams, rad.

    Returns
    -------
    of_point : int64 (N,)
        Run of each point, -1 for none.
    runs : (R,), `RUN`
    """
    n = len(scan)
    of_point, members = np.full(n, -1, np.int64), np.empty(n, np.int64)
    sums = np.zeros((n + 1, 5))
    runs = np.empty(n // MIN_BEAMS + 1, RUN)
    ranges = np.empty((n + 1, 2), np.int64)
    found, first = 0, 0
    while first < n:
        count, total = 0, 0.0
        i, last = first, first
        while i < n and scan[i] == scan[first] and azimuth[i] - azimuth[last] <= MAX_BEAMS * step:
            if count == 0 or abs(seen[i, 2] - total / count) <= TOLERANCE:
                members[count] = last = i
                count += 1
                total += seen[i, 2]
            i += 1
        running_sums(seen, azimuth, members, count, sums)
        ranges[0, 0], ranges[0, 1] = 0, count
        height = 1
        while height:
            height -= 1
            low, high = ranges[height, 0], ranges[height, 1]
            if high - low < MIN_BEAMS:
                continue
            if is_horizontal(sums, low, high, runs[found]):
                write_run(scan, seen, azimuth, members, low, high, runs[found])
                for k in range(low, high):
                    of_point[members[k]] = found
                found += 1
                continue
            middle = best_split(sums, low, high)
            if middle < 0:  # straight, but not horizontal
                continue
            ranges[height, 0], ranges[height, 1] = middle, high
            ranges[height + 1, 0], ranges[height + 1, 1] = low, middle
            height += 2
        first = last + 1
    return of_point, runs[:found]


@kernel
def running_sums(
    seen: Float64, azimuth: Float64, members: Int64, count: int, sums: Float64
) -> None:
    """Write running sums of azimuth, height and their products over the members of a run.

    Parameters
    ----------
    seen, azimuth
        As in `find_runs`.
    members, count
        int64 (>= count,), the points of the run, and their number.
    sums
        float64 (> count, 5), row 0 zero: receives the sums over the first k members in row k.
    """
    for k in range(count):
        a = azimuth[members[k]] - azimuth[members[0]]
        z = seen[members[k], 2] - seen[members[0], 2]
        sums[k + 1, 0] = sums[k, 0] + a
        sums[k + 1, 1] = sums[k, 1] + z
        sums[k + 1, 2] = sums[k, 2] + a * a
        sums[k + 1, 3] = sums[k, 3] + a * z
        sums[k + 1, 4] = sums[k, 4] + z * z


@kernel
def line_through(sums: Float64, low: int, high: int) -> tuple[float, float, float]:
    """Return slope, m/rad, squared residuals, m2, and spread, rad2, of a part of a run.

    Parameters
    ----------
    sums
        Result of `running_sums`.
    low, high
        The members [low, high) of the run.
    """
    n = high - low
    a, z = sums[high, 0] - sums[low, 0], sums[high, 1] - sums[low, 1]
    aa = sums[high, 2] - sums[low, 2] - a * a / n
    az = sums[high, 3] - sums[low, 3] - a * z / n
    zz = sums[high, 4] - sums[low, 4] - z * z / n
    slope = az / aa if aa > 0.0 else 0.0
    return slope, max(zz - slope * az, 0.0), aa


@kernel
def best_split(sums: Float64, low: int, high: int) -> int:
    """Return the index at which to split a run into two straight parts, -1 if one line suffices.

    Parameters
    ----------
    sums, low, high
        As in `line_through`.
    """
    best, middle = SPLIT_FRACTION * line_through(sums, low, high)[1], -1
    for k in range(low + 3, high - 2):
        rest = line_through(sums, low, k)[1] + line_through(sums, k, high)[1]
        if rest < best:
            best, middle = rest, k
    return middle


@kernel
def is_horizontal(sums: Float64, low: int, high: int, run: Any) -> bool:
    """Return whether a part of a run is horizontal, and write the standard error of its height.

    Parameters
    ----------
    sums, low, high
        As in `line_through`.
    run
        `RUN`, its `height_sigma` is written.
    """
    n = high - low
    slope, squares, spread = line_through(sums, low, high)
    noise = math.sqrt(squares / (n - 2.0))
    run.height_sigma = noise / math.sqrt(n)
    rise = abs(slope) * UNIFORM_WIDTH * math.sqrt(spread / n)
    return rise <= MAX_RISE + GATE * noise * UNIFORM_WIDTH / math.sqrt(n)


@kernel
def write_run(
    scan: Int64, seen: Float64, azimuth: Float64, members: Int64, low: int, high: int, run: Any
) -> None:
    """Write all fields of a run except `height_sigma`.

    Parameters
    ----------
    scan, seen, azimuth
        As in `find_runs`.
    members, low, high
        The run's points are ``members[low:high]``.
    run
        `RUN`, written.
    """
    first, last, z = members[low], members[high - 1], 0.0
    for k in range(low, high):
        z += seen[members[k], 2]
    run.line, run.points = scan[first], high - low
    run.first, run.last = azimuth[first], azimuth[last]
    run.height = z / (high - low)
    half = (high - low) // 2
    run.begin[:] = 0.0
    run.end[:] = 0.0
    for k in range(half):
        a, b = members[low + k], members[high - 1 - k]
        for axis in range(2):
            run.begin[axis] += seen[a, axis] / half
            run.end[axis] += seen[b, axis] / half
