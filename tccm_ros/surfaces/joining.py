"""Pieces of one surface with something between them: joined over what nobody could see.

What stands on a sideboard hides strips of it right across, and the sensor may leave out a strip of
the floor. Two pieces that are coplanar, and between which no view looked through, are one surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.surfaces.hidden_places import HIDDEN_WIDTH, MIN_HIDDEN_AREA, is_hidden
from tccm_ros.surfaces.merged_surface import MergedSurface
from tccm_ros.surfaces.patch_planes import (
    FLATNESS,
    GATE,
    fit_covariance,
    pool_moments,
    pose_covariance,
)
from tccm_ros.surfaces.polygons import GRID, box_sides, close_gaps, largest_part, polygons_of
from tccm_ros.surfaces.views import View

__all__ = ["Between", "MayJoin", "hidden_place_between", "join", "join_pieces"]


Between = Callable[[MergedSurface, MergedSurface], Polygon | None]
"""Returns the place between two pieces if they are one surface, otherwise None."""

MayJoin = Callable[[MergedSurface, MergedSurface, Float64], bool]
"""Returns whether two pieces are near enough in height at a place (x, y)."""

MIN_WALL_DISTANCE = 0.05
"""Pieces on two sides of a wall have their centroids at least so far from it, m."""

MIN_FACING_FRACTION, MAX_FACING_WIDTH = 0.5, 1.0
"""The pieces face each other along this fraction of the narrower one's width at least, of which
more than so much (m) does not count: rooms meet in doorways."""


def join(pieces: Sequence[MergedSurface], between: Between) -> list[MergedSurface]:
    """Join pieces that are one surface, directly or over others.

    Parameters
    ----------
    pieces
        Surfaces, in the order of their first patches.
    between
        Is asked of each pair, in order.

    Returns
    -------
    The surfaces, each in the place of its first piece.
    """
    root = np.arange(len(pieces))
    places: dict[int, list[Polygon]] = {}
    for i, j in combinations(range(len(pieces)), 2):
        place = between(pieces[i], pieces[j])
        if place is not None:
            first, second = sorted((int(root[i]), int(root[j])))
            root[root == second] = first
            found = [*places.pop(second, []), place]
            places.setdefault(first, []).extend(found)
    groups = {r: [p for p, k in zip(pieces, root) if k == r] for r in np.unique(root).tolist()}
    return [_joined(group, places.get(r, [])) for r, group in groups.items()]


def join_pieces(
    pieces: Sequence[MergedSurface],
    views: list[View],
    T_map_view: Float64,
    cov_tilt: Float64,
    walls: Float64,
    config: Config,
) -> list[MergedSurface]:
    """Join pieces that are coplanar and between which nobody could look.

    Parameters
    ----------
    pieces
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

    def between(a: MergedSurface, b: MergedSurface) -> Polygon | None:
        place = hidden_place_between(a, b, may_join, views, T_map_view, config)
        return None if place is None or _is_wall_between(a, b, walls) else place

    return join(pieces, between)


def _is_wall_between(a: MergedSurface, b: MergedSurface, walls: Float64) -> bool:
    """Return whether the shortest way from one piece to another leads through a wall."""
    way = shapely.shortest_line(a.polygon, b.polygon)
    crossed = walls[shapely.intersects(shapely.linestrings(walls), way)]
    along = crossed[:, 1] - crossed[:, 0]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    normals /= np.maximum(np.linalg.norm(along, axis=1), GRID)[:, None]
    side = [((s.mean[:2] - crossed[:, 0]) * normals).sum(axis=1) for s in (a, b)]
    distance = np.minimum(-np.minimum(*side), np.maximum(*side))
    return bool((distance >= MIN_WALL_DISTANCE).any())


def _coplanar(T_map_view: Float64, cov_tilt: Float64, config: Config) -> MayJoin:
    """Return the test for pieces: their planes agree in between, as patches' do in `contact`."""

    def may_join(a: MergedSurface, b: MergedSurface, place: Float64) -> bool:
        step = abs(a.height_at(place) - b.height_at(place))
        variance = 2.0 * FLATNESS**2
        share_no_view = a.views.isdisjoint(b.views)
        for piece in (a, b):
            arm = place - piece.mean[:2]
            J = np.array([1.0, arm[0], arm[1]])
            cov = fit_covariance(piece.cov, piece.count)
            if share_no_view:
                view = max(piece.members, key=lambda m: m.patch.count).view
                cov = cov + pose_covariance(T_map_view[view], cov_tilt[view], piece.mean)
            variance += float(J @ cov @ J)
        return bool(step <= min(GATE * np.sqrt(variance), config.surfaces.max_step))

    return may_join


def hidden_place_between(
    a: MergedSurface,
    b: MergedSurface,
    may_join: MayJoin,
    views: list[View],
    T_map_view: Float64,
    config: Config,
    depth: float = 0.0,
) -> Polygon | None:
    """Return the place between two pieces that no view looked through; None: there is none.

    Parameters
    ----------
    a, b
        Two pieces.
    may_join
        Whether they are near enough in height where they are nearest.
    views, T_map_view
        All views, and float64 (V, 4, 4).
    config
        Uses `views.clear_margin`.
    depth
        Looks count this far below the pieces, m.
    """
    if not shapely.dwithin(a.polygon, b.polygon, HIDDEN_WIDTH):
        return None
    nearest = np.array(shapely.shortest_line(a.polygon, b.polygon).centroid.coords[0])
    if not may_join(a, b, nearest):
        return None
    union = shapely.union_all([a.polygon, b.polygon], grid_size=GRID)
    between = polygons_of(close_gaps(union, 0.5 * HIDDEN_WIDTH).difference(union))
    width = min(box_sides(a.polygon)[0], box_sides(b.polygon)[0], MAX_FACING_WIDTH)
    for part in sorted(between.geoms, key=lambda part: (-part.area, part.bounds)):
        if part.area < MIN_HIDDEN_AREA or _facing(part, a, b) < MIN_FACING_FRACTION * width:
            continue
        place = np.array(part.centroid.coords[0])
        height = 0.5 * (a.height_at(place) + b.height_at(place)) - depth
        if is_hidden(part, height, views, T_map_view, config):
            return part
    return None


def _facing(part: Polygon, a: MergedSurface, b: MergedSurface) -> float:
    """Return along how much of their edges, m, both pieces touch a place between them."""
    edge = part.boundary
    return float(min(edge.intersection(s.polygon.buffer(2e-3)).length for s in (a, b)))


def _joined(pieces: Sequence[MergedSurface], places: Sequence[Polygon]) -> MergedSurface:
    """Return one surface of pieces and the places between them."""
    if len(pieces) == 1:
        return pieces[0]
    # A place between touches the pieces along its edges: a hair of overlap makes one of them.
    grown = [place.buffer(2e-3, join_style="mitre") for place in places]
    union = shapely.union_all([*(piece.polygon for piece in pieces), *grown], grid_size=GRID)
    members = sorted((m for piece in pieces for m in piece.members), key=lambda m: m.number)
    moments = pool_moments(
        np.array([float(piece.count) for piece in pieces]),
        np.stack([piece.mean for piece in pieces]),
        np.stack([piece.cov for piece in pieces]),
    )
    outline = largest_part(polygons_of(shapely.make_valid(union)))
    return MergedSurface.of_moments(tuple(members), outline, *moments)
