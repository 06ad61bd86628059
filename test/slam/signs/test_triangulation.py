"""Points from rays, against a closed form and against the truth with noise."""

import numpy as np
import pytest
from scipy.stats import chi2

from tccm_ros.slam.signs.triangulation import Rays, consensus, parallax, triangulate

SIGMA_ANGLE, SIGMA_POSITION = 0.004, 0.006


def rays_to(points, origins, random=None, angle=SIGMA_ANGLE, position=SIGMA_POSITION):
    """Return rays from origins (N, 3) to points (N, 3), with noise where `random` is given."""
    away = np.asarray(points, float) - origins
    directions = away / np.linalg.norm(away, axis=1, keepdims=True)
    if random is not None:
        directions = directions + random.normal(size=directions.shape) * angle
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        origins = origins + random.normal(size=origins.shape) * position
    n = len(directions)
    return Rays(origins, directions, np.full(n, angle**2), np.full(n, position**2))


def along(count, length=2.0):
    return np.column_stack([np.linspace(0, length, count), np.zeros(count), np.ones(count)])


def test_two_rays_give_the_point_and_the_covariance_of_the_closed_form():
    """Cameras at (-a, 0, 0) and (a, 0, 0), the point at (0, b, 0); weights 1 / (r2 s2)."""
    a, b = 1.0, 2.0
    rays = rays_to([[0, b, 0]] * 2, np.array([[-a, 0.0, 0.0], [a, 0.0, 0.0]]), position=0.0)
    found = triangulate(rays)
    assert np.allclose(found.position, [0, b, 0])
    r2 = a * a + b * b
    w = 1.0 / (r2 * SIGMA_ANGLE**2)
    information = w * 2.0 * np.array([b * b / r2, a * a / r2, 1.0])
    assert np.allclose(found.covariance, np.diag(1.0 / information))
    assert parallax(rays.directions) == pytest.approx(2.0 * np.arctan2(a, b))


def test_errors_are_as_the_covariance_says():
    """300 points from 6 rays each: the sum of squared Mahalanobis distances within 99.9 %."""
    random, point, total = np.random.default_rng(3), np.array([1.5, 1.2, 1.6]), 0.0
    for _ in range(300):
        found = triangulate(rays_to([point] * 6, along(6), random))
        error = found.position - point
        total += error @ np.linalg.solve(found.covariance, error)
    assert chi2.ppf(0.0005, 900) < total < chi2.ppf(0.9995, 900)


def test_the_point_of_the_majority_is_found_among_rays_to_other_points():
    random, point, other = np.random.default_rng(1), [1.0, 1.3, 1.5], [3.0, 1.3, 1.5]
    rays = rays_to([point] * 6 + [other] * 4, np.concatenate([along(6), along(4)]), random)
    members, found = consensus(rays, 3)
    assert members == [0, 1, 2, 3, 4, 5]
    assert np.allclose(found.position, point, atol=0.03)


def test_rays_without_parallax_have_no_intersection():
    """A robot that comes straight towards a plate sees it under one angle."""
    towards = np.column_stack([np.linspace(0, 1.5, 8), np.zeros(8), np.ones(8)])
    rays = rays_to([[5.0, 0.2, 1.0]] * 8, towards, np.random.default_rng(2))
    assert consensus(rays, 2) is None


def test_rays_that_never_meet_have_no_intersection():
    """A number on a card that somebody carries along with the robot."""
    origins = along(8)
    rays = rays_to(origins + np.array([1.0, 1.5, 0.3]), origins, np.random.default_rng(2))
    assert consensus(rays, 2) is None
