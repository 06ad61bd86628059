"""Where a surface ends within the cells at its edge.

How far the points of a cell reach is worked out only for cells at an edge. Where samples are
sparse the surface goes on for half a spacing beyond the last one. The reach of an edge cell, a row
of float64 (E, 4), is the low and high a, low and high b of its points, in the raster's cells.
"""

import numpy as np
from numba import njit

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import CuboidArrays
from tccm_ros.outlines.gaps import patch_of
from tccm_ros.outlines.raster import EMPTY, ROOT3, SAMPLE

__all__ = ["extend_edges", "find_edges", "reach_horizontal", "reach_vertical"]


SPARSE = 1.2
"""Where samples are further apart than this, in cells, the surface goes on beyond the last."""


@njit(nogil=True, cache=True)
def find_edges(raster: Int32) -> Int32:
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
def widen(reach: Float64, a: float, b: float, spread_a: float, spread_b: float) -> None:
    """Let the reach of a cell, (4,), take in a cuboid's points."""
    reach[0] = min(reach[0], a - spread_a)
    reach[1] = max(reach[1], a + spread_a)
    reach[2] = min(reach[2], b - spread_b)
    reach[3] = max(reach[3], b + spread_b)


@njit(nogil=True, cache=True)
def reach_horizontal(
    raster: Int32, runs: Int32, low: tuple[int, int], cuboids: CuboidArrays, members: Int64,
    scale: float, reach: Float64,
) -> None:  # fmt: skip
    """Write the reach of the edge cells of a plane seen from above.

    Parameters
    ----------
    raster, runs, low
        As in `draw_runs`, after `find_edges`.
    cuboids, members
        As in `measure_vertical`.
    scale
        Raster cells in a map's cell.
    reach
        float64 (E, 4).
    """
    ix, iy, _, _, count, s, S, size, _ = cuboids
    low_a, low_b = low
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
def reach_vertical(
    raster: Int32, runs: Int32, low: tuple[int, int], extent: Float64, scale: float, reach: Float64
) -> None:
    """Write the reach of the edge cells of a vertical plane; arguments as in `runs_vertical`."""
    low_a, low_b = low
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
def extend_edges(
    raster: Int32, edges: Int32, reach: Float64, usual_a: Float64, usual_b: Float64
) -> None:
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
def lengthen(reach: Float64, usual: float, cells: int) -> tuple[int, int]:
    """Let a reach (low, high) take in half a spacing about its middle; return its cells."""
    middle = 0.5 * (reach[0] + reach[1])
    reach[0], reach[1] = min(reach[0], middle - 0.5 * usual), max(reach[1], middle + 0.5 * usual)
    return max(int(np.floor(reach[0])), 1), min(int(np.floor(reach[1])), cells - 2)
