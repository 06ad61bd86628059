"""Localisation of a surface: fit of its mapped outline to points of the newest tilt cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from scipy.optimize import least_squares
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.approach.readings import TopCycle
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.geometry import transform2

HEIGHT_M = 0.03
"""Points further above or below the top do not belong to it, m: `surfaces.max_step`, as surfaces of
the map that differ by more in height are never merged."""

SEARCH_M = 0.9
"""Search distance around the surface's mapped pose, m. Chosen: a pushed table."""

YAWS = np.radians([0.0, -15.0, 15.0, -30.0, 30.0, -45.0, 45.0])
"""Initial yaws of a fit, rad: a fit of straight sides converges from half a step."""

CELL_M = 0.03
"""Edge of the squares in which points are thinned to one before clustering, m."""

JOIN_M = 0.12
"""Points nearer than this belong to one surface, m: twice the largest spacing of scan lines."""

BEARING_RAD = np.radians(1.5)
"""Width of the bearing bins in each of which the nearest point is selected, rad."""

MIN_POINTS = 40
"""Minimum number of thinned points of a surface: 0.04 m2. Chosen: an arm's width of edge, two scan
lines deep."""

FIT_M = 0.03
"""Maximum median distance of the edge points from a fitted outline, m: half the largest spacing of
scan lines."""

MAX_FREE = 0.1
"""Maximum fraction of the visible cells of an outline that beams passed through, more than `FIT_M`
inside it."""

LOOSE = 0.02
"""Weight of the initial pose as prior in a fit, per m and rad: it is decisive only along an edge
whose ends are not visible."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What tilt cycles show at the height of a surface, in cells of `CELL_M`.

    Attributes
    ----------
    points
        float64 (N, 2), of its largest cluster.
    edge
        float64 (M, 2), those nearest to the sensor.
    free
        float64 (K, 2), places that beams to lower points passed through.
    """

    points: Float64
    edge: Float64
    free: Float64

    def is_fit(self, target: Target) -> bool:
        """Return whether an outline has the edge, all points, and no free place inside."""
        polygon = target.polygon
        to_edge = shapely.distance(polygon.boundary, shapely.points(self.edge))
        outside = shapely.distance(polygon, shapely.points(self.points))
        is_on = np.median(to_edge) < FIT_M and np.quantile(outside, 0.95) < FIT_M
        return bool(is_on) and not self.is_passed(target)

    def is_passed(self, target: Target) -> bool:
        """Return whether beams passed through the visible part of an outline."""
        inside = target.polygon.buffer(-FIT_M)
        hits, free = (shapely.contains_xy(inside, *p.T).sum() for p in (self.points, self.free))
        return bool(free > MAX_FREE * (hits + free))


def top_points(points: Float64, target: Target, others: list[Float64]) -> Float64:
    """Return the points (M, 2) that may belong to a surface, within `SEARCH_M` of its outline.

    Parameters
    ----------
    points
        float64 (N, 3), of horizontal surfaces, z over the floor, m.
    target
        Expected surface.
    others
        Outlines (K, 2 or 3) of other surfaces of its height, whose points are removed.
    """
    is_near = np.abs(points[:, 2] - target.height) <= HEIGHT_M
    middle = 0.5 * (target.outline.max(axis=0) + target.outline.min(axis=0))
    size = float(np.hypot(*(target.outline - middle).T).max())
    is_near &= np.hypot(*(points[:, :2] - middle).T) <= size + SEARCH_M
    near = points[is_near, :2]
    for other in others:
        polygon = shapely.make_valid(shapely.Polygon(other[:, :2])).buffer(CELL_M)
        near = near[~shapely.contains_xy(polygon, *near.T)]
    return near


def is_elsewhere(cycle: TopCycle, target: Target, others: list[Float64]) -> bool:
    """Return whether a cycle shows a surface, but not at its expected pose; fast.

    Parameters
    ----------
    cycle
        The newest tilt cycle.
    target, others
        As in `top_points`.
    """
    seen = _seen([cycle], target, others)
    return seen is not None and not seen.is_fit(target)


def is_passed(cycles: Sequence[TopCycle], target: Target, others: list[Float64]) -> bool:
    """Return whether cycles show a smaller surface: beams passed through a part of the outline.

    Parameters
    ----------
    cycles, target, others
        As in `locate`.
    """
    seen = _seen(cycles, target, others)
    return seen is not None and seen.is_passed(target)


def locate(cycles: Sequence[TopCycle], target: Target, others: list[Float64]) -> Target | None:
    """Return the located surface; None if its points are too few or no rigid motion fits.

    Of several poses that fit, it is the nearest to the expected one.

    Parameters
    ----------
    cycles
        The newest tilt cycles, the newest last.
    target, others
        As in `top_points`.
    """
    seen = _seen(cycles, target, others)
    if seen is None:
        return None
    starts = [np.zeros(3)]
    if not seen.is_fit(target):
        yaws = YAWS[: 1 if target.is_round else None]
        starts += [_start(yaw, seen.points, target) for yaw in yaws]
    motions = [_fit(start, seen.edge, seen.points, target) for start in starts]
    motions = [m for m in motions if seen.is_fit(target.moved(m))]
    if not motions:
        return None
    # Where only a part is visible, several poses fit.
    return target.moved(min(motions, key=lambda m: _displacement(target, m)))


