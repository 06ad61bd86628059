"""Level runs: neighbouring beams of one line of a sweep that end at one height."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["BEAM_GAPS", "LEVEL", "SIGMAS", "find_runs"]

Float64 = NDArray[np.float64]
Index = NDArray[np.int64]

TOLERANCE = 0.006
"""Points further than this from the height of their run are not of it, m: three deviations of the
noisiest laser, seen as flatly as this."""

LEVEL = 0.0015
"""Runs may rise by this much from end to end beyond their noise, m: a laser that is not quite
upright."""

SIGMAS = 3.0

FEWEST = 6
"""Beams of a run: its slope is to be told from its noise."""

BEAM_GAPS = 3.5
"""Neighbours of a run are at most so many beams apart."""

BENT = 0.7
"""A run is two where two straight lines leave less than this share of the squares that one does."""

SLANT = 4.0
"""Neighbours of a run are at most so many times as far apart as across the line of sight,"""

NOISE = 0.02
"""and this, m."""

RUN_COLUMNS = 10
"""Of a run: line; first and last azimuth, rad; mean height, m; its standard error, m; points; x and
y of the middles of its first and of its second half, m."""


@njit(nogil=True, cache=True)
def find_runs(scan: Index, seen: Float64, azimuth: Float64, step: float) -> tuple[Index, Float64]:
    """Find the level runs of all lines.

    Parameters
    ----------
    scan, azimuth
        int64 (N,) and float64 (N,): line and bearing of the points, which are sorted by both.
    seen
        float64 (N, 3), the points from the laser, m.
    step
        Angle between neighbouring beams, rad.

    Returns
    -------
    of_point : int64 (N,)
        Run of each point, -1 for none.
    runs : float64 (R, RUN_COLUMNS)
    """
    n = len(scan)
    of_point, taken = np.full(n, -1, np.int64), np.zeros(n, np.bool_)
    members, sums = np.empty(n, np.int64), np.zeros((n + 1, 5))
    runs = np.empty((n // FEWEST + 1, RUN_COLUMNS))
    ranges = np.empty((n + 1, 2), np.int64)
    found, first = 0, 0
    while first < n:
        count, total = 0, 0.0
        i, last = first, first
        while i < n and scan[i] == scan[first] and azimuth[i] - azimuth[last] <= BEAM_GAPS * step:
            close = count == 0 or abs(seen[i, 2] - total / count) <= TOLERANCE
            if close and not taken[i] and is_near(seen, last, i):
                members[count] = last = i
                count += 1
                total += seen[i, 2]
            i += 1
        add_up(seen, azimuth, members, count, sums)
        ranges[0, 0], ranges[0, 1] = 0, count
        height = 1
        while height:
            height -= 1
            low, high = ranges[height, 0], ranges[height, 1]
            if high - low < FEWEST:
                continue
            if is_level(sums, low, high, runs[found]):
                write_run(scan, seen, azimuth, members, low, high, runs[found])
                for k in range(low, high):
                    of_point[members[k]] = found
                    taken[members[k]] = True
                found += 1
                continue
            middle = best_split(sums, low, high)
            if middle < 0:  # straight, but not level
                continue
            ranges[height, 0], ranges[height, 1] = middle, high
            ranges[height + 1, 0], ranges[height + 1, 1] = low, middle
            height += 2
        first = last + 1
    return of_point, runs[:found]


@njit(nogil=True, cache=True)
def add_up(seen: Float64, azimuth: Float64, members: Index, count: int, sums: Float64) -> None:
    """Write running sums of azimuth, height and their products over the members of a run."""
    for k in range(count):
        a = azimuth[members[k]] - azimuth[members[0]]
        z = seen[members[k], 2] - seen[members[0], 2]
        sums[k + 1, 0] = sums[k, 0] + a
        sums[k + 1, 1] = sums[k, 1] + z
        sums[k + 1, 2] = sums[k, 2] + a * a
        sums[k + 1, 3] = sums[k, 3] + a * z
        sums[k + 1, 4] = sums[k, 4] + z * z


@njit(nogil=True, cache=True)
def line_through(sums: Float64, low: int, high: int) -> tuple[float, float, float]:
    """Return slope, m/rad, squared residuals, m2, and spread, rad2, of a part of a run."""
    n = high - low
    a, z = sums[high, 0] - sums[low, 0], sums[high, 1] - sums[low, 1]
    aa = sums[high, 2] - sums[low, 2] - a * a / n
    az = sums[high, 3] - sums[low, 3] - a * z / n
    zz = sums[high, 4] - sums[low, 4] - z * z / n
    slope = az / aa if aa > 0.0 else 0.0
    return slope, max(zz - slope * az, 0.0), aa


@njit(nogil=True, cache=True)
def best_split(sums: Float64, low: int, high: int) -> int:
    """Return where a run is best divided into two straight parts; -1 where one does as well."""
    best, middle = BENT * line_through(sums, low, high)[1], -1
    for k in range(low + 3, high - 2):
        rest = line_through(sums, low, k)[1] + line_through(sums, k, high)[1]
        if rest < best:
            best, middle = rest, k
    return middle


@njit(nogil=True, cache=True)
def is_level(sums: Float64, low: int, high: int, row: Float64) -> bool:
    """Tell whether a part of a run is level; write the error of its height into its row."""
    n = high - low
    slope, squares, spread = line_through(sums, low, high)
    noise = math.sqrt(squares / (n - 2.0))
    row[4] = noise / math.sqrt(n)
    # The ends of an even spread are sqrt(12) standard deviations apart.
    rise = abs(slope) * math.sqrt(12.0 * spread / n)
    return rise <= LEVEL + SIGMAS * noise * math.sqrt(12.0 / n)


@njit(nogil=True, cache=True)
def write_run(
    scan: Index, seen: Float64, azimuth: Float64, members: Index, low: int, high: int, row: Float64
) -> None:
    """Write the rest of a run's row."""
    first, last, z = members[low], members[high - 1], 0.0
    for k in range(low, high):
        z += seen[members[k], 2]
    row[0] = scan[first]
    row[1], row[2] = azimuth[first], azimuth[last]
    row[3], row[5] = z / (high - low), high - low
    half = (high - low) // 2
    row[6:10] = 0.0
    for k in range(half):
        a, b = members[low + k], members[high - 1 - k]
        row[6], row[7] = row[6] + seen[a, 0] / half, row[7] + seen[a, 1] / half
        row[8], row[9] = row[8] + seen[b, 0] / half, row[9] + seen[b, 1] / half


@njit(nogil=True, cache=True)
def is_near(seen: Float64, a: int, b: int) -> bool:
    """Tell whether two neighbours of a line may be of one surface, which is seen from the side."""
    dx, dy = seen[b, 0] - seen[a, 0], seen[b, 1] - seen[a, 1]
    cross = abs(seen[a, 0] * seen[b, 1] - seen[a, 1] * seen[b, 0])
    across = cross / math.sqrt(seen[a, 0] ** 2 + seen[a, 1] ** 2 + 1e-12)
    return dx * dx + dy * dy <= (SLANT * across + NOISE) ** 2
