"""Find the planar pose of one map in another from their common surfaces and walls.

The map frame of a recording is the first pose of its base. Each pair of surfaces with the same
heights and distance in both maps gives a candidate transform. The candidate with the most matching
surfaces and walls is chosen, and refined by least squares over the matches.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial, transform, transform2, wrap_angle
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import SurfaceEntry, WallEntry
from tccm_ros.results.trajectory import Trajectory

MAX_HEIGHT_DIFFERENCE_M = 0.05
"""Largest difference in height of one surface in two maps, m; chosen."""

MAX_AREA_RATIO = 2.5
"""Largest ratio of their areas; chosen: each map may have seen another part."""

MAX_SPAN_DIFFERENCE_M = 0.35
"""Largest difference of the distances between two surfaces in both maps, m; chosen."""

MIN_SPAN_M = 0.8
"""Smallest distance between two surfaces that give a yaw, m; chosen."""

MAX_SURFACE_DISTANCE_M = 0.30
"""Largest distance of matching surfaces' centroids after the transform, m; chosen."""

MAX_WALL_ANGLE_RAD = np.deg2rad(8.0)
"""Largest angle between matching walls, rad; chosen."""

MAX_WALL_DISTANCE_M = 0.20
"""Largest distance across matching walls after the transform, m; chosen."""

MAX_WALL_MIDDLE_DISTANCE_M = 2.0
"""Largest distance of matching walls' middles, m; chosen."""

WALL_SCORE = 0.5
"""Score of a matching wall, a surface's is 1; chosen: rooms have many parallel walls."""

MIN_SCORE = 3.0
"""Smallest score of a transform that is accepted; chosen: fewer matches occur by chance."""

MIN_SCORE_FRACTION = 0.5
"""The same as a fraction of the highest score that the smaller map can have; chosen."""

WALL_WEIGHT = 10.0
"""Weight of a wall in the least squares, a surface's is 1; chosen: walls are more accurate."""

REFINEMENTS = 4
"""Iterations of matching and least squares; chosen: the matches no longer change."""

NO_MATCH_COST = 1e3
"""Cost of pairs that do not match, above every limit, m."""


@dataclass(frozen=True, slots=True, eq=False)
class MapFeatures:
    """Surfaces and walls of a map as arrays for matching.

    Attributes
    ----------
    middles
        float64 (N, 3), centroids of the surfaces: x, y in map and the height over the floor, m.
    areas
        float64 (N,), of the surfaces, m2.
    directions
        float64 (M,), of the walls, rad.
    wall_middles
        float64 (M, 2), middles of the walls, m.
    """

    middles: Float64
    areas: Float64
    directions: Float64
    wall_middles: Float64


def find_alignment(before: Results, after: Results) -> Float64 | None:
    """Find the planar pose of the second map's frame in the first's.

    Parameters
    ----------
    before, after
        The first and the second map, each in its own frame.

    Returns
    -------
    float64 (3,) or None
        (x, y, yaw), m and rad; None if too few surfaces and walls match.
    """
    a, b = _features(before), _features(after)
    best, best_score = None, 0.0
    for guess in _proposals(a, b):
        score = _score(a, b, guess)
        if score > best_score + 1e-9:
            best, best_score = guess, score
    possible = min(len(f.middles) + WALL_SCORE * len(f.wall_middles) for f in (a, b))
    if best is None or best_score < max(MIN_SCORE, MIN_SCORE_FRACTION * possible):
        return None
    for _ in range(REFINEMENTS):
        best = _refine(a, b, best)
    return best


def _features(results: Results) -> MapFeatures:
    surfaces = sorted(results.above_floor, key=lambda s: s.id)
    middles = [[s.centroid[0], s.centroid[1], s.height - results.ground] for s in surfaces]
    ends = np.array([wall.endpoints for wall in results.walls]).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    return MapFeatures(
        np.array(middles).reshape(-1, 3),
        np.array([s.area for s in surfaces]),
        np.arctan2(along[:, 1], along[:, 0]),
        ends.mean(axis=1),
    )


def _proposals(a: MapFeatures, b: MapFeatures) -> Iterator[Float64]:
    """Yield transforms that move two surfaces of the second map onto two of the first."""
    same_height = np.abs(a.middles[:, None, 2] - b.middles[None, :, 2]) <= MAX_HEIGHT_DIFFERENCE_M
    ratio = np.maximum(a.areas[:, None], 1e-6) / np.maximum(b.areas[None], 1e-6)
    similar = np.argwhere(same_height & (ratio <= MAX_AREA_RATIO) & (ratio >= 1.0 / MAX_AREA_RATIO))
    for first, (i, j) in enumerate(similar):
        for k, m in similar[first + 1 :]:
            if i == k or j == m:
                continue
            span_a = a.middles[k, :2] - a.middles[i, :2]
            span_b = b.middles[m, :2] - b.middles[j, :2]
            lengths = np.hypot(*span_a), np.hypot(*span_b)
            if min(lengths) < MIN_SPAN_M or abs(lengths[0] - lengths[1]) > MAX_SPAN_DIFFERENCE_M:
                continue
            yaw = np.arctan2(span_a[1], span_a[0]) - np.arctan2(span_b[1], span_b[0])
            yield _planar_pose(yaw, (a.middles[[i, k], :2]).mean(axis=0), b.middles[[j, m], :2])


def _planar_pose(yaw: float, target: Float64, points: Float64) -> Float64:
    """Return the pose with this yaw that moves the mean of points (N, 2) to a target."""
    rotated = transform2(np.array([0.0, 0.0, yaw]), points).mean(axis=0)
    return np.array([*(target - rotated), float(wrap_angle(yaw))])