def _seen(cycles: Sequence[TopCycle], target: Target, others: list[Float64]) -> _Seen | None:
    """Return the points of tilt cycles at the height of a surface; None if there are too few."""
    tops = top_points(np.concatenate([c.points for c in cycles]), target, others)
    points = _largest(_thinned(tops))
    if len(points) < MIN_POINTS:
        return None
    free = _thinned(np.concatenate([_free_places(c, target) for c in cycles]))
    return _Seen(points, _facing(points, cycles[-1].sensor[:2]), free)


def _free_places(cycle: TopCycle, target: Target) -> Float64:
    """Return where beams to points below a surface passed through its height, (N, 2)."""
    height, sensor = target.height, cycle.sensor
    below = cycle.points[cycle.points[:, 2] < height - HEIGHT_M]
    if sensor[2] <= height:
        return below[:0, :2]
    fractions = (sensor[2] - height) / (sensor[2] - below[:, 2:])
    return np.asarray(sensor[:2] + fractions * (below[:, :2] - sensor[:2]))


def _thinned(points: Float64) -> Float64:
    x, y = np.floor(points / CELL_M).astype(np.int64).T
    _, first = np.unique((x << 32) + y, return_index=True)
    return points[np.sort(first)]


def _largest(points: Float64) -> Float64:
    """Return the largest cluster: points linked by distances up to `JOIN_M`."""
    if len(points) < 2:
        return points
    pairs = cKDTree(points).query_pairs(JOIN_M, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(len(points),) * 2)
    _, labels = connected_components(graph, directed=False)
    return points[labels == np.bincount(labels).argmax()]


def _facing(points: Float64, sensor: Float64) -> Float64:
    """Return the nearest point to the sensor in each bearing bin."""
    rays = points - sensor
    bearings = np.floor(np.arctan2(rays[:, 1], rays[:, 0]) / BEARING_RAD).astype(np.int64)
    order = np.lexsort((np.hypot(*rays.T), bearings))
    first = order[np.r_[True, np.diff(bearings[order]) != 0]]
    return points[first]


def _start(yaw: float, points: Float64, target: Target) -> Float64:
    """Return the motion that rotates a target by a yaw and moves its centroid to the points'."""
    middle = np.asarray(target.polygon.centroid.coords)[0]
    rotated = transform2(np.array([0.0, 0.0, yaw]), middle[None])[0]
    return np.array([*(points.mean(axis=0) - rotated), yaw])


def _displacement(target: Target, motion: Float64) -> float:
    """Return the mean displacement of a target's corners by a motion (3,), m."""
    return float(np.hypot(*(target.moved(motion).outline - target.outline).T).mean())


def _fit(start: Float64, edge: Float64, points: Float64, target: Target) -> Float64:
    """Return the motion (3,) of the fit: edge points on the outline, no point outside it."""
    polygon = target.polygon
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_parts(polygon.boundary)]
    sides = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    middle = np.asarray(polygon.centroid.coords)[0]
    seen = np.concatenate([edge, points]) - middle
    # Rotation about the centroid, so that rotation and translation are independent.
    x0 = np.array([*(transform2(start, middle[None])[0] - middle), start[2]])

    @lru_cache(maxsize=1)  # the Jacobian is computed where the residuals just were
    def offsets(x: float, y: float, yaw: float) -> Float64:
        """Return the vectors (N, 2) from the outline; 0 for points inside it, but the edge's."""
        c, s = np.cos(yaw), np.sin(yaw)
        back = (seen - [x, y]) @ np.array([[c, -s], [s, c]]) + middle
        found = back - _nearest(sides, back)
        found[len(edge) :][shapely.contains_xy(polygon, *back[len(edge) :].T)] = 0.0
        return np.asarray(found)

    def residuals(x: Float64) -> Float64:
        return np.concatenate([np.hypot(*offsets(*x.tolist()).T), LOOSE * x])

    def jacobian(x: Float64) -> Float64:
        vectors = offsets(*x.tolist())
        c, s = np.cos(x[2]), np.sin(x[2])
        units = vectors / np.maximum(np.hypot(*vectors.T), 1e-12)[:, None]
        by_yaw = (seen - x[:2]) @ np.array([[-s, -c], [c, -s]])
        by_shift = -units @ np.array([[c, s], [-s, c]])
        rows = np.column_stack([by_shift, np.einsum("ij,ij->i", units, by_yaw)])
        return np.concatenate([rows, LOOSE * np.eye(3)])

    yaw_scale = 1e-6 if target.is_round else 1.0
    found = least_squares(
        residuals, x0, jacobian, loss="soft_l1", f_scale=0.02, x_scale=[1.0, 1.0, yaw_scale],
        max_nfev=40,
    )  # fmt: skip
    shift, yaw = found.x[:2], float(found.x[2])
    c, s = np.cos(yaw), np.sin(yaw)
    t = middle + shift - np.array([c * middle[0] - s * middle[1], s * middle[0] + c * middle[1]])
    return np.array([*t, yaw])


def _nearest(sides: Float64, points: Float64) -> Float64:
    """Return the nearest point (N, 2) to each of some points on segments (S, 2, 2)."""
    starts, along = sides[:, 0], sides[:, 1] - sides[:, 0]
    squares = np.maximum(np.einsum("si,si->s", along, along), 1e-24)
    fractions = np.einsum("nsi,si->ns", points[:, None] - starts, along) / squares
    feet = starts + np.clip(fractions, 0.0, 1.0)[..., None] * along
    x, y = np.moveaxis(points[:, None] - feet, 2, 0)
    nearest = (x * x + y * y).argmin(axis=1)
    return np.asarray(feet[np.arange(len(points)), nearest])
