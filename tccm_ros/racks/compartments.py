"""Detection of rack compartments from surfaces, ends of beams, and space that beams passed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse, spatial, transform
from tccm_ros.outlines.transformation import transform_outline
from tccm_ros.racks.boards import (
    NEAR_RACK,
    board_frame,
    board_outline,
    completed_boards,
    front_edge,
    whole_boards,
    with_seen_sides,
)
from tccm_ros.racks.ceilings import BoardAbove, Ceiling, ceilings
from tccm_ros.racks.compartment import Compartment, FaceState, OpenPart, SeenView
from tccm_ros.racks.faces import ON_FACE, Face, SeenFace, measure_face
from tccm_ros.racks.hits import Hits, HitsInMap
from tccm_ros.racks.seen_space import seen_space
from tccm_ros.records import HITS_CUBE, Surface
from tccm_ros.tabletop.footprints import cluster_footprints, convex_hull, rectangle

MIN_FRONT = 0.3
"""Minimum fraction of a front that beams passed; chosen: a door may cover half of it."""

FACE_MARGIN = 0.04
"""Faces are evaluated up to this distance from the boards, m: one cube of hits."""

COMMON_FRONT = 0.8
"""Minimum common fraction of the extents of two boards along the front of a rack. Chosen: boards on
the same posts agree within the errors of their edges, and a seat below a table does not."""

MAX_SETBACK = 0.1
"""Maximum distance of the front edges of boards with a common front, m; chosen: a base is deeper by
as much."""

LINKED = 2.0 * HITS_CUBE
"""Maximum distance of neighbouring hits on one part, m: there may be an empty cube between them."""

MIN_HITS = 9
"""Minimum number of hits on a part; chosen: a part of 12 cm square has as many cubes, mixed pixels
at an edge have fewer."""


def find_compartments(
    surfaces: Sequence[Surface], views: Sequence[SeenView]
) -> tuple[Compartment, ...]:
    """Return the compartments that views observed, by rack and height.

    Parameters
    ----------
    surfaces
        Surfaces of the map.
    views
        In order of time.
    """
    boards = [surface for surface in surfaces if surface.label != "floor"]
    if not boards or not views:
        return ()
    outlines = np.array([board_outline(board) for board in boards], dtype=object)
    hits, every, found = HitsInMap(views), shapely.union_all(outlines), []
    for stack in _stacks(outlines):
        around = shapely.union_all(outlines[stack])
        own, near = (
            completed_boards(whole_boards([boards[k] for k in stack])),
            hits.near(around, NEAR_RACK),
        )
        if not any(True for board in own for _ in _ceilings(board, own, near)):
            continue  # nothing is above, as with tables
        near = near.without_removed()
        used = [views[v] for v in np.unique(near.view).tolist()]
        spaces = [c for board in own for c in _compartments_over(board, own, near, used)]
        if spaces:
            lowest = min(spaces, key=lambda c: float(c.T_map_front[2, 3]))
            for space in spaces:
                parts = open_parts(space, near, every)
                found.append(replace(space, rack=lowest.board, open_parts=parts))
    return tuple(sorted(found, key=lambda c: (c.rack, float(c.T_map_front[2, 3]), c.board)))


def _stacks(outlines: NDArray[np.object_]) -> list[list[int]]:
    """Return the sets of boards that are connected by overlaps seen from above, as indices."""
    n = len(outlines)
    a, b = shapely.STRtree(outlines).query(outlines, "intersects")
    links = coo_array((np.ones(len(a), bool), (a, b)), shape=(n, n))
    groups: dict[int, list[int]] = {}
    for k, label in enumerate(connected_components(links, directed=False)[1].tolist()):
        groups.setdefault(label, []).append(k)
    return list(groups.values())


def _compartments_over(
    board: Surface, stack: Sequence[Surface], hits: Hits, views: Sequence[SeenView]
) -> Iterator[Compartment]:
    """Yield the compartments over a board; only the lowest of those without a board above."""
    T_map_board, below_none = board_frame(board, stack), []
    for ceiling in _ceilings(board, stack, hits):
        above = [] if ceiling.above < 0 else [stack[ceiling.above]]
        other = above[0].id if above else None
        ceiling = with_seen_sides(ceiling, [board, *above], T_map_board)
        found = _compartment(board.id, other, T_map_board, ceiling, hits, views)
        if found is None:
            continue
        upper = None if other is None else stack[ceiling.above]
        walls = found.left, found.right, found.back
        if FaceState.MEASURED in walls or _have_common_front(board, upper, found):
            if other is None:
                below_none.append(found)
            else:
                yield found
    yield from sorted(below_none, key=lambda c: c.height)[:1]


def _have_common_front(board: Surface, above: Surface | None, found: Compartment) -> bool:
    """Return whether a board and its ceiling have a common front edge.

    Without a wall between them this distinguishes the boards of a rack on posts from a table with
    a seat below it.
    """
    T = inverse(found.T_map_front)
    outlines = board_outline(board), found.outline if above is None else board_outline(above)
    low, high = np.array([transform_outline(T, part).bounds for part in outlines])[:, [1, 3]].T
    common = (high.min() - low.max()) / (high.max() - low.min())
    fronts = [0.0 if one is None else front_edge(one, T) for one in (board, above)]
    return bool(common >= COMMON_FRONT and np.ptp(fronts) <= MAX_SETBACK)


def _ceilings(board: Surface, stack: Sequence[Surface], hits: Hits) -> Iterator[Ceiling]:
    """Yield the ceilings over the parts of a board, in its frame."""
    T_board = inverse(board_frame(board, stack))
    above = [
        BoardAbove(transform_outline(T_board, board_outline(other)), other.height - board.height, k)
        for k, other in enumerate(stack)
        if other.height > board.height
    ]
    ends, origins = transform(T_board, hits.ends), transform(T_board, hits.origins)
    own = transform_outline(T_board, board_outline(board))
    yield from ceilings(own, above, ends, hits.half, origins)


def _compartment(
    board: int,
    above: int | None,
    T_map_board: Float64,
    ceiling: Ceiling,
    hits: Hits,
    views: Sequence[SeenView],
) -> Compartment | None:
    """Return the compartment below a ceiling; None if its front is not observed to be open.

    Parameters
    ----------
    board, above
        Ids of the board, and of the board above.
    T_map_board, ceiling
        The frame of the board, and the ceiling in it.
    hits, views
        Hits and views near the rack.
    """
    middle, half = 0.5 * (ceiling.low + ceiling.high), 0.5 * (ceiling.high - ceiling.low)
    height = ceiling.height - 2.0 * FACE_MARGIN
    if height <= 0.0:
        return None
    faces = [_face(T_map_board, middle, half, height, k) for k in range(4)]
    seen = [measure_face(face, hits, views) for face in faces]
    front = _front(faces, seen, hits)
    if seen[front].bar < math.inf:
        height = seen[front].bar + FACE_MARGIN
        lower = replace(ceiling, height=height, state=FaceState.MEASURED, above=-1)
        return _compartment(board, None, T_map_board, lower, hits, views)
    is_known = ceiling.above >= 0 or ceiling.state == FaceState.MEASURED
    if seen[front].passed < MIN_FRONT or not is_known:
        return None
    right, back, left = (seen[(front + k) % 4] for k in (1, 2, 3))
    is_along = front % 2 == 0  # its normal is the x axis of the board
    depth, width = 2.0 * (half if is_along else half[::-1])
    depth += _offset(back)
    width += _offset(left) + _offset(right)
    T_face = faces[front].T_map_face
    T = T_face.copy()
    T[:3, 0], T[:3, 1] = -T_face[:3, 0], -T_face[:3, 1]
    T[:3, 3] += 0.5 * (_offset(left) - _offset(right)) * T[:3, 1]
    T[2, 3] -= FACE_MARGIN
    size = np.array([depth, width, ceiling.height])
    return Compartment(
        rack=board,
        board=board,
        above=above,
        T_map_front=T,
        width=float(width),
        depth=float(depth),
        height=ceiling.height,
        left=left.state,
        right=right.state,
        back=back.state,
        ceiling=ceiling.state,
        front_seen=seen[front].passed,
        space=seen_space(T, size, hits, views),
    )


def _face(T_map_board: Float64, middle: Float64, half: Float64, height: float, k: int) -> Face:
    """Return the k-th face around a part of a board: counter-clockwise, 0 is towards x."""
    normal = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][k])
    T = spatial([*(middle + normal * half), 0.5 * math.pi * k], FACE_MARGIN)
    return Face(T_map_board @ T, 2.0 * float(half[1 - k % 2]), height)


def _front(faces: Sequence[Face], seen: Sequence[SeenFace], hits: Hits) -> int:
    """Return the index of the open face most towards the sensors; else of the most open one."""
    mean_sensor = hits.origins.mean(axis=0)

    def towards(k: int) -> float:
        T = faces[k].T_map_face
        return float((mean_sensor - T[:3, 3]) @ T[:3, 0])

    threshold = min(MIN_FRONT, max(face.passed for face in seen))
    return max((k for k in range(4) if seen[k].passed >= threshold), key=lambda k: (towards(k), -k))


def _offset(face: SeenFace) -> float:
    """Return the offset of a face outwards from the board's edge, m; 0 if it was not measured."""
    return face.offset if face.state == FaceState.MEASURED else 0.0


