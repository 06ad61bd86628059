"""Shapes of surfaces: the simplest outline that the views support, and the state of its edges.

The model is selected for the outline of the area that the views cover (`outlines.shape_models`).
The position of each edge is then estimated from the last points of all views and the walls
(`outlines.edge_position`; circles and ellipses: `round_edges`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.outlines.edge_position import EDGE_SIGMA, WALL_DISTANCE, EdgeSamples, locate_edge
from tccm_ros.outlines.shape_models import (
    CAP_CORNERS,
    FACING,
    SPACING,
    Model,
    OutlineSamples,
    RoundModel,
    StraightModel,
    choose_model,
)
from tccm_ros.records import EdgeState, SurfaceShape
from tccm_ros.robust import MAJORITY
from tccm_ros.surfaces.edges.edge_samples import OUTSIDE, Edge, EdgePoints, EdgeSampler
from tccm_ros.surfaces.edges.edge_walls import (
    AT_WALL,
    front_beyond,
    wall_across,
    walls_near,
    yaw_of,
)
from tccm_ros.surfaces.edges.round_edges import edge_jacobian, refine_round
from tccm_ros.surfaces.merging.merged_surface import MergedSurface
from tccm_ros.surfaces.polygons import polygon_rings
from tccm_ros.surfaces.views.views import View

MIN_PART = 0.25
"""Minimum length, m, by which a front must extend past an occluded edge with collinear last points
before the edge is moved there; chosen: arms of sofas and side panels have the same front as the
surface, and are narrower than objects that occlude an edge."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapedEdge:
    """An edge of a shape.

    Attributes
    ----------
    edge
        The edge in x and y of map.
    state
        Whether it was seen, occluded, or cut by the end of the views.
    sigma
        Standard deviation across the edge, m; NaN if it was not seen.
    hidden_by
        The surface that occludes it; None if it is not occluded, or not by a surface.
    """

    edge: Edge
    state: EdgeState
    sigma: float
    hidden_by: MergedSurface | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The outline of a surface by a model.

    Attributes
    ----------
    name
        Name of the model.
    polygon
        Outline in x and y of map, with the holes that were seen.
    edges
        Edges of its exterior, counter-clockwise, from its corner with the smallest (x, y).
    """

    name: SurfaceShape
    polygon: Polygon
    edges: tuple[ShapedEdge, ...]


def fit_shape(
    surface: MergedSurface,
    others: Sequence[MergedSurface],
    views: Sequence[View],
    T_map_view: Float64,
    walls: Float64,
    config: Config,
) -> Shape:
    """Return the shape of a surface.

    Parameters
    ----------
    surface
        Surface with the outline of the area that the views cover.
    others
        Surfaces that may occlude its edges.
    views, T_map_view
        All views, and their poses, float64 (V, 4, 4).
    walls
        float64 (W, 2, 2), ends of the walls in map, m.
    config
        Uses the systematic errors of ``sensors``.
    """
    sampler = EdgeSampler(surface, views, T_map_view, config)
    samples = sampler.outline_samples()
    exterior = Polygon(surface.polygon.exterior)
    walls = walls[shapely.dwithin(shapely.linestrings(walls), exterior, exterior.length)]
    near = walls_near(exterior, walls)
    wall_yaws = np.array([yaw_of(end - start) for start, end in near])
    model = choose_model(samples, exterior, _yaws(exterior), wall_yaws)
    if model is None:
        return _free(sampler, samples, others)
    sigmas = np.full(0, np.nan)
    if isinstance(model, StraightModel):
        model, sigmas = _refined(model, sampler, near)
        model = _to_ends_of_fronts(model, sampler, samples, walls)
    else:
        model, sigmas = _refined_round(model, sampler)
    polygon = model.polygon()
    if polygon is None:
        return _free(sampler, samples, others)
    edges = _edges(model, polygon, sigmas, sampler, samples, near, others)
    if all(shaped.state is not EdgeState.SEEN for shaped in edges):
        return _free(sampler, samples, others)  # no view saw where it ends
    holes = [ring for ring in surface.polygon.interiors if polygon.contains(Polygon(ring))]
    return Shape(model.shape, Polygon(polygon.exterior, holes), edges)


def free_shape(surface: MergedSurface) -> Shape:
    """Return the free outline of a surface without edges, as for the floor."""
    return Shape(SurfaceShape.FREE, surface.polygon, ())


def _free(sampler: EdgeSampler, samples: OutlineSamples, others: Sequence[MergedSurface]) -> Shape:
    """Return the free outline of a surface with the states of its edges."""
    surface = sampler.surface
    boundary, _ = polygon_rings(surface.polygon)
    sigma = float(np.median(samples.sigma))
    edges = [
        _known(edge, _state(edge, sampler, samples), sigma, sampler, others)
        for edge in _edges_of(boundary)
    ]
    return Shape(SurfaceShape.FREE, surface.polygon, tuple(edges))


def _edges_of(corners: Float64) -> list[Edge]:
    return [Edge(a, b) for a, b in zip(corners, np.roll(corners, -1, axis=0))]


def _yaws(outline: Polygon) -> Float64:
    """Return the directions that edges of an outline may have, rad, float64 (3,)."""
    box = np.asarray(shapely.oriented_envelope(outline).exterior.coords)
    ring = np.asarray(outline.exterior.simplify(0.03).coords)
    steps = np.diff(ring, axis=0)
    rotation = 4.0 * np.arctan2(steps[:, 1], steps[:, 0])
    weight = np.hypot(steps[:, 0], steps[:, 1]) ** 2
    main = 0.25 * np.arctan2(weight @ np.sin(rotation), weight @ np.cos(rotation))
    longest = steps[np.argmax(weight)]
    return np.array([yaw_of(box[1] - box[0]), main, yaw_of(longest)])


def _refined(
    model: StraightModel, sampler: EdgeSampler, walls: Float64
) -> tuple[StraightModel, Float64]:
    """Refine the edges of a model by last points; return the model and the edges' sigmas, m."""
    corners, offsets = model.corners(), model.offsets.copy()
    sigmas = np.full(len(corners), np.nan)
    for k, edge in enumerate(_edges_of(corners) if np.isfinite(corners).all() else ()):
        wall = wall_across(edge, walls)
        points = sampler.points_before(edge)
        found = downweight_wall_points(points.samples, wall)
        if not len(found.at):
            continue
        if wall is not None and _reaches_wall(points, found, wall):
            offsets[k] += wall
            continue
        shift, sigmas[k] = locate_edge(found, wall)
        offsets[k] += shift
    return replace(model, offsets=offsets), sigmas