def _score(a: MapFeatures, b: MapFeatures, guess: Float64) -> float:
    surfaces, walls = _matches(a, b, guess)
    return len(surfaces) + WALL_SCORE * len(walls)


def _matches(a: MapFeatures, b: MapFeatures, guess: Float64) -> tuple[Float64, Float64]:
    """Return the index pairs (K, 2) of matching surfaces, and of matching walls."""
    moved = transform2(guess, b.middles[:, :2])
    distances = np.linalg.norm(a.middles[:, None, :2] - moved[None], axis=2)
    same_height = np.abs(a.middles[:, None, 2] - b.middles[None, :, 2]) <= MAX_HEIGHT_DIFFERENCE_M
    costs = np.where(same_height, distances, NO_MATCH_COST)
    surfaces = _mutual_nearest(costs, MAX_SURFACE_DISTANCE_M)
    return surfaces, _mutual_nearest(_wall_costs(a, b, guess), MAX_WALL_DISTANCE_M)


def _wall_costs(a: MapFeatures, b: MapFeatures, guess: Float64) -> Float64:
    """Return the distances across walls (N, M), m; `NO_MATCH_COST` if not parallel or far."""
    angle = line_angle(a.directions[:, None] - (b.directions + guess[2])[None])
    across = np.stack([-np.sin(a.directions), np.cos(a.directions)], axis=1)
    between = transform2(guess, b.wall_middles)[None] - a.wall_middles[:, None]
    offset = np.abs(np.einsum("nmk,nk->nm", between, across))
    is_far = np.linalg.norm(between, axis=2) > MAX_WALL_MIDDLE_DISTANCE_M
    return np.where((np.abs(angle) > MAX_WALL_ANGLE_RAD) | is_far, NO_MATCH_COST, offset)


def line_angle(difference: Float64 | float) -> Float64:
    """Wrap differences of directions of undirected lines to (-pi/2, pi/2], rad."""
    return wrap_angle(2.0 * difference) / 2.0


def _mutual_nearest(costs: Float64, limit: float) -> Float64:
    """Return the index pairs (K, 2) that are each other's nearest within a limit."""
    if costs.size == 0:
        return np.zeros((0, 2), np.int64)
    to_b, to_a = costs.argmin(axis=1), costs.argmin(axis=0)
    rows = np.flatnonzero(to_a[to_b] == np.arange(len(costs)))
    rows = rows[costs[rows, to_b[rows]] <= limit]
    return np.stack([rows, to_b[rows]], axis=1)


def _refine(a: MapFeatures, b: MapFeatures, guess: Float64) -> Float64:
    """Return the pose with the yaw of the matching walls and the translation of all matches."""
    surfaces, walls = _matches(a, b, guess)
    yaw = guess[2]
    if len(walls):
        errors = line_angle(a.directions[walls[:, 0]] - b.directions[walls[:, 1]] - yaw)
        yaw = yaw + float(np.median(errors))
    moved = transform2(np.array([0.0, 0.0, yaw]), b.middles[surfaces[:, 1], :2])
    rows = [np.tile(np.eye(2), (len(surfaces), 1))]
    values = [(a.middles[surfaces[:, 0], :2] - moved).ravel()]
    if len(walls):
        # A wall constrains the translation across its direction only.
        direction = a.directions[walls[:, 0]]
        across = np.stack([-np.sin(direction), np.cos(direction)], axis=1)
        rotated = transform2(np.array([0.0, 0.0, yaw]), b.wall_middles[walls[:, 1]])
        rows.append(WALL_WEIGHT * across)
        shift = np.einsum("nk,nk->n", a.wall_middles[walls[:, 0]] - rotated, across)
        values.append(WALL_WEIGHT * shift)
    shift, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
    return np.array([*shift, float(wrap_angle(yaw))])


# --- transformation of a map ---------------------------------------------------------------------


def moved_results(results: Results, pose: Float64) -> Results:
    """Return a map with surfaces, walls and trajectory transformed into another frame.

    Cuboids, cycles and planes are not transformed, as a comparison does not use them.

    Parameters
    ----------
    results
        The map.
    pose
        float64 (3,), planar pose (x, y, yaw) of its frame in the other frame, m and rad.
    """
    T = spatial(pose)
    trajectory = results.trajectory
    return replace(
        results,
        surfaces=tuple(_moved_surface(surface, T) for surface in results.surfaces),
        walls=tuple(_moved_wall(wall, pose) for wall in results.walls),
        trajectory=Trajectory(trajectory.stamps_ns, T @ trajectory.T_map_base),
    )


def _moved_surface(surface: SurfaceEntry, T: Float64) -> SurfaceEntry:
    def ring(points: Float64) -> Float64:
        return transform(T, points) if len(points) else points

    return replace(
        surface,
        normal=T[:3, :3] @ surface.normal,
        centroid=transform(T, surface.centroid[None])[0],
        boundary=ring(surface.boundary),
        holes=tuple(ring(hole) for hole in surface.holes),
        boundary_seen=ring(surface.boundary_seen),
        edges=tuple(
            replace(edge, start=ring(edge.start[None])[0], end=ring(edge.end[None])[0])
            for edge in surface.edges
        ),
    )


def _moved_wall(wall: WallEntry, pose: Float64) -> WallEntry:
    phi = wall.phi + pose[2]
    rho = wall.rho + float(np.array([np.cos(phi), np.sin(phi)]) @ pose[:2])
    if rho < 0.0:
        phi, rho = phi + np.pi, -rho
    ends = transform2(pose, wall.endpoints)
    return replace(wall, phi=float(wrap_angle(phi)), rho=rho, endpoints=ends)


def pose_text(pose: Sequence[float]) -> str:
    """Return a planar pose as text."""
    return f"{pose[0]:.2f} m, {pose[1]:.2f} m, {np.degrees(pose[2]):.1f} deg"
