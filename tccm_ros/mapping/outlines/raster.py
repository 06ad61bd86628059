"""The samples of a plane on a raster: gaps between them are filled, edges found within a cell.

Cells are linked as in `linking`: a gap shorter than twice the local sample spacing is filled and a
longer one stays open. Where samples are sparse the surface goes on for half a spacing beyond the
last one. How far the points of a cell reach is worked out only for cells at an edge.

A raster is int32 (A, B) with a margin of empty cells. Its cells are EMPTY, FILLED, SAMPLE, or the
number of an edge cell. The reach of an edge cell, a row of float64 (E, 4), is the low and high a,
low and high b of its points, in the raster's cells.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.mapping.linking import STEPS, spacing

__all__ = [
    "EMPTY",
    "FILLED",
    "MARGIN",
    "SAMPLE",
    "close_combs",
    "draw_runs",
    "extend_edges",
    "fill_gaps",
    "find_edges",
    "find_gaps",
    "reach_lying",
    "reach_standing",
    "runs_lying",
    "runs_standing",
]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Index = NDArray[np.int64]

ROOT3 = 1.7320508075688772
"""Half the length of a uniform spread, in standard deviations."""

EMPTY, FILLED, SAMPLE = -1, -2, -3
"""A cell with nothing, one between samples, one with a sample."""

PATCH_BITS = 4
"""A patch in which the spacing is estimated is 2**4 cells wide."""

SPARSE = 1.2
"""Where samples are further apart than this, in cells, the surface goes on beyond the last."""

MARGIN = 6
"""Empty cells around the samples: the surface goes on into all but the last, however sparse the
samples are."""


# --- what cells a cuboid takes --------------------------------------------------------------------


@njit(nogil=True, cache=True)
def runs_lying(ix: Int, iy: Int, members: Index, coarse: int, runs: Int) -> None:
    """Write the cell of each cuboid of a lying plane: a along x, b along y.

    Parameters
    ----------
    ix, iy
        As in `Cuboids`.
    members
        int64 (M,), indices of the plane's cuboids.
    coarse
        The raster's cells are 2**coarse times as wide as the map's.
    runs
        int32 (M, 3), receives a, lowest b and highest b.
    """
    for k in range(len(members)):
        runs[k, 0] = ix[members[k]] >> coarse
        runs[k, 1] = runs[k, 2] = iy[members[k]] >> coarse


@njit(nogil=True, cache=True)
def runs_standing(extent: Array, scale: float, runs: Int) -> None:
    """Write the run of cells of each cuboid of a standing plane: a along u, b upwards.

    Parameters
    ----------
    extent
        float64 (M, 4) of `measure_standing`: middle along u, spread, low and high, ticks.
    scale
        Cells in a tick.
    runs
        int32 (M, 3), receives a, lowest b and highest b.
    """
    for k in range(len(extent)):
        runs[k, 0] = np.int32(np.floor(extent[k, 0] * scale))
        runs[k, 1] = np.int32(np.floor(extent[k, 2] * scale))
        runs[k, 2] = np.int32(np.floor(extent[k, 3] * scale))


@njit(nogil=True, cache=True)
def measure_standing(
    count: Array, s: Array, S: Array, ix: Int, iy: Int, bottom: Int, top: Int, members: Index,
    size: float, ux: float, uy: float, extent: Array,
) -> None:  # fmt: skip
    """Write where the points of each cuboid of a standing plane are.

    Parameters
    ----------
    count, s, S, ix, iy, bottom, top
        As in `Cuboids`.
    members
        int64 (M,), indices of the plane's cuboids.
    size
        Edge of a map's cell, ticks.
    ux, uy
        The plane's level direction.
    extent
        float64 (M, 4), ticks: receives middle and half width along u, lowest and highest point.
    """
    for k in range(len(members)):
        i = members[k]
        n = 1.0 / count[i]
        x, y, z = s[i, 0] * n, s[i, 1] * n, s[i, 2] * n
        xx, yy = max(S[i, 0] * n - x * x, 0.0), max(S[i, 3] * n - y * y, 0.0)
        extent[k, 0] = ux * (x + np.rint(ix[i] * size)) + uy * (y + np.rint(iy[i] * size))
        extent[k, 1] = ROOT3 * np.sqrt(ux * ux * xx + uy * uy * yy)
        # The top is a point; the bottom lies below the lowest by a depth that may vary.
        low = z - ROOT3 * np.sqrt(max(S[i, 5] * n - z * z, 0.0))
        extent[k, 2] = min(max(low, np.float64(bottom[i])), np.float64(top[i]))
        extent[k, 3] = top[i]


@njit(nogil=True, cache=True)
def draw_runs(raster: Int, runs: Int, low_a: int, low_b: int) -> int:
    """Mark the cells of all runs as SAMPLE; return how many they are.

    (low_a, low_b) is the raster's first cell.
    """
    samples = 0
    for k in range(len(runs)):
        a = runs[k, 0] - low_a
        for b in range(runs[k, 1] - low_b, runs[k, 2] - low_b + 1):
            samples += raster[a, b] == EMPTY
            raster[a, b] = SAMPLE
    return samples


# --- gaps between samples -------------------------------------------------------------------------


@njit(nogil=True, cache=True)
def patch_of(a: int, b: int, columns: int) -> int:
    """Return the patch of a cell in a raster of so many columns."""
    return (a >> PATCH_BITS) * ((columns >> PATCH_BITS) + 1) + (b >> PATCH_BITS)


@njit(nogil=True, cache=True)
def find_gaps(raster: Int, samples: int) -> tuple[Int, Array, Array]:
    """Find the gaps between so many samples in rows and columns, and the sample spacing.

    Returns
    -------
    gaps : int32 (G, 4)
        Sample behind which the gap is (a, b), step to the sample before it, and axis: 0 along a,
        1 along b.
    usual_a, usual_b : float64 (P,)
        Spacing of the samples of each patch along each axis, cells, 1 or more.
    """
    rows, columns = raster.shape
    patches = patch_of(rows - 1, columns - 1, columns) + 1
    steps = np.zeros((2, patches + 1, STEPS), np.int32)
    last_a = np.full(columns, -STEPS, np.int64)
    gaps, used = np.empty((2 * samples + 1, 4), np.int32), 0
    for a in range(rows):
        last_b = -STEPS
        for b in range(columns):
            if raster[a, b] != SAMPLE:
                continue
            patch = patch_of(a, b, columns)
            step_a, step_b = a - last_a[b], b - last_b
            last_a[b], last_b = a, b
            # Written first and counted if it is there: faster than to ask. Entry 0 of a histogram
            # takes steps that are no links.
            steps[0, patch, step_a if step_a < STEPS else 0] += 1
            steps[1, patch, step_b if step_b < STEPS else 0] += 1
            gaps[used, 0], gaps[used, 1], gaps[used, 2], gaps[used, 3] = a, b, step_a, 0
            used += 1 < step_a < STEPS
            gaps[used, 0], gaps[used, 1], gaps[used, 2], gaps[used, 3] = a, b, step_b, 1
            used += 1 < step_b < STEPS
    steps[:, :, 0] = 0
    return gaps[:used], usual_steps(steps[0]), usual_steps(steps[1])


@njit(nogil=True, cache=True)
def usual_steps(steps: Int) -> Array:
    """Return the typical step of each patch, float64 (P,), from histograms int32 (P + 1, STEPS).

    The last histogram is that of all patches, for those with too few steps; it is filled here.
    """
    patches = len(steps) - 1
    found = np.zeros(patches, np.bool_)
    for p in range(patches):
        for k in range(1, STEPS):
            if steps[p, k]:
                steps[patches, k] += steps[p, k]
                found[p] = True
    overall = max(spacing(steps[patches], 1.0), 1.0)
    usual = np.full(patches, overall)
    for p in range(patches):
        if found[p]:
            usual[p] = max(spacing(steps[p], overall), 1.0)
    return usual


@njit(nogil=True, cache=True)
def fill_gaps(raster: Int, gaps: Int, usual_a: Array, usual_b: Array) -> None:
    """Fill the gaps that are shorter than twice the spacing of their patch."""
    columns = raster.shape[1]
    for k in range(len(gaps)):
        a, b, step = gaps[k, 0], gaps[k, 1], gaps[k, 2]
        usual = usual_b if gaps[k, 3] == 1 else usual_a
        if step >= 2.0 * usual[patch_of(a, b, columns)]:
            continue
        for back in range(1, step):
            if gaps[k, 3] == 1:
                raster[a, b - back] = FILLED
            else:
                raster[a - back, b] = FILLED


@njit(nogil=True, cache=True)
def close_combs(raster: Int, usual_a: float, usual_b: float) -> None:
    """Fill gaps between full cells that are shorter than twice the largest spacing.

    Scan lines whose samples stand in turn leave combs, which only the other axis shows.
    """
    rows, columns = raster.shape
    if usual_b > 1.0:
        for a in range(rows):
            last = -STEPS
            for b in range(columns):
                if raster[a, b] != EMPTY:
                    if 1 < b - last < 2.0 * usual_b:
                        raster[a, last + 1 : b] = FILLED
                    last = b
    if usual_a > 1.0:
        behind = np.full(columns, -STEPS, np.int32)
        for a in range(rows):
            for b in range(columns):
                if raster[a, b] != EMPTY:
                    if 1 < a - behind[b] < 2.0 * usual_a:
                        raster[behind[b] + 1 : a, b] = FILLED
                    behind[b] = a


# --- edges within a cell --------------------------------------------------------------------------


@njit(nogil=True, cache=True)
def find_edges(raster: Int) -> Int:
    """Number the samples beside an empty cell; return their cells int32 (E, 2)."""
    rows, columns = raster.shape
    edges, used = np.empty((256, 2), np.int32), 0
    for a in range(1, rows - 1):
        for b in range(1, columns - 1):
            if raster[a, b] != SAMPLE or (
                raster[a, b - 1] != EMPTY
                and raster[a, b + 1] != EMPTY
                and raster[a - 1, b] != EMPTY
                and raster[a + 1, b] != EMPTY
            ):
                continue
            if used == len(edges):
                more = np.empty((2 * used, 2), np.int32)
                more[:used] = edges
                edges = more
            edges[used, 0], edges[used, 1] = a, b
            raster[a, b] = used
            used += 1
    return edges[:used]


@njit(nogil=True, cache=True)
def widen(reach: Array, a: float, b: float, spread_a: float, spread_b: float) -> None:
    """Let the reach of a cell, (4,), take in a cuboid's points."""
    reach[0] = min(reach[0], a - spread_a)
    reach[1] = max(reach[1], a + spread_a)
    reach[2] = min(reach[2], b - spread_b)
    reach[3] = max(reach[3], b + spread_b)