def _refined_round(model: RoundModel, sampler: EdgeSampler) -> tuple[RoundModel, Float64]:
    """Refine a round model by last points; return it and the sigmas of its polygon's edges, m."""
    model, cov = refine_round(model, sampler)
    step = 2.0 * np.pi / CAP_CORNERS
    J, _ = edge_jacobian(model, np.linspace(0.5 * step, 2.0 * np.pi - 0.5 * step, CAP_CORNERS))
    return model, np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", J, cov, J)), np.float64)


def _to_ends_of_fronts(
    model: StraightModel, sampler: EdgeSampler, samples: OutlineSamples, walls: Float64
) -> StraightModel:
    """Return the model with occluded edges moved to the ends of the fronts beside them.

    A top extends as far as the front below its near edge, which the level laser sees, but by no
    more than the length of that edge.
    """
    corners = model.corners()
    if not model.has_axes or not np.isfinite(corners).all():
        return model
    edges, offsets = _edges_of(corners), model.offsets.copy()
    for k, edge in enumerate(edges):
        for front in (edges[k - 1], edges[(k + 1) % len(edges)]):
            beyond = front_beyond(front, edge.outward, walls)
            if not AT_WALL < beyond <= front.length or not sampler.faces_views(front):
                continue
            if beyond <= MIN_PART and not sampler.points_before(edge).is_ragged():
                continue
            step = beyond * edge.outward
            strip = Polygon([edge.start, edge.start + step, edge.end + step, edge.end])
            is_seen = _state(edge, sampler, samples) is EdgeState.SEEN
            if not is_seen and sampler.may_go_on(strip):
                offsets[k] = model.offsets[k] + beyond
    return replace(model, offsets=offsets)


