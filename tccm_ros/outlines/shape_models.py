"""Models of outlines: rectangle, L, circle, ellipse, straight-sided polygon.

A model is selected by the Bayesian information criterion (Schwarz, Estimating the dimension of a
model, Annals of Statistics 6, 1978): its squared errors, normalised by the uncertainty of the
sampled outline, plus ln(n) for each of its parameters. So an outline gets another corner only if
the gain in likelihood exceeds its cost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Bool, Float64
from tccm_ros.records import SurfaceShape
from tccm_ros.robust import GATE, MAJORITY

SPACING = 0.03
"""Distance of the samples of an outline, and length of the pieces of an edge, each with one last
point, m; chosen. Points this near to an end of an edge may belong to the next one."""

CORRELATION = 0.10
"""Correlation length of the errors of an outline's samples, m, and minimum distance of the inner
corner of an L from its outer edges; chosen: that of one beam or scan line."""

PROBE = 0.04
"""Distance of the points at which an area is tested for free space, m; chosen: less than half a
column. With 0.03, a platform 4.5 cm over the floor is joined with it over a gap of 2 cm
(`test/surfaces/merging/test_joining.py`)."""

MAX_ERROR = 5.0
"""Maximum error of a sample, standard deviations; larger ones are clipped. With 3,
bags/rgbd_kitchen has a mean overlap of .937 in place of .945."""

HIDDEN_WIDTH = 0.5
"""Maximum width of a part of a surface that no view saw: beyond an outline, in a notch or a hole,
or between two pieces, m; chosen: an appliance on a worktop and its shadow."""

ODDS = {
    SurfaceShape.RECTANGLE: 0.9,
    SurfaceShape.L: 0.03,
    SurfaceShape.CIRCLE: 0.03,
    SurfaceShape.ELLIPSE: 0.01,
    SurfaceShape.POLYGON: 0.03,
}
"""Prior probability of each shape among tops of furniture; chosen."""

FACING = 0.75
"""Minimum cosine between the outward directions of an edge and its samples; chosen: 41 deg, so that
each sample belongs to one of four edges."""

MAX_CORNERS = 14
"""Maximum number of corners of a polygon; an outline with more is free. Without it the overlap of
hololens is .889 in place of .898."""

CAP_CORNERS = 48
"""Number of corners of the polygon of a circle or an ellipse; chosen: within 0.2 % of its
radius."""


class OutlineSamples(NamedTuple):
    """Samples of an outline at a distance of `SPACING`.

    Attributes
    ----------
    points
        float64 (N, 2), m.
    outward
        float64 (N, 2), unit vectors.
    sigma
        float64 (N,), standard deviation across the outline, m.
    sampling
        float64 (N,), possible extent of the surface beyond its last samples, one sigma, m.
    seen
        bool (N,), whether a view saw the surface end there.
    through
        float64 (M, 2), centres of squares of `PROBE` outside of the outline that are free space, m.
    """

    points: Float64
    outward: Float64
    sigma: Float64
    sampling: Float64
    seen: Bool
    through: Float64


@dataclass(frozen=True, slots=True, eq=False)
class StraightModel:
    """An outline of straight edges ``normal . p = offset``, each from the previous to the next.

    Attributes
    ----------
    shape
        Name of the shape.
    normals
        float64 (E, 2), unit, outwards, in counter-clockwise order.
    offsets
        float64 (E,), m.
    has_axes
        Whether all edges are parallel to two axes at a right angle.
    along_wall
        Whether one of these axes is parallel to a wall, so that it is no parameter.
    """

    shape: SurfaceShape
    normals: Float64
    offsets: Float64
    has_axes: bool
    along_wall: bool = False

    @property
    def parameters(self) -> int:
        """Number of parameters: an offset for each edge, and the directions that are unknown."""
        directions = 1 if self.has_axes else len(self.offsets)
        return len(self.offsets) + (0 if self.along_wall else directions)

    def corners(self) -> Float64:
        """Return the corners (E, 2), corner k at the start of edge k; NaN if edges are parallel."""
        a, b = np.roll(self.normals, 1, axis=0), self.normals
        c, d = np.roll(self.offsets, 1), self.offsets
        det = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        det = np.where(np.abs(det) < 0.05, np.nan, det)
        x = (c * b[:, 1] - d * a[:, 1]) / det
        y = (a[:, 0] * d - b[:, 0] * c) / det
        return np.stack([x, y], axis=1)

    def polygon(self) -> Polygon | None:
        """Return the outline; None if the edges do not enclose an area."""
        corners = self.corners()
        if not np.isfinite(corners).all():
            return None
        polygon = Polygon(corners)
        return polygon if polygon.is_valid and polygon.exterior.is_ccw else None


@dataclass(frozen=True, slots=True, eq=False)
class RoundModel:
    """A circle or an ellipse.

    Attributes
    ----------
    shape
        Name of the shape.
    center
        float64 (2,), m.
    axes
        float64 (2, 2), rows: unit vectors of the half axes.
    radii
        float64 (2,), lengths of the half axes, m.
    """

    shape: SurfaceShape
    center: Float64
    axes: Float64
    radii: Float64

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return 3 if self.shape is SurfaceShape.CIRCLE else 5

    def polygon(self) -> Polygon | None:
        """Return a polygon of the same area, counter-clockwise."""
        angle = np.linspace(0.0, 2.0 * np.pi, CAP_CORNERS, endpoint=False)
        scale = np.sqrt(2.0 * np.pi / CAP_CORNERS / np.sin(2.0 * np.pi / CAP_CORNERS))
        circle = scale * self.radii * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return shapely.geometry.polygon.orient(Polygon(self.center + circle @ self.axes), 1.0)


Model = StraightModel | RoundModel


def choose_model(
    samples: OutlineSamples, outline: Polygon, yaws: Float64, wall_yaws: Float64
) -> Model | None:
    """Return the model with the smallest criterion; None: the free outline.

    Parameters
    ----------
    samples
        Samples of the outline.
    outline
        Area that the views cover, without its holes.
    yaws
        float64 (Y,), candidate directions of edges, rad.
    wall_yaws
        float64 (W,), directions of walls near the outline, rad: further candidates, which need no
        estimation.
    """
    n = max(outline.exterior.length / CORRELATION, 2.0)
    free = len(outline.exterior.coords) - 1
    best, lowest = None, 2.0 * free * np.log(n)
    for model in _models(samples, outline, yaws, wall_yaws):
        polygon = model.polygon()
        if polygon is None:
            continue
        cost = model.parameters * np.log(n) - 2.0 * np.log(ODDS[model.shape])
        criterion = _squared_errors(samples, polygon) + cost
        if criterion < lowest:
            best, lowest = model, criterion
    return best


def _models(
    samples: OutlineSamples, outline: Polygon, yaws: Float64, wall_yaws: Float64
) -> Iterator[Model]:
    sigma = float(np.median(samples.sigma))
    whole = _from_far_corner(outline)
    simple = [whole.simplify(factor * sigma) for factor in (1.0, 2.0, 3.0)]
    for yaw in (*wall_yaws.tolist(), *yaws.tolist()):
        found = [_with_axes(samples, yaw), *(_with_arms(samples, p, yaw) for p in simple)]
        for model in chain.from_iterable(found):
            yield replace(model, along_wall=yaw in wall_yaws)
    if samples.seen.mean() >= MAJORITY:  # unseen parts of a round outline are no prior knowledge
        yield from _round_models(outline)
    for polygon in simple:
        if len(polygon.exterior.coords) - 1 <= MAX_CORNERS:
            yield _straight(polygon, samples)


def _squared_errors(samples: OutlineSamples, model: Polygon) -> float:
    """Return the sum of squared errors of independent samples, in standard deviations."""
    points = shapely.points(samples.points)
    distance = shapely.distance(points, model.exterior)
    is_inside = shapely.contains_xy(model, samples.points[:, 0], samples.points[:, 1])
    beyond = np.where(samples.seen, samples.sampling, HIDDEN_WIDTH) * is_inside
    errors = np.minimum(distance / np.hypot(samples.sigma, beyond), MAX_ERROR)
    covered = shapely.contains_xy(model, samples.through[:, 0], samples.through[:, 1]).sum()
    return float(
        np.sum(errors**2) * SPACING / CORRELATION + GATE**2 * covered * (PROBE / CORRELATION) ** 2
    )


def _with_axes(samples: OutlineSamples, yaw: float) -> Iterator[StraightModel]:
    """Yield the rectangles and the four Ls with axes at a yaw, rad.

    An object may occlude more of an edge at one place than at another, and oblique scan lines may
    end at no sample that faces as the edge does. So there are two rectangles: an edge that was not
    seen is where most of its samples end, or at the last sample of all.
    """
    angle = yaw + 0.5 * np.pi * np.arange(4)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across, of_edge = samples.points @ normals.T, samples.outward @ normals.T > FACING
    last = across.max(axis=0)
    outer, inner, upper = last.copy(), np.zeros(4), np.zeros(4)
    for k in np.flatnonzero(of_edge.any(axis=0)).tolist():
        own, seen = across[of_edge[:, k], k], samples.seen[of_edge[:, k]]
        outer[k] = _level(own, seen)
        inner[k], upper[k] = _two_levels(own)
        last[k] = outer[k] if seen.mean() >= MAJORITY else last[k]
    yield StraightModel(SurfaceShape.RECTANGLE, normals, outer, True)
    yield StraightModel(SurfaceShape.RECTANGLE, normals, last, True)
    for k in range(4):
        # Around the L: outer a, inner b, inner a, outer b, and the two edges without a notch.
        a, b, c, d = (np.arange(4) + k) % 4
        if min(upper[a] - inner[a], upper[b] - inner[b]) >= CORRELATION:
            offsets = np.array([upper[a], inner[b], inner[a], upper[b], outer[c], outer[d]])
            yield StraightModel(SurfaceShape.L, normals[[a, b, a, b, c, d]], offsets, True)


def _with_arms(samples: OutlineSamples, polygon: Polygon, yaw: float) -> Iterator[StraightModel]:
    """Yield the right-angled outline with arms (U, T, Z) of a polygon, if it has this shape.

    Each edge gets the nearest of four directions, of which `yaw`, rad, is one. Successive edges of
    one direction, such as a cut corner and the next edge, are merged.
    """
    ring = np.asarray(shapely.geometry.polygon.orient(polygon, 1.0).exterior.coords)
    steps = np.diff(ring, axis=0)
    angle = np.arctan2(-steps[:, 0], steps[:, 1]) - yaw
    side = np.rint(angle / (0.5 * np.pi)).astype(np.int64) % 4
    begins = np.flatnonzero(side != np.roll(side, 1))
    sides = side[begins]
    is_corner = (sides - np.roll(sides, 1)) % 2 == 1
    if not 6 < len(begins) <= MAX_CORNERS or not is_corner.all():
        return
    run_of = np.cumsum(side != np.roll(side, 1)) - 1
    lines = shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1))
    nearest = run_of[shapely.STRtree(lines).nearest(shapely.points(samples.points))] % len(begins)
    normals = np.array([(np.cos(a), np.sin(a)) for a in (yaw + 0.5 * np.pi * sides).tolist()])
    offsets = np.empty(len(begins))
    for k, normal in enumerate(normals):
        own = (nearest == k) & (samples.outward @ normal > FACING)
        if not own.any():
            return
        offsets[k] = _level(samples.points[own] @ normal, samples.seen[own])
    yield StraightModel(SurfaceShape.POLYGON, normals, offsets, True)


def _level(across: Float64, seen: Bool) -> float:
    """Return the position of an edge: the median of its seen samples, or a high quantile of all."""
    if seen.mean() >= MAJORITY:
        return float(np.median(across[seen]))
    return float(np.quantile(across, 0.8))


def _two_levels(across: Float64) -> tuple[float, float]:
    """Return the medians of the lower and the upper samples, split by Otsu's criterion."""
    order = np.sort(across)
    count = np.arange(1, len(order))
    if not len(count):
        return float(order[0]), float(order[0])
    total = np.cumsum(order)
    low = total[:-1] / count
    high = (total[-1] - total[:-1]) / (len(order) - count)
    split = int(np.argmax(count * (len(order) - count) * (high - low) ** 2)) + 1
    return float(np.median(order[:split])), float(np.median(order[split:]))


