"""z, roll and pitch of views by planes that several saw; truth is simulated or solved densely."""

import numpy as np
import pytest

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.surfaces.merging.patch_planes import PatchPlanes, pose_jacobian
from tccm_ros.surfaces.registration.plane_adjustment import adjust_planes

PRIOR = np.diag(np.square([0.005, 0.005, 0.005]))
FIT = np.diag(np.square([0.001, 0.004, 0.004]))


def world(seed, views=6, surfaces=3, parts=2, sigma=1.0):
    """Return patches of horizontal surfaces with errors at random, and the views' true errors."""
    rng = np.random.default_rng(seed)
    T = [
        pose_from_rpy([*rng.normal(0.0, 1.0, 2), 0.0, 0.0, 0.0, yaw])
        for yaw in rng.uniform(-3, 3, views)
    ]
    view, surface = (k.ravel() for k in np.meshgrid(np.arange(views), np.arange(surfaces)))
    heights, slopes = rng.uniform(0.4, 1.0, surfaces), rng.normal(0.0, 0.01, (surfaces, 2))
    places = np.array([[1.5, 0.0], [0.0, 1.5], [-1.0, -1.0]])[:surfaces]
    errors = rng.multivariate_normal(np.zeros(3), PRIOR, views)
    shared = rng.normal(size=(views, parts))
    centroid, slope, J = [], [], []
    systematic = rng.normal(0.0, 0.002, (len(view), 3, parts))
    for p, (v, s) in enumerate(zip(view, surface)):
        xy = places[s] + rng.uniform(-0.3, 0.3, 2)
        plane = np.array([heights[s] + slopes[s] @ (xy - places[s]), *slopes[s]])
        at = np.array([*xy, plane[0]])
        J.append(pose_jacobian(T[v], at))
        plane = plane - J[-1] @ errors[v] + systematic[p] @ shared[v]
        plane = plane + sigma * rng.multivariate_normal(np.zeros(3), FIT)
        centroid.append([*xy, plane[0]])
        slope.append(plane[1:])
    cov_fit, none = np.tile(FIT, (len(view), 1, 1)), np.zeros((len(view), 3, 3))
    planes = PatchPlanes(view, np.array(centroid), np.array(slope), cov_fit, systematic, none)
    return planes, np.array(J), surface, np.tile(PRIOR, (views, 1, 1)), errors


def solve_densely(planes, J, surface, cov):
    """Return correction and covariance of the views by one weighted least-squares problem."""
    V, S, K = len(cov), surface.max() + 1, planes.systematic.shape[2]
    D = 3 + K
    rows, right = [], []
    for v in range(V):
        block = np.zeros((D, V * D + 3 * S))
        block[:, v * D : (v + 1) * D] = np.eye(D)
        block[:3] = np.linalg.cholesky(np.linalg.inv(cov[v])).T @ block[:3]
        rows.append(block)
        right.append(np.zeros(D))
    for p, (v, s) in enumerate(zip(planes.view_index, surface)):
        x, y = planes.centroid[p, :2]
        block = np.zeros((3, V * D + 3 * S))
        block[:, v * D : v * D + 3] = J[p]
        block[:, v * D + 3 : (v + 1) * D] = -planes.systematic[p]
        block[:, V * D + 3 * s : V * D + 3 * s + 3] = -np.array([[1, x, y], [0, 1, 0], [0, 0, 1]])
        W = np.linalg.cholesky(np.linalg.inv(planes.cov_fit[p])).T
        rows.append(W @ block)
        right.append(-W @ [planes.centroid[p, 2], *planes.slope[p]])
    A, b = np.concatenate(rows), np.concatenate(right)
    inverse = np.linalg.inv(A.T @ A)
    x = (inverse @ A.T @ b)[: V * D].reshape(V, D)[:, :3]
    blocks = [inverse[v * D : v * D + 3, v * D : v * D + 3] for v in range(V)]
    return x, np.array(blocks)


def test_the_adjustment_is_that_of_least_squares():
    planes, J, surface, cov, _ = world(1)
    found = adjust_planes(planes, J, surface, cov)
    assert found.used.all()
    correction, expected = solve_densely(planes, J, surface, cov)
    assert found.correction == pytest.approx(correction, abs=1e-7)
    assert found.cov == pytest.approx(expected, rel=1e-3, abs=1e-10)


def test_corrections_are_as_good_as_their_covariances_say():
    squares, before = [], []
    for seed in range(30):
        planes, J, surface, cov, errors = world(seed)
        found = adjust_planes(planes, J, surface, cov)
        for error, correction, own in zip(errors, found.correction, found.cov):
            squares.append((error - correction) @ np.linalg.solve(own, error - correction))
            before.append(np.linalg.det(own) / np.linalg.det(PRIOR))
    # 180 views of three degrees of freedom: chi-square of 540, three sigmas of the mean.
    assert np.mean(squares) / 3.0 == pytest.approx(1.0, abs=0.25)
    assert np.median(before) < 0.2


def test_residuals_follow_their_covariances():
    squares, freedom = 0.0, 0
    for seed in range(20):
        planes, J, surface, cov, _ = world(seed)
        found = adjust_planes(planes, J, surface, cov)
        squares, freedom = squares + found.chi2.sum(), freedom + found.freedom.sum()
    assert squares / freedom == pytest.approx(1.0, abs=0.2)


def test_a_patch_of_another_surface_is_left_out():
    """It is 4 cm lower than the surface that it was taken for: it moves no view."""
    planes, J, surface, cov, errors = world(3)
    lower = planes.centroid.copy()
    lower[7, 2] -= 0.04
    found = adjust_planes(planes._replace(centroid=lower), J, surface, cov)
    assert not found.used[7]
    assert found.used.sum() >= 16
    assert np.abs(found.correction[:, 0] - errors[:, 0]).max() < 0.01


def test_a_slope_that_is_uncertain_rotates_no_view():
    """Of a board views know the height to 1 mm, but the slope only to 50 mrad."""
    planes, J, surface, cov, _ = world(2, views=2, surfaces=1, parts=0, sigma=0.0)
    loose = np.tile(np.diag(np.square([0.001, 0.05, 0.05])), (2, 1, 1))
    tilted = planes.slope + np.array([[0.0, 0.0], [0.03, -0.02]])
    found = adjust_planes(planes._replace(slope=tilted, cov_fit=loose), J, surface, cov)
    untouched = adjust_planes(planes._replace(cov_fit=loose), J, surface, cov)
    assert found.correction[:, 1:] == pytest.approx(untouched.correction[:, 1:], abs=5e-4)