def open_parts(space: Compartment, hits: Hits, known: shapely.Geometry) -> tuple[OpenPart, ...]:
    """Return the doors and drawers before the front of a compartment, from left to right.

    They are no surfaces and no objects of the map. Each is the smallest box around the ends of
    beams on it, with vertical sides.

    Parameters
    ----------
    space
        The compartment.
    hits
        Hits near it.
    known
        Outlines of surfaces, seen from above in map, m: hits there are on them, or on objects.
    """
    local = transform(inverse(space.T_map_front), hits.ends)
    before = (local[:, 0] < -ON_FACE) & (local[:, 2] > HITS_CUBE) & (local[:, 2] < space.height)
    before &= ~shapely.intersects_xy(known, *hits.ends[:, :2].T)
    chosen = np.flatnonzero(before)
    members, starts = cluster_footprints(np.ascontiguousarray(local), chosen, LINKED)
    found = []
    for part in np.split(members, starts[1:-1]):
        hull = convex_hull(local[part, :2])
        is_before = np.abs(local[part, 1]).min(initial=np.inf) < 0.5 * space.width
        if len(part) < MIN_HITS or len(hull) < 3 or not is_before:
            continue
        x, y, length, width, yaw = rectangle(hull)
        low = float((local[part, 2] - hits.half[part]).min())
        high = float((local[part, 2] + hits.half[part]).max())
        T = spatial(np.array([x, y, yaw]), 0.5 * (low + high))
        found.append((-y, OpenPart(space.T_map_front @ T, np.array([length, width, high - low]))))
    return tuple(part for _, part in sorted(found, key=lambda item: item[0]))
