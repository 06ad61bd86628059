"""Bounds of a surface within the cells at its edge.

The bounds of the points of a cell are computed only for cells at an edge. If samples are sparse,
the surface extends half a spacing beyond the last one. The bounds of an edge cell, a row of float64
(E, 4), are the low and high a, low and high b of its points, in the raster's cells.
"""

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import CuboidArrays
from tccm_ros.kernels import kernel
from tccm_ros.outlines.gaps import patch_of
from tccm_ros.outlines.raster import EMPTY, SAMPLE
from tccm_ros.robust import UNIFORM_WIDTH

SPARSE_SPACING = 1.2
"""Minimum spacing of samples, cells, for which the surface extends beyond the last one. Chosen: the
spacing is 1 if every cell is filled."""


@kernel
def find_edges(raster: Int32) -> Int32:
    """Number the samples beside an empty cell; return their cells, int32 (E, 2)."""
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


@kernel
def include_points(bounds: Float64, a: float, b: float, spread_a: float, spread_b: float) -> None:
    """Extend the bounds of a cell by a cuboid's points.

    Parameters
    ----------
    bounds
        float64 (4,), changed: low a, high a, low b, high b, cells.
    a, b
        Centre of the points, cells.
    spread_a, spread_b
        Half widths of the points, cells.
    """
    bounds[0] = min(bounds[0], a - spread_a)
    bounds[1] = max(bounds[1], a + spread_a)
    bounds[2] = min(bounds[2], b - spread_b)
    bounds[3] = max(bounds[3], b + spread_b)


@kernel
def bound_edges_horizontal(
    raster: Int32, runs: Int32, low: tuple[int, int], cuboids: CuboidArrays, members: Int64,
    scale: float, bounds: Float64,
) -> None:  # fmt: skip
    """Write the bounds of the points in the edge cells of a plane seen from above.

    Parameters
    ----------
    raster, runs, low
        As in `draw_runs`, after `find_edges`.
    cuboids, members
        As in `measure_vertical`.
    scale
        Raster cells per map cell.
    bounds
        float64 (E, 4), written.
    """
    ix, iy, _, _, count, s, S, size, _ = cuboids
    low_a, low_b = low
    bounds[:, 0::2], bounds[:, 1::2] = np.inf, -np.inf
    for k in range(len(members)):
        e = raster[runs[k, 0] - low_a, runs[k, 1] - low_b]
        if e < 0:
            continue
        i = members[k]
        n = 1.0 / count[i]
        x, y = s[i, 0] * n, s[i, 1] * n
        spread_x = 0.5 * UNIFORM_WIDTH * np.sqrt(max(S[i, 0] * n - x * x, 0.0)) / size * scale
        spread_y = 0.5 * UNIFORM_WIDTH * np.sqrt(max(S[i, 3] * n - y * y, 0.0)) / size * scale
        at_a, at_b = (ix[i] + x / size) * scale - low_a, (iy[i] + y / size) * scale - low_b
        include_points(bounds[e], at_a, at_b, spread_x, spread_y)


@kernel
def bound_edges_vertical(
    raster: Int32, runs: Int32, low: tuple[int, int], extent: Float64, scale: float, bounds: Float64
) -> None:
    """Write the bounds of the points in the edge cells of a vertical plane.

    Parameters
    ----------
    raster, runs, low
        As in `draw_runs`, after `find_edges`.
    extent, scale
        As in `runs_vertical`.
    bounds
        float64 (E, 4), written.
    """
    low_a, low_b = low
    bounds[:, 0::2], bounds[:, 1::2] = np.inf, -np.inf
    for k in range(len(runs)):
        a = runs[k, 0] - low_a
        for b in range(runs[k, 1] - low_b, runs[k, 2] - low_b + 1):
            e = raster[a, b]
            if e >= 0:
                bottom = max(extent[k, 2] * scale - low_b, np.float64(b))
                top = min(extent[k, 3] * scale - low_b, b + 1.0)
                middle = 0.5 * (bottom + top)
                include_points(
                    bounds[e], extent[k, 0] * scale - low_a, middle, extent[k, 1] * scale,
                    middle - bottom,
                )  # fmt: skip


@kernel
def extend_edges(
    raster: Int32, edges: Int32, bounds: Float64, usual_a: Float64, usual_b: Float64
) -> None:
    """Extend the surface by half a spacing beyond the edge cells if samples are sparse.

    Parameters
    ----------
    raster
        int32 (A, B), changed: empty cells within the new bounds get the number of the edge cell.
    edges
        int32 (E, 2), result of `find_edges`.
    bounds
        float64 (E, 4), changed.
    usual_a, usual_b
        Result of `find_gaps`.
    """
    rows, columns = raster.shape
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        patch = patch_of(a, b, columns)
        if usual_a[patch] > SPARSE_SPACING:
            low, high = extend_bounds(bounds[e, 0:2], usual_a[patch], rows)
            for k in range(low, high + 1):
                if raster[k, b] == EMPTY:
                    raster[k, b] = e
        if usual_b[patch] > SPARSE_SPACING:
            low, high = extend_bounds(bounds[e, 2:4], usual_b[patch], columns)
            for k in range(low, high + 1):
                if raster[a, k] == EMPTY:
                    raster[a, k] = e


@kernel
def extend_bounds(span: Float64, usual: float, cells: int) -> tuple[int, int]:
    """Extend the bounds of an edge cell along one axis to half a spacing about their centre.

    Parameters
    ----------
    span
        float64 (2,), changed: low and high, cells.
    usual
        Spacing of the samples, cells.
    cells
        Number of cells of the raster along the axis.

    Returns
    -------
    low, high : int
        The first and the last cell within the bounds, without the raster's border.
    """
    middle = 0.5 * (span[0] + span[1])
    span[0], span[1] = min(span[0], middle - 0.5 * usual), max(span[1], middle + 0.5 * usual)
    return max(int(np.floor(span[0])), 1), min(int(np.floor(span[1])), cells - 2)