@njit(nogil=True, cache=True)
def reach_lying(
    raster: Int, runs: Int, low_a: int, low_b: int, count: Array, s: Array, S: Array, ix: Int,
    iy: Int, members: Index, size: float, scale: float, reach: Array,
) -> None:  # fmt: skip
    """Write the reach of the edge cells of a lying plane.

    Parameters
    ----------
    raster, runs, low_a, low_b
        As in `draw_runs`, after `find_edges`.
    count, s, S, ix, iy, members, size
        As in `measure_standing`.
    scale
        Raster cells in a map's cell.
    reach
        float64 (E, 4).
    """
    reach[:, 0::2], reach[:, 1::2] = np.inf, -np.inf
    for k in range(len(members)):
        e = raster[runs[k, 0] - low_a, runs[k, 1] - low_b]
        if e < 0:
            continue
        i = members[k]
        n = 1.0 / count[i]
        x, y = s[i, 0] * n, s[i, 1] * n
        spread_x = ROOT3 * np.sqrt(max(S[i, 0] * n - x * x, 0.0)) / size * scale
        spread_y = ROOT3 * np.sqrt(max(S[i, 3] * n - y * y, 0.0)) / size * scale
        at_a, at_b = (ix[i] + x / size) * scale - low_a, (iy[i] + y / size) * scale - low_b
        widen(reach[e], at_a, at_b, spread_x, spread_y)


