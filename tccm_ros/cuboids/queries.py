"""Map queries for manipulation planning: is a place free, occupied or unknown, and since when.

All queries are vectorised and in the map's frame. Occupied space has the resolution of cells; free
space has that of ``views.cell_size``, from the beams of the tilt cycles in the window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tccm_ros.arrays import Float64, Int64
from tccm_ros.cuboids.cuboids import TICKS_PER_M, cell_keys
from tccm_ros.cuboids.free_columns import NEVER, FreeSpace
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.geometry import transform
from tccm_ros.kernels import kernel

MAX_POINTS = 1_000_000
"""Maximum number of grid points in a box query. Chosen: 0.1 s."""


class Occupancy(IntEnum):
    """Occupancy of a place."""

    UNKNOWN = -1
    FREE = 0
    OCCUPIED = 1


@dataclass(frozen=True, slots=True)
class Measurement:
    """One cuboid of a part map at a queried place.

    Attributes
    ----------
    cycle
        Number of the cycle.
    start_ns, end_ns
        Times of the first and last used beam of the cycle.
    first_ns, last_ns
        Stamps of the first and the last scan that measured the cuboid.
    points
        Number of points.
    """

    cycle: int
    start_ns: int
    end_ns: int
    first_ns: int
    last_ns: int
    points: int


@dataclass(frozen=True, slots=True)
class BoxAnswer:
    """Occupancy of a box.

    Attributes
    ----------
    occupancy
        Occupancy of the box.
    cycle, stamp_ns
        The newest tilt cycle that observed it, and its end, or its middle if it observed free space
        only; -1 and `NEVER` for an unobserved box.
    """

    occupancy: Occupancy
    cycle: int
    stamp_ns: int


class MapQuery:
    """Queries to a snapshot of an integration map; later changes of the map have no effect.

    Parameters
    ----------
    map_
        The map.
    seen_free
        Free space of the tilt cycles in the window; without it, no place is free.
    """

    def __init__(self, map_: IntegrationMap, seen_free: FreeSpace | None = None) -> None:
        self._parts = {part.cycle: part for part in map_.parts}
        self._keys, self._pieces = map_.keys.copy(), map_.pieces.copy()
        self._free = None if seen_free is None else seen_free.copy()
        self.cuboids = map_.cuboids()
        self._columns = self.cuboids.columns()
        self._cell = round(self.cuboids.cell_size * TICKS_PER_M)

    def points(self, points: ArrayLike) -> NDArray[np.int8]:
        """Return the `Occupancy` of points (N, 3), m, as int8 (N,)."""
        xyz = np.asarray(points, np.float64).reshape(-1, 3)
        result = np.full(len(xyz), Occupancy.UNKNOWN, np.int8)
        if self._free is not None:
            result[self._free.last_seen(xyz) != NEVER] = Occupancy.FREE
        result[self._at(xyz) >= 0] = Occupancy.OCCUPIED
        return result

    def boxes(self, boxes: ArrayLike, spacing: float = 0.02) -> NDArray[np.int8]:
        """Return the `Occupancy` of axis-aligned boxes.

        Parameters
        ----------
        boxes
            (N, 6), m: x_min x_max y_min y_max z_min z_max, as `map.region`.
        spacing
            A box is free if all points of a grid with at most this spacing are free, m.

        Returns
        -------
        int8 (N,). A box is occupied if the cell and the heights of a cuboid overlap or touch it.
        """
        b = np.asarray(boxes, np.float64).reshape(-1, 6)
        ticks = np.floor(b * TICKS_PER_M + 0.5).astype(np.int64)
        hit = np.zeros(len(b), np.bool_)
        columns = self._columns
        find_overlaps(columns.keys, columns.first, columns.spans, ticks, self._cell, hit)
        result = np.where(hit, Occupancy.OCCUPIED, Occupancy.UNKNOWN).astype(np.int8)
        for i in np.flatnonzero(~hit):
            if self._free is not None and self._is_free(b[i], spacing):
                result[i] = Occupancy.FREE
        return result

    def box(self, T_map_box: Float64, size: Float64, spacing: float = 0.01) -> BoxAnswer:
        """Return the occupancy of a box of any orientation.

        Parameters
        ----------
        T_map_box
            float64 (4, 4), pose of its centre.
        size
            float64 (3,), edges along its own axes, m.
        spacing
            Spacing of the grid points, m; the default is half a cell, and a third of a cuboid's
            depth. It is larger in large boxes, to limit the grid to `MAX_POINTS` points.
        """
        spacing = max(spacing, (float(np.prod(size)) / MAX_POINTS) ** (1.0 / 3.0))
        axes = [
            np.linspace(-0.5 * edge, 0.5 * edge, math.ceil(edge / spacing) + 1)
            for edge in size.tolist()
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        points = transform(T_map_box, grid)
        at = self._at(points)
        free = np.full(len(points), NEVER, np.int64)
        if self._free is not None:
            free = self._free.last_seen(points)
        hit = np.unique(at[at >= 0])
        newest = self.cuboids.cycles[self.cuboids.cycle_offsets[hit + 1] - 1]
        if len(hit):
            cycle = int(newest.max())
            return BoxAnswer(Occupancy.OCCUPIED, cycle, self._parts[cycle].end_ns)
        stamp_ns = int(free.max())
        if stamp_ns == NEVER or self._free is None:
            return BoxAnswer(Occupancy.UNKNOWN, -1, NEVER)
        state = Occupancy.FREE if (free != NEVER).all() else Occupancy.UNKNOWN
        return BoxAnswer(state, self._free.cycle_at(stamp_ns), stamp_ns)

    def last_seen(self, points: ArrayLike) -> Int64:
        """Return when points (N, 3) were last observed, free or occupied; ns or NEVER."""
        xyz = np.asarray(points, np.float64).reshape(-1, 3)
        free = self._free.last_seen(xyz) if self._free else np.full(len(xyz), NEVER, np.int64)
        at, c = self._at(xyz), self.cuboids
        newest = np.full(len(c) + 1, NEVER, np.int64)
        if len(c):
            # Cycles are in order: the last is the newest.
            cycles = c.cycles[c.cycle_offsets[1:] - 1]
            newest[:-1] = [self._parts[int(cycle)].end_ns for cycle in cycles]
        return np.maximum(free, newest[at])

    def trace(self, point: ArrayLike) -> list[Measurement]:
        """Return the measurements of the cuboid at a point (3,), oldest cycle first.

        These are the touching cuboids of all part maps there; empty if there is no cuboid.
        """
        at = int(self._at(np.asarray(point, np.float64).reshape(1, 3))[0])
        if at < 0:
            return []
        c, pieces = self.cuboids, self._pieces
        inside = (
            (self._keys == cell_keys(c.ix[at], c.iy[at]))
            & (pieces[:, 0] >= c.bottom[at])
            & (pieces[:, 1] <= c.top[at])
        )
        result = []
        for cycle, index in np.unique(pieces[inside, 2:], axis=0).tolist():
            part = self._parts[cycle]
            first_ns, last_ns = part.seen_ns[index].tolist()
            count = int(part.moments[index, 0])
            result.append(Measurement(cycle, part.start_ns, part.end_ns, first_ns, last_ns, count))
        return result

    def _at(self, xyz: Float64) -> Int64:
        """Return the index of the cuboid at each point, -1 for none."""
        ticks = np.floor(xyz * TICKS_PER_M + 0.5).astype(np.int64)
        wanted = cell_keys(ticks[:, 0] // self._cell, ticks[:, 1] // self._cell)
        columns, heights = self._columns, ticks[:, 2].copy()
        return find_cuboids(columns.keys, columns.first, columns.spans, wanted, heights)

    def _is_free(self, box: Float64, spacing: float) -> bool:
        axes = [
            np.linspace(low, high, max(int(np.ceil((high - low) / spacing)) + 1, 1))
            for low, high in box.reshape(3, 2)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        assert self._free is not None
        return bool((self._free.last_seen(grid) != NEVER).all())


@kernel
def _first_of(keys: Any, key: Any) -> Any:
    """Return the first index whose key is not below `key`."""
    low, high = 0, len(keys)
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def find_cuboids(keys: Any, first: Any, spans: Any, wanted: Any, heights: Any) -> Any:
    """Return the cuboid at each (cell, height); of two touching ones, the upper.

    Parameters
    ----------
    keys, first, spans
        The fields of `Columns`.
    wanted, heights
        int64 (N,), keys of cells, and heights, ticks; a cuboid includes both its ends.

    Returns
    -------
    int64 (N,), -1 for none.
    """
    found = np.full(len(wanted), -1, np.int64)
    for i in range(len(wanted)):
        at = _first_of(keys, wanted[i])
        if at == len(keys) or keys[at] != wanted[i]:
            continue
        for k in range(first[at], first[at + 1]):
            if spans[k, 0] <= heights[i] <= spans[k, 1]:
                found[i] = k
    return found


@kernel
def find_overlaps(keys: Any, first: Any, spans: Any, boxes: Any, cell: Any, hit: Any) -> None:
    """Mark the boxes that a cuboid overlaps or touches.

    Parameters
    ----------
    keys, first, spans
        The fields of `Columns`.
    boxes
        int64 (B, 6), ticks: x_min x_max y_min y_max z_min z_max.
    cell
        Edge of a cell, ticks.
    hit
        bool (B,), set to True.
    """
    for i in range(len(boxes)):
        x0, x1, y0, y1, z0, z1 = (
            boxes[i, 0] // cell, boxes[i, 1] // cell, boxes[i, 2] // cell,
            boxes[i, 3] // cell, boxes[i, 4], boxes[i, 5],
        )  # fmt: skip
        for ix in range(x0, x1 + 1):
            at = _first_of(keys, (ix << 32) + y0)
            last = (ix << 32) + y1
            while at < len(keys) and keys[at] <= last and not hit[i]:
                for k in range(first[at], first[at + 1]):
                    hit[i] |= spans[k, 0] <= z1 and spans[k, 1] >= z0
                at += 1
            if hit[i]:
                break
