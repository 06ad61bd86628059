"""The space in a compartment and before it: cells that beams passed, and cells in which they ended.

Each hit is the end of a beam from its sensor, so that space is free up to the hit, in finer cells
than a view's free columns. The columns add the beams that ended further away.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_closing

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.geometry import inverse, transform
from tccm_ros.racks.compartment import SeenView, SpaceGrid
from tccm_ros.racks.hits import Hits

CELL = 0.03
"""Edge of a cell, m; chosen: less than the distance of hits, so that a cell has one or none."""

BEFORE = 0.42
"""Extent of the grid before the front, m; chosen: the length of a hand and a forearm."""

BESIDE = 0.15
"""Extent of the grid beside the compartment, m; chosen: half a hand's width beyond its edge."""

END = 0.03
"""Length at the end of a beam that is not counted as free, m: a cell."""


def seen_space(
    T_map_front: Float64, size: Float64, hits: Hits, views: Sequence[SeenView]
) -> SpaceGrid:
    """Return free, occupied and unseen space in a compartment and in front of it.

    Parameters
    ----------
    T_map_front, size
        float64 (4, 4) as of `Compartment`, and (3,): depth, width and height, m.
    hits, views
        Hits and views near the compartment.
    """
    low = np.array([-BEFORE, -0.5 * size[1] - BESIDE, 0.0])
    high = np.array([size[0] + CELL, 0.5 * size[1] + BESIDE, size[2]])
    shape = np.ceil((high - low) / CELL).astype(np.int64)
    seen, hit = seen_cells(T_map_front, low, shape, np.full(3, CELL), hits, views)
    padded = np.pad(seen, 1, mode="edge")
    closed = binary_closing(padded, np.ones((3, 3, 3)))[1:-1, 1:-1, 1:-1]
    return SpaceGrid(low, CELL, (closed | seen) & ~hit, hit)


def seen_cells(
    T_map_grid: Float64,
    low: Float64,
    shape: Int64,
    cell: Float64,
    hits: Hits,
    views: Sequence[SeenView],
) -> tuple[Bool, Bool]:
    """Return which cells of a grid beams passed, and in which they ended.

    Parameters
    ----------
    T_map_grid
        float64 (4, 4), frame of the grid.
    low, shape, cell
        float64 (3,), lowest corner, m; int64 (3,), number of cells; float64 (3,), their edges, m.
    hits, views
        Hits and views near the grid.

    Returns
    -------
    seen : bool, as `shape`
        Beams passed the cell.
    hit : bool, as `shape`
        Beams ended in the cell.
    """
    T_grid = inverse(T_map_grid)
    ends, origins = transform(T_grid, hits.ends), transform(T_grid, hits.origins)
    seen, hit = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    _mark_beams(seen, origins, ends, low, cell)
    for part in (-1.0, -0.5, 0.0, 0.5, 1.0):
        points = ends + np.array([0.0, 0.0, 1.0]) * (part * hits.half)[:, None]
        mark_cells(hit, points, low, cell)
    middles = cell_middles(low, shape, cell).reshape(-1, 3)
    for view in views:
        rest = np.flatnonzero(~seen.ravel())
        at = transform(inverse(view.T_map_view) @ T_map_grid, middles[rest])
        seen.ravel()[rest[view.free.contains(at)]] = True
    return seen, hit


def mark_cells(cells: Bool, points: Float64, low: Float64, cell: Float64) -> None:
    """Mark the cells of a grid of D dimensions that contain points, float64 (N, D), m.

    Parameters
    ----------
    cells
        bool, changed.
    points
        Points; those outside of the grid are ignored.
    low, cell
        float64 (D,), lowest corner of the grid, and edges of its cells, m.
    """
    index = np.floor((points - low) / cell).astype(np.int64)
    inside = ((index >= 0) & (index < cells.shape)).all(axis=1)
    cells[tuple(index[inside].T)] = True


def cell_middles(low: Float64, shape: Int64, cell: Float64) -> Float64:
    """Return the middles of the cells of a grid (`seen_cells`), float64 (X, Y, Z, 3), m."""
    axes = [low[k] + (np.arange(shape[k]) + 0.5) * cell[k] for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _mark_beams(
    seen: Bool,
    origins: Float64,
    ends: Float64,
    low: Float64,
    cell: Float64,
) -> None:
    """Mark the cells that beams passed, up to `END` before their ends; two samples in each cell."""
    high, step = low + np.array(seen.shape) * cell, 0.5 * float(cell.min())
    way = ends - origins
    length = np.linalg.norm(way, axis=1)
    way = way / np.maximum(length, END)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sort(np.stack([(low - origins) / way, (high - origins) / way]), axis=0)
    first = np.nan_to_num(t[0], nan=-np.inf).max(axis=1).clip(0.0)
    last = np.minimum(np.nan_to_num(t[1], nan=np.inf).min(axis=1), length - END)
    crosses = last > first
    origins, way, first, last = (a[crosses] for a in (origins, way, first, last))
    count = int(np.ceil((last - first).max(initial=0.0) / step))
    for k in range(count):
        at = first + (k + 0.5) * step
        inside = at < last
        points = origins[inside] + at[inside, None] * way[inside]
        index = np.floor((points - low) / cell).astype(np.int64)
        index = np.clip(index, 0, np.array(seen.shape) - 1)
        seen[tuple(index.T)] = True
