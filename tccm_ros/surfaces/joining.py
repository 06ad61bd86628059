"""Pieces of one surface with something between them: joined over what nobody could see.

What stands on a sideboard hides strips of it right across, and the sensor may leave out a strip of
the floor. Two pieces that are level with each other, and between which no view looked through, are
one surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from tccm_ros.config import Config
from tccm_ros.surfaces.merged_patches import (
    HIDDEN,
    PROBE,
    Draft,
    is_hidden,
)
from tccm_ros.surfaces.patch_planes import (
    FLATNESS,
    GATE,
    fit_covariance,
    fit_plane,
    pool_moments,
    pose_covariance,
)
from tccm_ros.surfaces.polygons import GRID, close_gaps, largest_part, polygons_of
from tccm_ros.surfaces.views import View

__all__ = ["Bridge", "MayJoin", "hidden_place", "join", "join_pieces", "views_of"]

Float64 = NDArray[np.float64]

Bridge = Callable[[Draft, Draft], Polygon | None]
"""Returns what two pieces have between them if they are one surface, otherwise None."""

MayJoin = Callable[[Draft, Draft, Float64], bool]
"""Tells whether two pieces are level enough with each other at a place (x, y)."""

BEHIND = 0.05
"""Pieces on two sides of a wall have their middles at least so far from it, m."""

FACING, WIDE = 0.5, 1.0
"""The pieces face each other along this share of the narrower one's width at least, of which more
than so much (m) does not count: rooms meet in doorways."""


def join(drafts: Sequence[Draft], bridge: Bridge) -> list[Draft]:
    """Join pieces that are one surface, directly or over others.

    Parameters
    ----------
    drafts
        Surfaces, in the order of their first patches.
    bridge
        Is asked of each pair, in order.

    Returns
    -------
    The surfaces, each in the place of its first piece.
    """
    root = np.arange(len(drafts))
    between: dict[int, list[Polygon]] = {}
    for i, j in combinations(range(len(drafts)), 2):
        place = bridge(drafts[i], drafts[j])
        if place is not None:
            first, second = sorted((int(root[i]), int(root[j])))
            root[root == second] = first
            places = [*between.pop(second, []), place]
            between.setdefault(first, []).extend(places)
    pieces = {r: [d for d, k in zip(drafts, root) if k == r] for r in np.unique(root).tolist()}
    return [_joined(piece, between.get(r, [])) for r, piece in pieces.items()]


def join_pieces(
    drafts: Sequence[Draft],
    views: list[View],
    T_map_view: Float64,
    cov_tilt: Float64,
    walls: Float64,
    config: Config,
) -> list[Draft]:
    """Join pieces that are level with each other and between which nobody could look.

    Parameters
    ----------
    drafts
        Surfaces, in the order of their first patches.
    views
        V views.
    T_map_view, cov_tilt
        float64 (V, 4, 4) and (V, 3, 3) of (z, roll, pitch).
    walls
        float64 (W, 2, 2), ends of the walls in map, m: nobody looks through a wall, and what
        stands behind it is something else.
    config
        Uses `surfaces.max_step` and `views.clear_margin`.
    """
    may_join = _coplanar(T_map_view, cov_tilt, config)

    def bridge(a: Draft, b: Draft) -> Polygon | None:
        place = hidden_place(a, b, may_join, views, T_map_view, config)
        return None if place is None or _is_wall_between(a, b, walls) else place

    return join(drafts, bridge)


def _is_wall_between(a: Draft, b: Draft, walls: Float64) -> bool:
    """Tell whether the shortest way from one piece to another leads through a wall."""
    way = shapely.shortest_line(a.polygon, b.polygon)
    crossed = walls[shapely.intersects(shapely.linestrings(walls), way)]
    along = crossed[:, 1] - crossed[:, 0]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    normals /= np.maximum(np.linalg.norm(along, axis=1), GRID)[:, None]
    side = [((d.mean[:2] - crossed[:, 0]) * normals).sum(axis=1) for d in (a, b)]
    apart = (np.minimum(*side) <= -BEHIND) & (np.maximum(*side) >= BEHIND)
    return bool(apart.any())


def _coplanar(T_map_view: Float64, cov_tilt: Float64, config: Config) -> MayJoin:
    """Return the test for surfaces: their planes agree in between, as in `patch_planes.agree`."""

    def may_join(a: Draft, b: Draft, place: Float64) -> bool:
        step = abs(a.height_at(place) - b.height_at(place))
        variance = 2.0 * FLATNESS**2
        apart = views_of(a).isdisjoint(views_of(b))
        for draft in (a, b):
            arm = place - draft.mean[:2]
            J = np.array([1.0, arm[0], arm[1]])
            cov = fit_covariance(draft.cov, draft.count)
            if apart:
                view = max(draft.members, key=lambda m: m.patch.count).view
                cov = cov + pose_covariance(T_map_view[view], cov_tilt[view], draft.mean)
            variance += float(J @ cov @ J)
        return bool(step <= min(GATE * np.sqrt(variance), config.surfaces.max_step))

    return may_join


def hidden_place(
    a: Draft,
    b: Draft,
    may_join: MayJoin,
    views: list[View],
    T_map_view: Float64,
    config: Config,
    depth: float = 0.0,
) -> Polygon | None:
    """Return the place between two pieces that no view looked through, if they are level there.

    Parameters
    ----------
    a, b
        Two pieces.
    may_join
        Whether they are level enough where they are nearest.
    views, T_map_view
        All views, and float64 (V, 4, 4).
    config
        Uses `views.clear_margin`.
    depth
        Looks count that far below the pieces, m.
    """
    if not shapely.dwithin(a.polygon, b.polygon, HIDDEN):
        return None
    nearest = np.array(shapely.shortest_line(a.polygon, b.polygon).centroid.coords[0])
    if not may_join(a, b, nearest):
        return None
    union = shapely.union_all([a.polygon, b.polygon], grid_size=GRID)
    between = polygons_of(close_gaps(union, 0.5 * HIDDEN).difference(union))
    width = min(_width(a.polygon), _width(b.polygon), WIDE)
    for part in sorted(between.geoms, key=lambda part: (-part.area, part.bounds)):
        if part.area < PROBE**2 or _facing(part, a, b) < FACING * width:
            continue
        place = np.array(part.centroid.coords[0])
        height = 0.5 * (a.height_at(place) + b.height_at(place)) - depth
        if is_hidden(part, height, views, T_map_view, config):
            return part
    return None


def views_of(draft: Draft) -> set[int]:
    """Return the views that saw any of a surface."""
    return {member.view for member in draft.members}


def _facing(part: Polygon, a: Draft, b: Draft) -> float:
    """Return along how much of their edges, m, both pieces touch a place between them."""
    edge = part.boundary
    return float(min(edge.intersection(d.polygon.buffer(2e-3)).length for d in (a, b)))


def _width(polygon: Polygon) -> float:
    """Return the lesser side of a polygon's narrowest box, m."""
    corners = np.array(polygon.minimum_rotated_rectangle.exterior.coords)
    return float(np.linalg.norm(np.diff(corners[:3], axis=0), axis=1).min())


def _joined(pieces: Sequence[Draft], between: Sequence[Polygon]) -> Draft:
    """Return one surface of pieces and what is between them."""
    if len(pieces) == 1:
        return pieces[0]
    # A place between touches the pieces along its edges: a hair of overlap makes one of them.
    places = [place.buffer(2e-3, join_style="mitre") for place in between]
    union = shapely.union_all([*(piece.polygon for piece in pieces), *places], grid_size=GRID)
    members = [member for piece in pieces for member in piece.members]
    members.sort(key=lambda member: member.number)
    total, mean, cov = pool_moments(
        np.array([float(piece.count) for piece in pieces]),
        np.stack([piece.mean for piece in pieces]),
        np.stack([piece.cov for piece in pieces]),
    )
    normal, _ = fit_plane(cov)
    return replace(
        pieces[0],
        members=tuple(members),
        polygon=largest_part(polygons_of(shapely.make_valid(union))),
        mean=mean,
        cov=cov,
        normal=normal,
        offset=float(normal @ mean),
        count=int(total),
    )
