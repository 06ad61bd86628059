"""The cuboids of a plane drawn on a raster.

A raster is int32 (A, B) with a margin of empty cells. Its cells are EMPTY, FILLED, SAMPLE, or the
number of an edge cell. `gaps` fills the empty cells between samples, `edge_cells` computes the
bounds of the surface within the cells at its edge.
"""

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import CuboidArrays
from tccm_ros.kernels import kernel
from tccm_ros.robust import UNIFORM_WIDTH

EMPTY, FILLED, SAMPLE = -1, -2, -3
"""Values of a cell: empty, filled between samples, with a sample."""

MARGIN = 6
"""Width of the empty margin around the samples, cells; sparse samples extend the surface into all
of it except one cell. Chosen."""


@kernel
def runs_horizontal(ix: Int32, iy: Int32, members: Int64, coarse: int, runs: Int32) -> None:
    """Write the cell of each cuboid of a plane seen from above: a along x, b along y.

    Parameters
    ----------
    ix, iy
        As in `Cuboids`.
    members
        int64 (M,), indices of the plane's cuboids.
    coarse
        The raster's cells are 2**coarse times as wide as those of the map.
    runs
        int32 (M, 3), receives a, lowest b and highest b.
    """
    for k in range(len(members)):
        runs[k, 0] = ix[members[k]] >> coarse
        runs[k, 1] = runs[k, 2] = iy[members[k]] >> coarse


@kernel
def runs_vertical(extent: Float64, scale: float, runs: Int32) -> None:
    """Write the run of cells of each cuboid of a vertical plane: a along u, b upwards.

    Parameters
    ----------
    extent
        float64 (M, 4) of `measure_vertical`: middle along u, spread, low and high, ticks.
    scale
        Cells per tick.
    runs
        int32 (M, 3), receives a, lowest b and highest b.
    """
    for k in range(len(extent)):
        runs[k, 0] = np.int32(np.floor(extent[k, 0] * scale))
        runs[k, 1] = np.int32(np.floor(extent[k, 2] * scale))
        runs[k, 2] = np.int32(np.floor(extent[k, 3] * scale))


@kernel
def measure_vertical(
    cuboids: CuboidArrays, members: Int64, ux: float, uy: float, extent: Float64
) -> None:
    """Write the extent of the points of each cuboid of a vertical plane.

    Parameters
    ----------
    cuboids
        Cuboids of the map.
    members
        int64 (M,), indices of the plane's cuboids.
    ux, uy
        The plane's horizontal direction u, unit.
    extent
        float64 (M, 4), ticks: receives centre and half width along u, lowest and highest point.
    """
    ix, iy, bottom, top, count, s, S, size, _ = cuboids
    for k in range(len(members)):
        i = members[k]
        n = 1.0 / count[i]
        x, y, z = s[i, 0] * n, s[i, 1] * n, s[i, 2] * n
        xx, yy = max(S[i, 0] * n - x * x, 0.0), max(S[i, 3] * n - y * y, 0.0)
        extent[k, 0] = ux * (x + np.rint(ix[i] * size)) + uy * (y + np.rint(iy[i] * size))
        extent[k, 1] = 0.5 * UNIFORM_WIDTH * np.sqrt(ux * ux * xx + uy * uy * yy)
        # The top is a point; the bottom is below the lowest point by a variable depth.
        low = z - 0.5 * UNIFORM_WIDTH * np.sqrt(max(S[i, 5] * n - z * z, 0.0))
        extent[k, 2] = min(max(low, np.float64(bottom[i])), np.float64(top[i]))
        extent[k, 3] = top[i]


@kernel
def draw_runs(raster: Int32, runs: Int32, low_a: int, low_b: int) -> int:
    """Mark the cells of all runs as SAMPLE.

    Parameters
    ----------
    raster
        int32 (A, B), changed.
    runs
        int32 (M, 3), a, lowest b and highest b of each.
    low_a, low_b
        Coordinates of the raster's first cell.

    Returns
    -------
    int
        Number of distinct cells marked.
    """
    samples = 0
    for k in range(len(runs)):
        a = runs[k, 0] - low_a
        for b in range(runs[k, 1] - low_b, runs[k, 2] - low_b + 1):
            samples += raster[a, b] == EMPTY
            raster[a, b] = SAMPLE
    return samples
