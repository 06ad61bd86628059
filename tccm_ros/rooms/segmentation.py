"""Rooms of a map: areas enclosed by walls once doors are closed.

A door is a gap between walls. Each wall is extended at both ends by the width of a door, and the
lines divide the plane into cells. Cells that the level laser observed as free, and that little wall
separates, form a room. Furniture in it or along its walls belongs to the room.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.polygon import orient

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.rooms.borders import MAX_THICKNESS, Border, Pair, cell_borders, merged_cells
from tccm_ros.rooms.cells import aligned, frame, free_fraction, half_width, plane_cells
from tccm_ros.slam.occupancy import OccupancyGrid

MIN_WALLS = 3
"""Minimum number of walls around a room."""

MIN_HALF_WIDTH = 0.5
"""Minimum radius of the largest inscribed circle of a room, m. Chosen: narrower cells are in front
of a wall or beside a cupboard."""

MIN_AREA = 1.2
"""Minimum area of a room, m2. Chosen: a closet."""

MIN_FREE_FRACTION = 0.35
"""Minimum free fraction of a room's cell. Chosen: that of rooms seen through a door."""

MAX_HIDDEN_HALF_WIDTH = 0.6
"""Maximum radius of the largest inscribed circle of furniture, m, whose inside is hidden.
Chosen."""

MIN_CONTACT = 0.3
"""Minimum fraction of the outline of furniture on its room. Chosen."""

PASSES = 4
"""Number of passes that assign narrow cells to adjacent rooms, for cells behind cells. Chosen."""

SIMPLE = 0.02
"""Corners nearer than this to the line of their neighbours are removed, m."""


def find_rooms(walls: Sequence[Float64], grid: OccupancyGrid) -> list[Float64]:
    """Return the boundaries of the rooms of a map, from the largest to the smallest.

    Parameters
    ----------
    walls
        float64 (2, 2) each, ends of the walls' observed extent in map, m.
    grid
        Grid of the level scans.

    Returns
    -------
    list of float64 (N, 2)
        Open rings in map, counter-clockwise, m. They do not overlap.
    """
    lines = aligned(walls)
    if len(lines) < MIN_WALLS:
        return []
    cells = plane_cells([*lines, *frame(lines)])
    if not cells:
        return []
    borders = cell_borders(cells, lines, walls)
    free = np.array([free_fraction(cell, grid) for cell in cells])
    widths = np.array([half_width(cell) for cell in cells])
    is_free = free >= MIN_FREE_FRACTION
    group = merged_cells(borders, is_free & (widths >= 0.5 * MAX_THICKNESS))
    group = _rooms_alone(cells, group)
    for _ in range(PASSES):
        group = _with_parts(cells, borders, group, widths, is_free)
    rooms = sorted(_outlines(cells, group), key=lambda room: -room.area)
    return [np.array(orient(room).exterior.coords)[:-1] for room in rooms]


def _rooms_alone(cells: Sequence[Polygon], group: Int64) -> Int64:
    """Return the groups that are large and wide enough for a room; -1 for the cells of others."""
    alone = group.copy()
    for number in np.unique(group[group >= 0]):
        area = shapely.union_all([c for c, g in zip(cells, group) if g == number])
        if area.area < MIN_AREA or half_width(area) < MIN_HALF_WIDTH:
            alone[group == number] = -1
    return alone


def _with_parts(
    cells: Sequence[Polygon],
    borders: Mapping[Pair, Border],
    group: Int64,
    widths: Float64,
    is_free: Bool,
) -> Int64:
    """Assign narrow free cells, and furniture with its hidden inside, to adjacent rooms."""
    touched: list[dict[int, float]] = [{} for _ in cells]
    for (a, b), border in borders.items():
        for cell, other in ((a, b), (b, a)):
            room = int(group[other])
            if room >= 0:
                touched[cell][room] = touched[cell].get(room, 0.0) + border.length
    grown = group.copy()
    for k, rooms in enumerate(touched):
        if group[k] >= 0 or not rooms or widths[k] < 0.5 * MAX_THICKNESS:
            continue
        room = max(rooms, key=lambda r: (rooms[r], -r))
        hides = widths[k] < MAX_HIDDEN_HALF_WIDTH and rooms[room] > MIN_CONTACT * cells[k].length
        if is_free[k] or (len(rooms) == 1 and hides):
            grown[k] = room
    return grown


def _outlines(cells: Sequence[Polygon], group: Int64) -> Iterator[Polygon]:
    """Yield the areas of rooms, without holes and without notches that are as thin as walls."""
    taken = shapely.Polygon()
    for number in np.unique(group[group >= 0]):
        area = shapely.union_all([c for c, g in zip(cells, group) if g == number])
        half = 0.5 * MAX_THICKNESS
        area = area.buffer(half, join_style="mitre").buffer(-half, join_style="mitre")
        for part in getattr(area, "geoms", [area]):
            room = Polygon(part.exterior).simplify(SIMPLE).difference(taken)
            if not room.is_valid:  # rounding of nearly coincident edges
                room = shapely.make_valid(room)
            room = max(getattr(room, "geoms", [room]), key=lambda piece: piece.area)
            if room.area >= MIN_AREA and half_width(room) >= MIN_HALF_WIDTH:
                taken = taken.union(room)
                yield room
