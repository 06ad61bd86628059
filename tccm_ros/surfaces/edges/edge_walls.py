"""Walls of the map as constraints on the edges of a surface.

A wall behind a surface bounds it. A block of furniture occludes the wall behind it from the level
laser; the map then has a wall to either side of the block and a gap between them, and the wall is
continued over the gap. The front of the block is a wall of the map as well: the top extends as far
as its front.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.outlines.edge_position import EDGE_SIGMA, WALL_DISTANCE
from tccm_ros.robust import GATE
from tccm_ros.slam.walls.corners import JOINED
from tccm_ros.surfaces.edges.edge_samples import Edge
from tccm_ros.surfaces.polygons import GRID

WALL_YAW = np.radians(4.0)
"""Max yaw between an edge and a wall along which it may run, rad; chosen."""

AT_WALL = GATE * EDGE_SIGMA
"""An edge within this distance of a wall ends at it, m."""

OVERHANG = 0.03
"""Max distance of the edge of a board from the front below it, and of a wall from the line of the
wall that it continues, m; chosen: a worktop. Faces of two pieces of furniture are further away."""


def walls_near(outline: Polygon, walls: Float64) -> Float64:
    """Return the walls near an outline, including walls that furniture there occludes.

    Parameters
    ----------
    outline
        Outline of a surface, in x and y of map.
    walls
        float64 (W, 2, 2), ends of the walls in map, m.

    Returns
    -------
    float64 (N, 2, 2)
    """
    near = shapely.dwithin(shapely.linestrings(walls), outline, WALL_DISTANCE)
    found = [*walls[near], *_walls_behind(outline, walls)]
    return np.reshape([wall for wall in found if not _is_crossed(outline, wall)], (-1, 2, 2))


def _is_crossed(outline: Polygon, wall: Float64) -> bool:
    """Return whether an outline is on both sides of a wall; such a wall does not bound it."""
    along = wall[1] - wall[0]
    normal = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    beside = shapely.LineString(wall).buffer(float(outline.length), cap_style="flat")
    across = (shapely.get_coordinates(outline.intersection(beside)) - wall[0]) @ normal
    return bool(min(-across.min(initial=0.0), across.max(initial=0.0)) > WALL_DISTANCE)


def _walls_behind(outline: Polygon, walls: Float64) -> Iterator[Float64]:
    """Yield the gaps between two collinear walls that are beside an outline, as walls."""
    length = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
    beside = shapely.dwithin(_lines(walls, float(outline.length)), outline, WALL_DISTANCE)
    for i, j in combinations(np.flatnonzero(beside).tolist(), 2):
        first, second = (walls[i], walls[j]) if length[i] >= length[j] else (walls[j], walls[i])
        start, along = first[0], (first[1] - first[0]) / max(length[i], length[j], 1e-9)
        across = (second - start) @ np.array([along[1], -along[0]])
        if np.abs(across).max() > OVERHANG:
            continue
        spans = [np.sort((wall - start) @ along) for wall in (first, second)]
        (_, low), (high, _) = sorted(spans, key=lambda span: span.tolist())
        between = start + np.array([[low], [high]]) * along
        if low < high and shapely.dwithin(shapely.LineString(between), outline, WALL_DISTANCE):
            yield between


def _lines(walls: Float64, beyond: float) -> shapely.Geometry:
    """Return walls extended at both ends by a length, m."""
    along = walls[:, 1] - walls[:, 0]
    along = along / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    ends = np.stack([walls[:, 0] - beyond * along, walls[:, 1] + beyond * along], axis=1)
    return shapely.linestrings(ends)


def front_beyond(edge: Edge, outward: Float64, walls: Float64) -> float:
    """Return the extent of the front below an edge beyond one of its ends, m; 0: none.

    Walls that nearly meet are joined in a corner, so that a front may end before it.

    Parameters
    ----------
    edge
        An edge that faces the views.
    outward
        float64 (2,), unit, along the edge towards that end.
    walls
        float64 (W, 2, 2), ends of the walls in map, m, without occluded walls.
    """
    front = wall_along(edge, walls)
    across = wall_across(edge, walls)
    if front is None or across is None or abs(across) > OVERHANG:
        return 0.0
    last = front[np.argmax(front @ outward)]
    beyond = float(last @ outward - max(edge.start @ outward, edge.end @ outward))
    is_corner = np.count_nonzero((np.abs(walls - last) <= GRID).all(axis=2)) > 1
    return beyond if beyond > (JOINED if is_corner else 0.0) else 0.0


def yaw_of(direction: Float64) -> float:
    """Return the yaw of a direction, float64 (2,), rad."""
    return float(np.arctan2(direction[1], direction[0]))


def wall_across(edge: Edge, walls: Float64) -> float | None:
    """Return the distance across an edge of the wall that it runs along, m; None: no such wall."""
    wall = wall_along(edge, walls)
    if wall is None:
        return None
    (start, end), middle = wall, 0.5 * (edge.start + edge.end)
    along = (end - start) / np.hypot(*(end - start))
    nearest = start + ((middle - start) @ along) * along
    return float((nearest - middle) @ edge.outward)


def wall_along(edge: Edge, walls: Float64) -> Float64 | None:
    """Return the nearest wall that runs along an edge, float64 (2, 2); None: no such wall."""
    best, nearest = None, WALL_DISTANCE
    line = shapely.LineString([edge.start, edge.end])
    for wall in walls:
        direction = wall[1] - wall[0]
        sine = float(direction @ edge.outward) / max(float(np.hypot(*direction)), 1e-9)
        if abs(sine) > np.sin(WALL_YAW):
            continue
        beside = shapely.LineString(wall).buffer(nearest, cap_style="flat")
        distance = shapely.distance(
            line.interpolate(0.5, normalized=True), shapely.LineString(wall)
        )
        if distance < nearest and beside.intersection(line).length >= 0.5 * edge.length:
            best, nearest = wall, float(distance)
    return best