def _reaches_wall(points: EdgePoints, samples: EdgeSamples, wall: float) -> bool:
    """Return whether an occluded edge ends near enough to a wall to be assumed at the wall.

    Furniture stands at walls, and objects on it occlude its last part in all views. Points on the
    wall are ignored, as the wall also has points at the height of a board that ends before it. If
    the surface has points beyond a wall, the wall is the front of lower furniture.
    """
    if samples.weight[samples.ends].sum() >= 0.5 * samples.weight.sum():
        return False
    if points.furthest() > wall + AT_WALL:
        return False
    limit = wall - AT_WALL
    is_near = wall - points.furthest(limit) <= WALL_DISTANCE
    return is_near and points.is_ragged(limit)


def downweight_wall_points(samples: EdgeSamples, wall: float | None) -> EdgeSamples:
    """Return samples without weight of last points on a wall past which no view looked.

    A wall has points at the height of a board whether the board extends to it or not.

    Parameters
    ----------
    samples
        The last points before an edge.
    wall
        Distance of the wall across the edge, m; None: no wall.
    """
    if wall is None:
        return samples
    is_on_wall = (np.abs(samples.last - wall) <= AT_WALL) & ~samples.ends
    return samples._replace(weight=samples.weight * ~is_on_wall)


def _edges(
    model: Model,
    polygon: Polygon,
    sigmas: Float64,
    sampler: EdgeSampler,
    samples: OutlineSamples,
    walls: Float64,
    others: Sequence[MergedSurface],
) -> tuple[ShapedEdge, ...]:
    """Return the edges of a model with their states, sigmas and occluding surfaces."""
    corners = np.asarray(polygon.exterior.coords)[:-1]
    edges = []
    for k, edge in enumerate(_edges_of(corners)):
        across = wall_across(edge, walls)
        state, points = _state(edge, sampler, samples), sampler.points_before(edge)
        parts = sigmas[k], sampler.shared_sigma(edge), points.ragged_sigma(), EDGE_SIGMA
        sigma = float(np.linalg.norm(parts))
        is_straight = isinstance(model, StraightModel)
        if is_straight and state is EdgeState.SEEN and points.seen_fraction() < MAJORITY:
            state = EdgeState.HIDDEN
        if across is not None and abs(across) <= AT_WALL and np.isfinite(sigma):
            is_reached = points.reached_fraction(AT_WALL) >= MAJORITY
            state = EdgeState.SEEN if is_reached else state
        edges.append(_known(edge, state, sigma, sampler, others))
    first = int(np.lexsort((corners[:, 1], corners[:, 0]))[0])
    return tuple(edges[first:] + edges[:first])


def _known(
    edge: Edge,
    state: EdgeState,
    sigma: float,
    sampler: EdgeSampler,
    others: Sequence[MergedSurface],
) -> ShapedEdge:
    """Return an edge with its sigma if it was seen, or with the lowest surface that occludes it."""
    if state is EdgeState.SEEN:
        return ShapedEdge(edge, state, sigma)
    hiding = [other for other in others if state is EdgeState.HIDDEN and sampler.hides(edge, other)]
    lowest = min(hiding, key=lambda other: other.height, default=None)
    return ShapedEdge(edge, state, float("nan"), lowest)


def _state(edge: Edge, sampler: EdgeSampler, samples: OutlineSamples) -> EdgeState:
    """Return the state of an edge, from the samples of the outline near it."""
    offset = samples.points - edge.start
    at, across = offset @ edge.along, offset @ edge.outward
    near = (at >= -SPACING) & (at <= edge.length + SPACING) & (np.abs(across) <= OUTSIDE)
    near &= samples.outward @ edge.outward > FACING
    if near.any() and samples.seen[near].mean() >= MAJORITY:
        return EdgeState.SEEN
    return EdgeState.HIDDEN if sampler.looks_over(edge) else EdgeState.CUT
