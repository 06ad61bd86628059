"""Boards of a rack: merged pieces, and ends, axes and sides by the edges that were seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import shapely
from shapely import Point, Polygon

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse, spatial, transform
from tccm_ros.racks.ceilings import GRID, MIN_FILLED, Ceiling
from tccm_ros.records import EdgeState, Surface, SurfaceEdge
from tccm_ros.tabletop.footprints import convex_hull, rectangle
from tccm_ros.tabletop.free_places import polygon_parts
from tccm_ros.tabletop.round_objects import rectangle_around

NEAR_RACK = 0.5
"""Maximum distance of the hits of a rack, and of a board's end beyond its last seen point, m;
chosen: more than the space grid extends before the front."""

SAME_HEIGHT = 0.015
"""Maximum difference in height of pieces of one board, m; chosen: boards of a rack differ by more.
"""

EDGE_ERROR = 0.02
"""Maximum error of an edge of a board, m; `ceilings.EDGE` without the cube of hits."""

PARALLEL = 0.17
"""Maximum angle between edges of the boards of a rack, rad. Chosen: 10 degrees, more than a
rectangle turns of which one short side was seen."""

LONG = 10.0
"""Longer than any board, m."""

EDGE_SIGMAS = 3.0
"""Edges of boards nearer to each other than this multiple of their standard deviation are one side.
Chosen: rejects 0.3 % of Gaussian errors."""


def board_outline(surface: Surface) -> shapely.Geometry:
    """Return the outline of a surface seen from above, in map, m."""
    return shapely.make_valid(Polygon(surface.boundary[:, :2]))


def whole_boards(boards: Sequence[Surface]) -> list[Surface]:
    """Return the boards with pieces of one board merged, under the id of the largest piece.

    Pieces have equal heights and fill their bounding rectangle. Two merged pieces
    may fill it together with a third one that neither of them does alone.
    """
    found = sorted(boards, key=lambda b: (-b.area, b.id))
    while True:
        for k, j in combinations(range(len(found)), 2):
            merged = _merged(found[k], found[j])
            if merged is not None:
                found[k] = merged
                del found[j]
                break
        else:
            return found


def completed_boards(boards: Sequence[Surface]) -> list[Surface]:
    """Return boards extended beyond their hidden edges to the seen edges of other boards.

    Where a board occludes the end of the board below it, the lower one may extend further.
    """
    outlines = [board_outline(board) for board in boards]
    seen = [(outline, e) for outline, board in zip(outlines, boards) for e in _seen_edges(board)]
    found = []
    for board, outline in zip(boards, outlines):
        more: list[Polygon] = []
        unseen = [edge for edge in board.edges if edge.state != EdgeState.SEEN]
        for hidden in unseen:
            beyond = _beside(_with_corners(hidden, unseen), NEAR_RACK)
            for other, edge in seen:
                if _normal(edge) @ _normal(hidden) > math.cos(PARALLEL):
                    area = beyond.intersection(_beside(edge, -LONG))
                    more += polygon_parts(other.intersection(area))
        if more:
            whole = polygon_parts(shapely.union_all([outline, *more], grid_size=GRID))[0]
            ring = np.array(whole.exterior.coords)[:-1]
            board = replace(board, boundary=np.column_stack([ring, board.height_at(ring)]))
        found.append(board)
    return found


def board_frame(surface: Surface, stack: Sequence[Surface]) -> Float64:
    """Return the horizontal pose, float64 (4, 4), of a board.

    Its axes are those of the smallest rectangle around the board, turned to the mean direction of
    the seen edges of all boards that are parallel to it: hidden edges have no known direction.
    """
    x, y, _, _, yaw = rectangle_around(surface.boundary)
    angles = [_angle_to_axis(edge, yaw) for board in stack for edge in _seen_edges(board)]
    angle, weight = np.array([a for a in angles if abs(a[0]) < PARALLEL]).reshape(-1, 2).T
    if weight.sum():
        yaw += float(angle @ weight / weight.sum())
    return spatial([x, y, yaw], surface.height_at(np.array([x, y])))


def with_seen_sides(ceiling: Ceiling, boards: Sequence[Surface], T_map_board: Float64) -> Ceiling:
    """Return a ceiling whose sides are the means of the seen edges there, by their sigmas.

    Parameters
    ----------
    ceiling
        In the frame of the board below it.
    boards
        This board and that of the ceiling.
    T_map_board
        float64 (4, 4), the frame.
    """
    T_board, sides = inverse(T_map_board), np.array([ceiling.low, ceiling.high])
    found = sides.copy()
    for end, axis in product(range(2), range(2)):
        towards = T_map_board[:2, axis] * (2 * end - 1)
        total = weight = 0.0
        for edge in (edge for board in boards for edge in _seen_edges(board)):
            at = transform(T_board, np.array([edge.start, edge.end])).mean(axis=0)[axis]
            is_there = abs(at - sides[end, axis]) < EDGE_SIGMAS * edge.sigma
            if _normal(edge) @ towards > math.cos(PARALLEL) and is_there:
                total, weight = total + at / edge.sigma**2, weight + 1.0 / edge.sigma**2
        if weight:
            found[end, axis] = total / weight
    return replace(ceiling, low=found[0], high=found[1])


def front_edge(board: Surface, T_front: Float64) -> float:
    """Return x of the longest seen edge towards the front; of the foremost point without one."""
    ends = [transform(T_front, np.array([edge.start, edge.end])) for edge in _seen_edges(board)]
    ahead = [e for e in ends if e[0, 1] - e[1, 1] > abs(e[0, 0] - e[1, 0])]
    if not ahead:
        return float(transform(T_front, board.boundary)[:, 0].min())
    return float(max(ahead, key=lambda e: e[0, 1] - e[1, 1])[:, 0].mean())


def _merged(board: Surface, other: Surface) -> Surface | None:
    """Return two pieces as one board with the id of the first; None if they are two boards."""
    if abs(board.height - other.height) > SAME_HEIGHT:
        return None
    both = np.concatenate([board.boundary, other.boundary])
    hull = convex_hull(np.ascontiguousarray(both[:, :2]))
    _, _, length, width, _ = rectangle(hull)
    area = board.area + other.area
    if area < MIN_FILLED * length * width:
        return None
    ring, around = np.column_stack([hull, board.height_at(hull)]), Polygon(hull).exterior
    edges = [
        edge
        for edge in (*board.edges, *other.edges)
        if around.distance(Point(0.5 * (edge.start + edge.end))) < EDGE_ERROR
    ]
    return replace(board, boundary=ring, edges=tuple(edges), area=area)


def _normal(edge: SurfaceEdge) -> Float64:
    """Return the outward normal of an edge seen from above, float64 (2,)."""
    x, y = (edge.end - edge.start)[:2] / np.linalg.norm((edge.end - edge.start)[:2])
    return np.array([y, -x])


def _with_corners(edge: SurfaceEdge, unseen: Sequence[SurfaceEdge]) -> SurfaceEdge:
    """Return an edge that was not seen, extended beyond its corners with other such edges."""
    step = NEAR_RACK * (edge.end - edge.start) / np.linalg.norm(edge.end - edge.start)
    before = any(np.allclose(other.end, edge.start) for other in unseen)
    after = any(np.allclose(other.start, edge.end) for other in unseen)
    return replace(edge, start=edge.start - before * step, end=edge.end + after * step)


def _beside(edge: SurfaceEdge, width: float) -> Polygon:
    """Return the area along an edge seen from above, outside if the width, m, is positive."""
    normal, ends = _normal(edge), np.array([edge.start[:2], edge.end[:2]])
    inner = ends - math.copysign(EDGE_ERROR, width) * normal
    return Polygon(np.concatenate([inner, ends[::-1] + width * normal])).buffer(0.0)


def _seen_edges(board: Surface) -> list[SurfaceEdge]:
    """Return the edges of a board that were seen."""
    return [edge for edge in board.edges if edge.state == EdgeState.SEEN and edge.sigma > 0.0]


def _angle_to_axis(edge: SurfaceEdge, yaw: float) -> tuple[float, float]:
    """Return the angle from the nearest axis to a seen edge, rad, and its information."""
    x, y, _ = edge.end - edge.start
    angle = math.remainder(math.atan2(y, x) - yaw, 0.5 * math.pi)
    return angle, (x**2 + y**2) / edge.sigma**2
