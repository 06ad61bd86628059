"""Clearing by beams: remove cuboids of older part maps through which a beam passed.

The cleared space of a tilt cycle is stored with its part map as *voids*: intervals of height per
cell that are removed from all older part maps. A rebuild therefore repeats the clearing, and
removing the part map from the integration map undoes its clearing as well.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.cuboids.cycle_builder import TiltCycleData
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.merging import merge_part, write_composites
from tccm_ros.cuboids.part_map import PartMap
from tccm_ros.kernels import kernel

MARGIN = 0.010
"""Minimum depth of a beam inside a cuboid, m: a beam that grazes a surface does not clear it.
Chosen: four standard deviations of a range (2.5 mm)."""

STOP_CELLS = 2.0
"""Tracing stops this number of cells before a beam's end, as its last cells contain the surface
that it hit. Chosen: the cell of the hit and the previous one."""


def add_voids(cycle: TiltCycleData, map_: IntegrationMap, config: Config) -> PartMap:
    """Return the newest part map with the voids along its tilt cycle's beams.

    Parameters
    ----------
    cycle
        The newest tilt cycle.
    map_
        The map before the part map is added.
    config
        `map.window_cycles` and `scan.max_range`.

    Returns
    -------
    PartMap
        The tilt cycle's part map with its voids.
    """
    part = cycle.part
    keys, spans = _older(part, map_, config.map.window_cycles)
    if len(keys) == 0:
        return part
    index = index_cells(keys, spans * (1.0 / TICKS_PER_M))
    passed = np.zeros(len(keys), np.bool_)
    for record in cycle.records:
        rays = record.rays(config.scan.max_range)
        mark_passed(*rays, config.map.cell_size, index, passed)
    return replace(part, void_keys=keys[passed], void_bounds=spans[passed])


def _older(part: PartMap, map_: IntegrationMap, window: int) -> tuple[Int64, Int32]:
    """Return keys and spans of the older composite cuboids that the newest part map leaves."""
    keys, pieces = map_.keys, map_.pieces
    room = len(keys) + 2 * len(part) + 1
    left_keys, left = np.empty(room, np.int64), np.empty((room, 4), np.int32)
    n = merge_part(
        (keys, pieces), len(keys), (part.keys, part.bounds), -1, part.cycle - window + 1,
        (left_keys, left),
    )  # fmt: skip
    cells, spans = np.empty(n, np.int64), np.empty((n, 2), np.int32)
    m = write_composites(left_keys, left, n, cells, spans)
    return cells[:m].copy(), spans[:m].copy()


@kernel
def _slot(key: Any, mask: Any) -> Any:
    """Return the first slot of a cell in the hash table: the mixed bits of its key."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64(mixed >> np.uint64(20)) & mask


class CellIndex(NamedTuple):
    """Cuboids by cell, in an open-addressing hash table.

    Attributes
    ----------
    keys, spans
        int64 (C,), sorted cells, and float64 (C, 2), bottom and top, m.
    table, first
        int64, slot -> cell, and slot -> index of the cell's first cuboid or -1.
    """

    keys: Int64
    spans: Float64
    table: Int64
    first: Int64


@kernel
def index_cells(keys: Any, spans: Any) -> Any:
    """Return the `CellIndex` of cuboids sorted by cell."""
    size = 64
    while size < 2 * len(keys):
        size *= 2
    table, first = np.zeros(size, np.int64), np.full(size, -1, np.int64)
    for i in range(len(keys)):
        if i > 0 and keys[i] == keys[i - 1]:
            continue
        slot = _slot(keys[i], size - 1)
        while first[slot] >= 0:
            slot = (slot + 1) & (size - 1)
        table[slot], first[slot] = keys[i], i
    return CellIndex(keys, spans, table, first)


@kernel
def _mark_cell(key: Any, low: Any, high: Any, index: Any, passed: Any) -> None:
    """Mark the cuboids of a cell in which the heights [low, high] are at least `MARGIN` deep."""
    keys, spans, table, first = index
    mask = len(table) - 1
    slot = _slot(key, mask)
    while first[slot] >= 0 and table[slot] != key:
        slot = (slot + 1) & mask
    i = first[slot]
    while 0 <= i < len(keys) and keys[i] == key:
        if low < spans[i, 1] - MARGIN and high > spans[i, 0] + MARGIN:
            passed[i] = True
        i += 1


@kernel
def mark_passed(origins: Any, ends: Any, hits: Any, cell: Any, index: Any, passed: Any) -> None:
    """Trace beams from cell to cell and mark the cuboids through which they pass.

    Parameters
    ----------
    origins, ends, hits
        float64 (N, 3), m, in the map's frame, and bool (N,): whether a beam has a hit.
    cell
        Edge of a cell, m.
    index
        `CellIndex` of the cuboids.
    passed
        bool (C,), written: True if a beam passed through.
    """
    for i in range(len(origins)):
        ox, oy, oz = origins[i, 0] / cell, origins[i, 1] / cell, origins[i, 2]
        dx, dy = ends[i, 0] / cell - ox, ends[i, 1] / cell - oy
        dz = ends[i, 2] - oz
        level = np.hypot(dx, dy)
        stop = 1.0 if not hits[i] else (level - STOP_CELLS) / max(level, 1e-9)
        if stop <= 0.0:
            continue
        ix, iy = np.int64(np.floor(ox)), np.int64(np.floor(oy))
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        t, t_next = 0.0, 0.0
        while t_next < stop:
            tx = ((ix + (dx > 0.0)) - ox) / dx if dx != 0.0 else np.inf
            ty = ((iy + (dy > 0.0)) - oy) / dy if dy != 0.0 else np.inf
            t_next = min(min(tx, ty), stop)
            z0, z1 = oz + t * dz, oz + t_next * dz
            key = (ix << 32) + iy
            _mark_cell(key, min(z0, z1), max(z0, z1), index, passed)
            t = t_next
            if tx <= ty:
                ix += step_x
            else:
                iy += step_y
