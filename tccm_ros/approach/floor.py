"""Free floor for the base, and paths of straight legs over it."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from shapely import Polygon

from tccm_ros.approach.footprint import Footprint
from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.geometry import transform2
from tccm_ros.scene.base_poses import cells_within
from tccm_ros.slam.occupancy import OccupancyGrid

LEGS_M = 0.10
"""Maximum distance of a table's legs outside its top, m. Chosen: two cells of the grid."""


NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Steps (rows, columns) to half of a cell's neighbours; the graph has both directions."""


class Floor:
    """Cells on which the base may drive: free, not under furniture, and without new obstacles.

    Parameters
    ----------
    grid
        Occupancy; all arguments and results are in its frame.
    overhangs
        Outlines float64 (N, 2 or 3) of other furniture.
    gone
        Mapped outline of the approached surface: cells under it are taken as free, since its legs
        move with it and other obstacles are in `seen`. None: the grid is used there too.
    seen
        float64 (N, 2), current obstacles except the approached surface.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        overhangs: list[Float64],
        gone: Float64 | None = None,
        seen: Float64 | None = None,
    ):
        self._grid = grid
        free = grid.cells == 0
        if gone is not None:
            around = np.asarray(Polygon(gone[:, :2]).buffer(LEGS_M).exterior.coords)
            free |= cells_within([around], grid)
        free &= ~cells_within(overhangs, grid)
        if seen is not None and len(seen):
            cells, is_inside = self._cells(seen)
            free[cells[is_inside, 1], cells[is_inside, 0]] = False
        self._free = free
        # Cells outside the grid are unknown and not free.
        cells = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
        self._clearance = np.maximum(cells - math.sqrt(0.5), 0.0) * grid.resolution

    def _cells(self, points: Float64) -> tuple[Int64, Bool]:
        cells = np.floor((points - self._grid.origin) / self._grid.resolution).astype(np.int64)
        is_inside = (cells >= 0) & (cells < np.array(self._grid.cells.shape[::-1]))
        return cells, np.asarray(is_inside.all(axis=1))

    def is_free(self, points: Float64) -> bool:
        """Return whether all points (N, 2) are on free cells; cells outside the grid are not."""
        cells, is_inside = self._cells(points)
        return bool(is_inside.all()) and bool(self._free[cells[:, 1], cells[:, 0]].all())

    def is_way_free(self, footprint: Footprint, start: Float64, end: Float64) -> bool:
        """Return whether the base can drive straight from a pose (3,) to one with equal yaw."""
        spacing = self._grid.resolution
        way = end[:2] - start[:2]
        count = int(np.hypot(*way) / spacing) + 2
        samples = transform2(np.array([0.0, 0.0, end[2]]), footprint.samples(spacing))
        places = start[:2] + np.linspace(0.0, 1.0, count)[:, None] * way
        return self.is_free((places[:, None] + samples).reshape(-1, 2))

    def legs(self, start: Float64, goal: Float64, radius: float) -> list[Float64] | None:
        """Return the ends of straight legs from one point to another; None without a free path.

        Parameters
        ----------
        start, goal
            float64 (2,), m.
        radius
            Radius of the circle around the base's origin that stays free on the path, m.

        Returns
        -------
        Points (2,), the last one is the goal: the shortest path over the grid, without needless
        bends.
        """
        is_open = self._clearance > radius
        cells, is_inside = self._cells(np.stack([start, goal]))
        if not is_inside.all() or not is_open[cells[:, 1], cells[:, 0]].all():
            return None
        if self._is_leg_free(start, goal, radius):
            return [goal]
        way = _shortest_way(is_open, cells[0, ::-1], cells[1, ::-1])
        if way is None:
            return None
        origin, resolution = self._grid.origin, self._grid.resolution
        points = [*(origin + (way[1:-1, ::-1] + 0.5) * resolution), goal]
        ends: list[Float64] = []
        here, k = start, 0
        while k < len(points):
            # Take the furthest point with a free straight leg, at least the next one.
            seen = [j for j in range(k, len(points)) if self._is_leg_free(here, points[j], radius)]
            k = seen[-1] if seen else k
            here = points[k]
            ends.append(here)
            k += 1
        return ends

    def _is_leg_free(self, start: Float64, end: Float64, radius: float) -> bool:
        count = int(np.hypot(*(end - start)) / (0.5 * self._grid.resolution)) + 2
        points = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        cells, is_inside = self._cells(points)
        return bool(is_inside.all()) and bool(
            (self._clearance[cells[:, 1], cells[:, 0]] > radius).all()
        )


def _shortest_way(is_open: Bool, start: Int64, goal: Int64) -> Int64 | None:
    """Return the cells (N, 2) (row, column) of the shortest path over open cells, or None."""
    numbers = np.arange(is_open.size).reshape(is_open.shape)
    rows, columns, lengths = [], [], []
    height, width = is_open.shape
    for down, right in NEIGHBOURS:
        a = slice(0, height - down), slice(max(-right, 0), width - max(right, 0))
        b = slice(down, height), slice(max(right, 0), width + min(right, 0))
        both = is_open[a] & is_open[b]
        rows.append(numbers[a][both])
        columns.append(numbers[b][both])
        lengths.append(np.full(int(both.sum()), math.hypot(down, right)))
    table = np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))
    graph = coo_array(table, shape=(is_open.size, is_open.size)).tocsr()
    first, last = int(numbers[tuple(start)]), int(numbers[tuple(goal)])
    lengths_to, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    if not np.isfinite(lengths_to[last]):
        return None
    way = [last]
    while way[-1] != first:
        way.append(int(before[way[-1]]))
    return np.stack(np.unravel_index(way[::-1], is_open.shape), axis=1).astype(np.int64)
