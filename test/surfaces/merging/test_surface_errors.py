"""Covariances of planes that several patches measured, against simulated errors."""

import numpy as np
import pytest
from shapely import MultiPolygon

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.surfaces.merging.merging import NumberedPatch
from tccm_ros.surfaces.merging.patch_planes import pose_jacobian
from tccm_ros.surfaces.merging.surface_errors import step_variance, surface_errors
from tccm_ros.surfaces.views.views import SurfacePatch

POSE = np.diag(np.square([0.005, 0.004, 0.003]))
FIT = np.diag(np.square([0.001, 0.006, 0.006]))
OUTLINE = MultiPolygon()


def patch(x, y, count=100, systematic=((0.002,), (0.0,), (0.0,))):
    points = np.array([[x, y, 0.7]], np.float32)
    cov = np.diag([0.04, 0.02, 0.0])
    return SurfacePatch(
        points, np.array([count], np.int32), count, np.array([x, y, 0.7]), cov, OUTLINE, 0.02, FIT,
        np.array(systematic),
    )  # fmt: skip


def errors_of(patches, views, T, cov):
    members = [NumberedPatch(k, v, p) for k, (p, v) in enumerate(zip(patches, views))]
    counts = np.array([p.count for p in patches], float)
    middles = np.array([(T[v] @ [*p.mean, 1.0])[:3] for p, v in zip(patches, views)])
    return surface_errors(members, counts @ middles / counts.sum(), T, cov)


def test_the_covariance_of_one_patch_is_that_of_its_parts():
    T, cov = np.eye(4)[None], POSE[None]
    found = errors_of([patch(1.5, 0.4)], [0], T, cov).covariance(cov)
    J = pose_jacobian(np.eye(4), np.array([1.5, 0.4, 0.7]))
    expected = FIT + J @ POSE @ J.T + np.diag([0.002**2 + 0.0013**2, 0.0, 0.0])
    assert found == pytest.approx(expected, abs=1e-9)


def test_views_halve_their_own_errors_and_not_those_of_their_sensor():
    """A hundred views of one place: what is left are the offset of the sensor and flatness."""
    T = np.tile(np.eye(4), (100, 1, 1))
    cov = np.tile(POSE, (100, 1, 1))
    found = errors_of([patch(1.0, 0.0)] * 100, range(100), T, cov).covariance(cov)
    one = pose_jacobian(np.eye(4), np.array([1.0, 0.0, 0.7]))
    by_views = (FIT + one @ POSE @ one.T)[0, 0] / 100
    assert found[0, 0] == pytest.approx(0.002**2 + 0.0013**2 + by_views, rel=1e-3)


def test_common_error_of_two_surfaces_makes_no_step():
    T, cov = np.tile(np.eye(4), (2, 1, 1)), np.tile(POSE, (2, 1, 1))
    a = errors_of([patch(1.0, 0.0)], [0], T, cov)
    same, other = (errors_of([patch(1.4, 0.0)], [v], T, cov) for v in (0, 1))
    at = np.array([1.2, 0.0])
    # About its plane each is bent by three times what its nine blocks leave of the mean's error.
    alone = 2.0 * (0.0013**2 + 9.0 * 0.001**2) + 2.0 * (0.001**2 + 0.2**2 * 0.006**2)
    assert step_variance(a, same, at, cov) == pytest.approx(alone, rel=1e-3)
    # At 1.2 m, z and pitch of two views, and the offset of two sensors' views.
    step = alone + 2.0 * (0.005**2 + 1.2**2 * 0.003**2 + 0.002**2)
    assert step_variance(a, other, at, cov) == pytest.approx(step, rel=1e-3)


def test_the_covariance_of_a_surface_is_that_of_simulated_errors():
    rng = np.random.default_rng(4)
    T = np.stack(
        [pose_from_rpy([0.0, 0.3, 0.0, 0.0, 0.0, 0.4]), pose_from_rpy([1, 0, 0, 0, 0, -1.0])]
    )
    cov = np.tile(POSE, (2, 1, 1))
    patches, views = [patch(1.0, 0.2, 300), patch(1.7, -0.3), patch(0.4, 1.2, 200)], [0, 0, 1]
    found = errors_of(patches, views, T, cov)
    middle = found.mean
    rows, weights, planes = [], [], []
    for p, v in zip(patches, views):
        R = T[v][:2, :2]
        xy = (T[v] @ [*p.mean, 1.0])[:2] + (rng.normal(size=(400, 2)) * [0.2, 0.02**0.5]) @ R.T
        rows.append(np.column_stack([np.ones(400), xy - middle[:2]]))
        weights.append(np.full(400, p.count / 400))
        planes.append((v, (T[v] @ [*p.mean, 1.0])[:3], R, p))
    X, w = np.concatenate(rows), np.concatenate(weights)
    solve = np.linalg.solve((X * w[:, None]).T @ X, (X * w[:, None]).T)
    samples = []
    for _ in range(3000):
        poses = rng.multivariate_normal(np.zeros(3), POSE, 2)
        offset = rng.normal()
        z = []
        for (v, at, R, p), row in zip(planes, rows):
            own = rng.multivariate_normal(np.zeros(3), FIT)
            own[1:] = R @ own[1:]
            plane = own + pose_jacobian(T[v], at) @ poses[v] + p.systematic[:, 0] * offset
            z.append(plane[0] + (row[:, 1:] + middle[:2] - at[:2]) @ plane[1:])
        samples.append(solve @ np.concatenate(z))
    expected = np.cov(np.array(samples).T)
    got = found.covariance(cov) - np.diag([0.0013**2, 0.0, 0.0])
    assert np.sqrt(np.diag(got)) == pytest.approx(np.sqrt(np.diag(expected)), rel=0.12)
