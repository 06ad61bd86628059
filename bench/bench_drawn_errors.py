"""Compare covariances of surface heights with errors drawn from the noise model, by chi-square.

python bench/bench_drawn_errors.py

Views from random places around a floor and three tables measure them with white noise, with one
draw of the sensor's systematic error for all views, and with z, roll and pitch drawn for each view.
A row is printed for each sensor and number of views: the mean squared error of heights over their
variance, with the poses as drawn, and with z, roll and pitch adjusted by planes. Right covariances
give 1.
"""

from __future__ import annotations

import numpy as np
from shapely import MultiPolygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, pose_from_rpy, transform
from tccm_ros.records import SensorKind
from tccm_ros.sensors.noise import systematic_errors
from tccm_ros.surfaces.merging.merging import NumberedPatch
from tccm_ros.surfaces.merging.patch_planes import pose_jacobian, stack_planes
from tccm_ros.surfaces.merging.surface_errors import surface_errors
from tccm_ros.surfaces.registration.plane_adjustment import adjust_planes
from tccm_ros.surfaces.registration.registration import corrected
from tccm_ros.surfaces.views.plane_errors import fit_covariance, systematic_planes
from tccm_ros.surfaces.views.views import SurfacePatch

EYE = np.array([0.0, 0.0, 1.2])
"""Position of the sensor in the base frame, m."""

PRIOR = np.diag(np.square([0.005, np.radians(0.3), np.radians(0.3)]))
"""Covariance of z, roll and pitch of a view, as of views in the graph, m2 and rad2."""

NOISE = 0.003
"""White noise of a point's height, m."""

HALF_VIEW, MAX_RANGE = 0.6, 4.0
"""A view sees points within this yaw, rad, and range, m."""

POINTS, MIN_POINTS = 300, 30
"""Points on a surface, and those that a view must see of it."""

SQUARES = np.array(
    [(0.0, 0.0, 0.0, 3.0), (1.5, 0.5, 0.74, 0.4), (-1.2, 1.0, 0.45, 0.3), (0.3, -1.6, 0.9, 0.3)]
)
"""Centre x and y, height and half side of the floor and of three tables, m."""


def main() -> None:
    """Print a table."""
    print("| sensor | views | poses as drawn | poses adjusted |")
    print("|---|---|---|---|")
    for sensor in (SensorKind.LASER, SensorKind.DEPTH_IMAGE):
        for views, trials in ((2, 40), (6, 40), (30, 20)):
            pairs = [trial(np.random.default_rng(k), views, sensor) for k in range(trials)]
            before, after = (np.concatenate(squares).mean() for squares in zip(*pairs))
            name = sensor.name.lower().replace("_", " ")
            print(f"| {name} | {views} | {before:.2f} | {after:.2f} |", flush=True)


def trial(rng: np.random.Generator, count: int, sensor: SensorKind) -> tuple[Float64, Float64]:
    """Return squared errors of heights over their variances before and after the adjustment."""
    config = Config()
    drawn = rng.normal(size=5)
    errors = rng.multivariate_normal(np.zeros(3), PRIOR, count)
    T_known = np.stack([_pose(rng) for _ in range(count)])
    T_true = corrected(T_known, errors)
    members: list[NumberedPatch] = []
    surface = []
    for v, T in enumerate(T_true):
        for k, (x, y, z, half) in enumerate(SQUARES):
            xy = np.array([x, y]) + rng.uniform(-half, half, (POINTS, 2))
            local = transform(inverse(T), np.column_stack([xy, np.full(POINTS, z)]))
            yaw, distance = np.arctan2(local[:, 1], local[:, 0]), np.hypot(*local[:, :2].T)
            local = local[(np.abs(yaw) < HALF_VIEW) & (distance < MAX_RANGE)]
            if len(local) >= MIN_POINTS:
                shifts = systematic_errors(local, EYE, sensor, config)
                points = local + np.einsum("nkj,k->nj", shifts, drawn)
                points[:, 2] += rng.normal(0.0, NOISE, len(points))
                patch = _patch(points, systematic_errors(points, EYE, sensor, config))
                members.append(NumberedPatch(len(members), v, patch))
                surface.append(k)
    cov = np.tile(PRIOR, (count, 1, 1))
    view = np.array([member.view for member in members])
    patches = [member.patch for member in members]
    planes = stack_planes(patches, view, T_known, cov)
    J = np.stack([pose_jacobian(T_known[v], c) for v, c in zip(view, planes.centroid)])
    numbers = np.unique(surface, return_inverse=True)[1]
    found = adjust_planes(planes, J, numbers, cov)
    of_surface = [
        ([members[p] for p in np.flatnonzero(np.array(surface) == k)], SQUARES[k, 2])
        for k in np.unique(surface)
    ]
    before = [_square(own, z, T_known, cov) for own, z in of_surface]
    T_adjusted = corrected(T_known, found.correction)
    return np.array(before), np.array([_square(o, z, T_adjusted, found.cov) for o, z in of_surface])


def _pose(rng: np.random.Generator) -> Float64:
    """Return a pose 2.2 m from the centre that looks towards it."""
    angle = rng.uniform(-np.pi, np.pi)
    x, y = 2.2 * np.cos(angle), 2.2 * np.sin(angle)
    return pose_from_rpy([x, y, 0.0, 0.0, 0.0, angle + np.pi + rng.normal(0.0, 0.3)])


def _patch(points: Float64, errors: Float64) -> SurfacePatch:
    """Return a patch of points with the errors of its plane."""
    weights = np.ones(len(points))
    return SurfacePatch(
        points.astype(np.float32),
        np.ones(len(points), np.int32),
        len(points),
        points.mean(axis=0),
        np.cov(points.T, bias=True),
        MultiPolygon(),
        0.02,
        fit_covariance(points, weights),
        systematic_planes(points, weights, errors),
    )


def _square(members: list[NumberedPatch], z: float, T: Float64, cov: Float64) -> float:
    """Return the squared error of the height of a surface over its variance."""
    counts = np.array([float(member.patch.count) for member in members])
    means = np.stack([transform(T[m.view], m.patch.mean[None])[0] for m in members])
    mean = counts @ means / counts.sum()
    found = surface_errors(members, mean, T, cov).covariance(cov)
    return float((mean[2] - z) ** 2 / found[0, 0])


if __name__ == "__main__":
    main()