def _from_far_corner(outline: Polygon) -> Polygon:
    """Return an outline that starts at the point furthest from its centre.

    Simplification keeps the first point, which should be a corner.
    """
    ring = np.asarray(outline.exterior.coords)[:-1]
    away = np.hypot(*(ring - ring.mean(axis=0)).T)
    return Polygon(np.roll(ring, -int(np.argmax(away)), axis=0))


def _straight(polygon: Polygon, samples: OutlineSamples) -> StraightModel:
    """Return the straight model of a polygon, with each edge fitted to the samples along it."""
    ring = shapely.geometry.polygon.orient(polygon, 1.0).exterior
    corners = np.asarray(ring.coords)[:-1]
    along = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(along[:, 0], along[:, 1])
    along /= length[:, None]
    normals = np.column_stack([along[:, 1], -along[:, 0]])
    offsets = (normals * corners).sum(axis=1)
    edges = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    nearest = shapely.STRtree(edges).nearest(shapely.points(samples.points))
    for k in range(len(corners)):
        own = samples.points[nearest == k]
        at = (own - corners[k]) @ along[k]
        own = own[(at > SPACING) & (at < length[k] - SPACING)]
        if len(own) < 3:
            continue
        mean = own.mean(axis=0)
        slope = _slope((own - mean) @ along[k], (own - mean) @ normals[k])
        normal = normals[k] - slope * along[k]
        normals[k] = normal / np.hypot(*normal)
        offsets[k] = normals[k] @ mean
    return StraightModel(SurfaceShape.POLYGON, normals, offsets, False)


