"""Borders between cells: their fraction of wall, and merging of cells with too little wall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, Polygon

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.rooms.cells import SNAP, extended

MIN_WALL_FRACTION = 0.42
"""Minimum fraction of wall in the border between two rooms. Chosen: a door of 0.8 m in a wall of
1.5 m leaves 0.47."""

ON_WALL = 0.10
"""Maximum distance of a border from its wall, m. Chosen: the noise of walls."""

MAX_THICKNESS = 0.3
"""Maximum thickness of a wall, across which cells have a border, m. Chosen."""

Pair = tuple[int, int]


@dataclass
class Border:
    """The border between two cells or groups of them.

    Attributes
    ----------
    length
        Length of the border, m.
    wall
        Length of wall in it, m.
    support
        Length of the walls on whose lines it lies, m.
    """

    length: float
    wall: float
    support: float

    def added(self, other: Border | None) -> Border:
        """Return the sum of this border and another one of the same two groups."""
        if other is None:
            return self
        support = max(self.support, other.support)
        return Border(self.length + other.length, self.wall + other.wall, support)


def cell_borders(
    cells: Sequence[Polygon], lines: Sequence[Float64], walls: Sequence[Float64]
) -> dict[Pair, Border]:
    """Return the borders between cells that touch or have only a wall between them.

    Parameters
    ----------
    cells
        Cells of the plane.
    lines
        float64 (2, 2) each, walls that define the cells, m.
    walls
        float64 (2, 2) each, all walls as observed, m.
    """
    near, behind = (
        shapely.union_all([LineString(w).buffer(far, cap_style="flat") for w in (*lines, *walls)])
        for far in (ON_WALL, MAX_THICKNESS)
    )
    lengths = np.array([LineString(line).length for line in lines])
    long_lines = np.array([extended(line) for line in lines], dtype=object)
    line_tree = shapely.STRtree(long_lines)
    found = {}
    for a, b in shapely.STRtree(cells).query(cells, "dwithin", MAX_THICKNESS).T.tolist():
        if a >= b:
            continue
        common, of_wall = shapely.intersection(cells[a].exterior, cells[b].exterior), near
        if common.length <= MAX_THICKNESS:  # there is a wall between them
            beside = cells[b].buffer(MAX_THICKNESS, join_style="mitre")
            common, of_wall = shapely.intersection(cells[a].exterior, beside), behind
        if common.length > SNAP:
            on = line_tree.query(common, "dwithin", SNAP)
            shared = shapely.intersection(shapely.buffer(long_lines[on], 0.01), common)
            is_along = shapely.length(shared) > 0.5 * min(common.length, 1.0)
            wall = shapely.intersection(common, of_wall).length
            found[a, b] = Border(common.length, wall, float(lengths[on][is_along].sum()))
    return found


def merged_cells(borders: dict[Pair, Border], is_used: Bool) -> Int64:
    """Return the group number of each cell, -1 for unused cells.

    Groups are merged if less than `MIN_WALL_FRACTION` of their border is wall, beginning with
    borders on extensions of short walls, because sides of furniture are shorter than walls.

    Parameters
    ----------
    borders
        Borders between cells.
    is_used
        bool (N,), cells to merge.
    """
    group = np.where(is_used, np.arange(len(is_used)), -1)
    left = {pair: b for pair, b in borders.items() if is_used[pair[0]] and is_used[pair[1]]}
    while True:
        crossed = [p for p, b in left.items() if b.wall < MIN_WALL_FRACTION * b.length]
        if not crossed:
            return group
        first, second = min(
            crossed, key=lambda p: (left[p].support, left[p].wall / left[p].length, p)
        )
        group[group == second] = first
        for pair in [pair for pair in left if second in pair]:
            border = left.pop(pair)
            other = pair[0] if pair[1] == second else pair[1]
            if other != first:
                joined = min(first, other), max(first, other)
                left[joined] = border.added(left.get(joined))
