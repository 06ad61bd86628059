"""Moments of sets of points: planes, eigenvalues, residuals, against NumPy on the points."""

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from plane_rig import part_map

from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, CuboidArrays
from tccm_ros.cuboids.moments import (
    eigenvalues,
    moments_about,
    plane_of,
    residuals_of,
    tangents,
    uncertainty_of,
)

FLAT = 1e-9  # m2: variance of positions that are rounded to 0.1 mm, rounded up

SEEDS = st.integers(0, 2**32 - 1)
COUNT = 40


def moments(points):
    """Count, sums, and sums of products of points (N, 3)."""
    products = [(points[:, i] * points[:, j]).sum() for i in range(3) for j in range(i, 3)]
    return np.array([len(points), *points.sum(axis=0), *products])


def random_points(seed, thickness=0.01):
    """Return points (N, 3) near a plane of any slope, some metres from the origin."""
    rng = np.random.default_rng(seed)
    flat = rng.normal(size=(COUNT, 3)) * [rng.uniform(0.2, 1.0), rng.uniform(0.2, 1.0), thickness]
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return flat @ rotation.T + rng.uniform(-3.0, 3.0, 3)


def covariance(points):
    return np.cov(points.T, bias=True)


def unique(matrix):
    return [matrix[i, j] for i in range(3) for j in range(i, 3)]


@given(SEEDS)
def test_moments_about_a_point_are_those_of_the_points(seed):
    """In ticks of 0.1 mm all sums are exact."""
    rng = np.random.default_rng(seed)
    ticks = rng.integers((-9000, -9000, 200), (9000, 9000, 9000), (60, 3))
    ticks[30:] = ticks[:30] + rng.integers(-40, 40, (30, 3))
    cuboids = part_map((ticks + 0.25) * TICK)
    origin = rng.integers(-5000, 5000, 3).astype(float)
    found = moments_about(CuboidArrays(*cuboids.arrays), origin)
    cell = round(cuboids.cell_size * TICKS_PER_M)
    for k in range(len(cuboids)):
        own = np.all(ticks[:, :2] // cell == [cuboids.ix[k], cuboids.iy[k]], axis=1)
        own &= (ticks[:, 2] > cuboids.bottom[k]) & (ticks[:, 2] <= cuboids.top[k])
        assert found[k] == pytest.approx(moments((ticks[own] - origin) * TICK), rel=1e-12, abs=1e-9)
    assert found.shape == (len(cuboids), 10)
    assert found[:, 0].sum() == 60


@given(SEEDS, st.sampled_from([0.0, 1e-4, 0.01, 0.3]))
def test_eigenvalues_are_those_of_the_covariance(seed, thickness):
    matrix = covariance(random_points(seed, thickness))
    expected = np.linalg.eigvalsh(matrix)[::-1]
    assert eigenvalues(*unique(matrix)) == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("roots", [(2.0, 1.0, 1.0), (1.0, 1.0, 0.5), (3.0, 3.0, 3.0), (4, 0, 0)])
def test_eigenvalues_of_equal_roots(roots):
    """Of three equal roots a polynomial tells as much as the third root of the rounding."""
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    found = eigenvalues(*unique(rotation @ np.diag(np.array(roots, float)) @ rotation.T))
    assert found == pytest.approx(roots, abs=1e-4)


@given(SEEDS)
@example(0)
def test_the_plane_is_the_least_squares_plane_of_the_points(seed):
    points = random_points(seed)
    nx, ny, nz, d, *roots = plane_of(moments(points))
    values, vectors = np.linalg.eigh(covariance(points))
    assert abs(vectors[:, 0] @ (nx, ny, nz)) == pytest.approx(1.0, abs=1e-6)
    assert d == pytest.approx(points.mean(axis=0) @ (nx, ny, nz), abs=1e-9)
    assert roots == pytest.approx(values[::-1], rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_planes_along_two_axes_have_the_third_as_normal(axis):
    points = np.random.default_rng(axis).uniform(-1.0, 1.0, (COUNT, 3))
    points[:, axis] = 0.7
    *normal, d, _, _, smallest = plane_of(moments(points))
    sign = np.sign(normal[axis])
    assert sign * np.array(normal) == pytest.approx(np.eye(3)[axis], abs=1e-9)
    assert (sign * d, smallest) == pytest.approx((0.7, 0.0), abs=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_a_normal_close_to_an_axis_is_as_precise_as_any(axis):
    """Of the three cross products two are 1e-7 times as long: hardly more than rounding."""
    points = np.random.default_rng(axis).uniform(-1.0, 1.0, (COUNT, 3))
    others = [i for i in range(3) if i != axis]
    points[:, axis] = 0.7 + 1e-7 * points[:, others].sum(axis=1)
    expected = np.full(3, -1e-7)
    expected[axis] = 1.0
    normal = np.array(plane_of(moments(points))[:3])
    assert np.sign(normal[axis]) * normal == pytest.approx(expected, abs=1e-13)


def test_points_at_one_place_have_a_horizontal_plane_through_it():
    points = np.full((5, 3), (0.3, -0.2, 0.9))
    assert plane_of(moments(points))[:4] == pytest.approx((0.0, 0.0, 1.0, 0.9))


@given(SEEDS)
def test_residuals_are_sums_over_the_points(seed):
    rng = np.random.default_rng(seed)
    points = random_points(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    d = rng.uniform(-1.0, 1.0)
    away = points @ normal - d
    found = residuals_of(moments(points), *normal, d)
    assert found == pytest.approx((away.sum(), (away**2).sum()), rel=1e-9, abs=1e-9)


@given(SEEDS)
def test_tangents_are_level_and_up_the_slope(seed):
    normal = np.random.default_rng(seed).normal(size=3)
    normal /= np.linalg.norm(normal)
    u, v = tangents(normal)
    assert np.stack([u, v, normal]) @ np.stack([u, v, normal]).T == pytest.approx(np.eye(3))
    assert np.cross(u, v) == pytest.approx(normal)
    assert u[2] == pytest.approx(0.0, abs=1e-12)
    assert v[2] >= 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_tangents_of_a_horizontal_plane_are_x_and_y(side):
    u, v = tangents(np.array([0.0, 0.0, side]))
    assert np.concatenate([u, v]) == pytest.approx([1.0, 0.0, 0.0, 0.0, side, 0.0])


@given(SEEDS, st.floats(1e-8, 1e-4))
def test_the_covariance_of_a_plane_is_that_of_least_squares(seed, variance):
    """A small rotation about u lifts a point by its v, one about v lowers it by its u."""
    points = random_points(seed)
    normal = np.linalg.eigh(covariance(points))[1][:, 0]
    assume(np.hypot(*normal[:2]) > 1e-3)
    u, v = tangents(normal)
    arm = points - points.mean(axis=0)
    rows = np.column_stack([arm @ v, -arm @ u, np.ones(COUNT)])
    cov, quality = uncertainty_of(moments(points), normal, variance)
    expected = variance * np.linalg.inv(rows.T @ rows)
    assert cov == pytest.approx(expected, rel=1e-6, abs=1e-9 * variance)
    third, second, first = np.linalg.eigvalsh(covariance(points))
    assert quality == pytest.approx(first * second / max(third, FLAT), rel=1e-4)