def _slope(at: Float64, across: Float64) -> float:
    """Return the slope of the least-squares line through samples about their mean."""
    return float(at @ across) / max(float(at @ at), 1e-9)


def _round_models(outline: Polygon) -> Iterator[RoundModel]:
    """Yield the circle and the ellipse with the moments of an outline's area."""
    center, cov = area_moments(outline)
    variances, axes = np.linalg.eigh(cov)
    radii = 2.0 * np.sqrt(np.maximum(variances, 0.0))
    mean = float(np.sqrt(radii[0] * radii[1]))
    yield RoundModel(SurfaceShape.CIRCLE, center, np.eye(2), np.array([mean, mean]))
    yield RoundModel(SurfaceShape.ELLIPSE, center, axes.T, radii)


def area_moments(area: shapely.Geometry) -> tuple[Float64, Float64]:
    """Return mean (2,) and covariance (2, 2) of the points in one or more polygons, not empty."""
    center = np.array(area.centroid.coords[0])
    oriented = [shapely.geometry.polygon.orient(part) for part in shapely.get_parts(area)]
    moments = np.zeros((2, 2))
    for ring in [ring for part in oriented for ring in (part.exterior, *part.interiors)]:
        # Moments of the triangles of the centroid and each side, signed by orientation.
        p = np.asarray(ring.coords)[:, :2] - center
        cross = p[:-1, 0] * p[1:, 1] - p[:-1, 1] * p[1:, 0]
        for corner in (p[:-1], p[1:], p[:-1] + p[1:]):
            moments += np.einsum("k,ki,kj->ij", cross, corner, corner)
    return center, moments / (24.0 * area.area)