@njit(nogil=True, cache=True)
def reach_standing(
    raster: Int, runs: Int, low_a: int, low_b: int, extent: Array, scale: float, reach: Array
) -> None:
    """Write the reach of the edge cells of a standing plane; arguments as in `runs_standing`."""
    reach[:, 0::2], reach[:, 1::2] = np.inf, -np.inf
    for k in range(len(runs)):
        a = runs[k, 0] - low_a
        for b in range(runs[k, 1] - low_b, runs[k, 2] - low_b + 1):
            e = raster[a, b]
            if e >= 0:
                bottom = max(extent[k, 2] * scale - low_b, np.float64(b))
                top = min(extent[k, 3] * scale - low_b, b + 1.0)
                middle = 0.5 * (bottom + top)
                widen(
                    reach[e], extent[k, 0] * scale - low_a, middle, extent[k, 1] * scale,
                    middle - bottom,
                )  # fmt: skip


@njit(nogil=True, cache=True)
def extend_edges(raster: Int, edges: Int, reach: Array, usual_a: Array, usual_b: Array) -> None:
    """Let the surface go on for half a spacing beyond the edge cells, where samples are sparse.

    The cells that are reached take the number of the edge cell.
    """
    rows, columns = raster.shape
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        patch = patch_of(a, b, columns)
        if usual_a[patch] > SPARSE:
            low, high = lengthen(reach[e, 0:2], usual_a[patch], rows)
            for k in range(low, high + 1):
                if raster[k, b] == EMPTY:
                    raster[k, b] = e
        if usual_b[patch] > SPARSE:
            low, high = lengthen(reach[e, 2:4], usual_b[patch], columns)
            for k in range(low, high + 1):
                if raster[a, k] == EMPTY:
                    raster[a, k] = e


@njit(nogil=True, cache=True)
def lengthen(reach: Array, usual: float, cells: int) -> tuple[int, int]:
    """Let a reach (low, high) take in half a spacing about its middle; return its cells."""
    middle = 0.5 * (reach[0] + reach[1])
    reach[0], reach[1] = min(reach[0], middle - 0.5 * usual), max(reach[1], middle + 0.5 * usual)
    return max(int(np.floor(reach[0])), 1), min(int(np.floor(reach[1])), cells - 2)
