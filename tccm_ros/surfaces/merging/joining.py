"""Joining: merge pieces of one surface over the occluded area between them.

An object on a sideboard occludes a strip across its whole depth, and the sensor may leave out a
strip of the floor. Two coplanar pieces are one surface if no view looked through the area between
them. A single scan line is joined with a piece beside it only if their outlines nearly touch.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.outlines.shape_models import HIDDEN_WIDTH, PROBE
from tccm_ros.surfaces.merging.merged_surface import MergedSurface
from tccm_ros.surfaces.merging.occluded_areas import is_occluded, last_empty_view
from tccm_ros.surfaces.merging.patch_planes import agree_in_height, pool_moments
from tccm_ros.surfaces.merging.surface_errors import SurfaceErrors, step_variance, surface_errors
from tccm_ros.surfaces.polygons import GRID, OVERLAP, close_gaps, polygons_of, union_over
from tccm_ros.surfaces.views.views import View

JoinAreaFunction = Callable[[MergedSurface, MergedSurface], Polygon | None]
"""Returns the area between two pieces of one surface, in x and y of map; None if they are not."""

SpanFunction = Callable[[MergedSurface], tuple[tuple[int, int], tuple[int, int]]]
"""Returns the keys (session and stamp) of the first and the last view that showed a piece at its
place."""

CoplanarityTest = Callable[[MergedSurface, MergedSurface, Float64], bool]
"""Returns whether two pieces agree in height at a position, float64 (2,), in map."""


def join(pieces: Sequence[MergedSurface], between: JoinAreaFunction) -> list[MergedSurface]:
    """Join pieces that are one surface, directly or through other pieces.

    Parameters
    ----------
    pieces
        Surfaces, in the order of their first patches.
    between
        Decides for each pair, in order.

    Returns
    -------
    The surfaces, in the order of their first pieces.
    """
    root = np.arange(len(pieces))
    areas: dict[int, list[Polygon]] = {}
    for i, j in combinations(range(len(pieces)), 2):
        area = between(pieces[i], pieces[j])
        if area is not None:
            first, second = sorted((int(root[i]), int(root[j])))
            root[root == second] = first
            found = [*areas.pop(second, []), area]
            areas.setdefault(first, []).extend(found)
    groups = {r: [p for p, k in zip(pieces, root) if k == r] for r in np.unique(root).tolist()}
    return [_joined(group, areas.get(r, [])) for r, group in groups.items()]


def join_over_occlusions(
    pieces: Sequence[MergedSurface],
    views: list[View],
    T_map_view: Float64,
    cov_z_roll_pitch: Float64,
    walls: Float64,
    seen_span: SpanFunction,
    config: Config,
) -> list[MergedSurface]:
    """Join coplanar pieces if no view looked through the area between them.

    Views older than the newer piece are ignored. A piece that was not seen since the newer one
    appeared may be gone and is not joined.

    Parameters
    ----------
    pieces
        Surfaces, in the order of their first patches.
    views
        V views.
    T_map_view, cov_z_roll_pitch
        float64 (V, 4, 4), poses, and (V, 3, 3), covariances of (z, roll, pitch), of the views.
    walls
        float64 (W, 2, 2), ends of the walls in map, m: pieces on two sides of a wall are not
        joined.
    seen_span
        Returns the first and the last view of a piece at its place.
    config
        Uses `surfaces.max_step`, `surfaces.merge_distance` and `views.clear_margin`.
    """
    is_coplanar = _coplanar(T_map_view, cov_z_roll_pitch, config)
    keys = [view.key for view in views]

    @cache
    def seen(piece: MergedSurface) -> tuple[int, int]:
        """Return the indices of the first view since a piece appeared, and of the last with it."""
        placed, last = (bisect_left(keys, key) for key in seen_span(piece))
        before = views[:placed], T_map_view[:placed]
        return last_empty_view(piece.polygon, piece.height, *before, config) + 1, last

    def between(a: MergedSurface, b: MergedSurface) -> Polygon | None:
        if not are_beside(a, b, is_coplanar, config):
            return None
        came, last = max(seen(a)[0], seen(b)[0]), min(seen(a)[1], seen(b)[1])
        if last < came:
            return None
        area = occluded_area_between(a, b, views[came:], T_map_view[came:], config)
        if area is None or _is_wall_between(a, b, walls, config.surfaces.merge_distance):
            return None
        return area

    return join(pieces, between)


def _is_wall_between(
    a: MergedSurface, b: MergedSurface, walls: Float64, min_distance: float
) -> bool:
    """Return whether a wall separates two pieces.

    The shortest line between them crosses it, and their centroids are on its two sides, at least
    `min_distance` m from it.
    """
    way = shapely.shortest_line(a.polygon, b.polygon)
    crossed = walls[shapely.intersects(shapely.linestrings(walls), way)]
    along = crossed[:, 1] - crossed[:, 0]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    normals /= np.maximum(np.linalg.norm(along, axis=1), GRID)[:, None]
    side = [((s.mean[:2] - crossed[:, 0]) * normals).sum(axis=1) for s in (a, b)]
    distance = np.minimum(-np.minimum(*side), np.maximum(*side))
    return bool((distance >= min_distance).any())


def _coplanar(T_map_view: Float64, cov_z_roll_pitch: Float64, config: Config) -> CoplanarityTest:
    """Return a test whether the planes of two pieces agree in height."""

    @cache
    def errors_of(piece: MergedSurface) -> SurfaceErrors:
        return surface_errors(piece.members, piece.mean, T_map_view, cov_z_roll_pitch)

    def is_coplanar(a: MergedSurface, b: MergedSurface, at_xy: Float64) -> bool:
        variance = step_variance(errors_of(a), errors_of(b), at_xy, cov_z_roll_pitch)
        step = a.height_at(at_xy) - b.height_at(at_xy)
        return agree_in_height(step, variance, config.surfaces.max_step)

    return is_coplanar


def are_beside(
    a: MergedSurface, b: MergedSurface, is_coplanar: CoplanarityTest, config: Config
) -> bool:
    """Return whether two pieces are near each other and agree in height where they are nearest.

    Parameters
    ----------
    a, b
        Two pieces.
    is_coplanar
        Tests whether they agree in height.
    config
        Uses `surfaces.merge_distance`, for pieces that are lines.
    """
    has_line = a.is_line or b.is_line
    max_distance = config.surfaces.merge_distance if has_line else HIDDEN_WIDTH
    if not shapely.dwithin(a.polygon, b.polygon, max_distance):
        return False
    nearest = shapely.shortest_line(a.polygon, b.polygon).centroid
    return is_coplanar(a, b, np.array(nearest.coords[0]))


def occluded_area_between(
    a: MergedSurface,
    b: MergedSurface,
    views: list[View],
    T_map_view: Float64,
    config: Config,
    depth: float = 0.0,
) -> Polygon | None:
    """Return the largest occluded area between two pieces; None: there is none.

    Parameters
    ----------
    a, b
        Two pieces that are beside each other.
    views, T_map_view
        Views, and their poses, float64 (V, 4, 4).
    config
        Uses `views.clear_margin`.
    depth
        Depth below the pieces at which free space is tested, m.
    """
    union = shapely.union_all([a.polygon, b.polygon], grid_size=GRID)
    between = polygons_of(close_gaps(union, 0.5 * HIDDEN_WIDTH).difference(union))
    for part in sorted(between.geoms, key=lambda part: (-part.area, part.bounds)):
        if part.area < PROBE**2:
            break
        if not all(shapely.dwithin(part, piece.polygon, OVERLAP) for piece in (a, b)):
            continue  # a notch of one piece
        middle = np.array(part.centroid.coords[0])
        height = 0.5 * (a.height_at(middle) + b.height_at(middle)) - depth
        if is_occluded(part, height, views, T_map_view, config):
            return part
    return None


def _joined(pieces: Sequence[MergedSurface], areas: Sequence[Polygon]) -> MergedSurface:
    """Merge pieces and the areas between them into one surface."""
    if len(pieces) == 1:
        return pieces[0]
    members = sorted((m for piece in pieces for m in piece.members), key=lambda m: m.number)
    moments = pool_moments(
        np.array([float(piece.count) for piece in pieces]),
        np.stack([piece.mean for piece in pieces]),
        np.stack([piece.cov for piece in pieces]),
    )
    outline = union_over([piece.polygon for piece in pieces], areas)
    return MergedSurface.of_moments(tuple(members), outline, *moments)
