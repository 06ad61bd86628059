"""Cuboids that take part in a fit: sums of squares against points, and steep planes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plane_rig import EYE, part_map
from scipy.stats import chi2

from tccm_ros.cuboids.cuboids import TICKS_PER_M, CuboidArrays
from tccm_ros.planes.arrays import PlaneMap, plane_map
from tccm_ros.planes.inliers import (
    NOTHING,
    add_scaled,
    dot,
    fit_horizontal,
    max_scatter,
    squares_about,
)

GATE = 4.0  # sigmas of an inlier: one point of a plane in 16,000 is further away
STRICT = 2.0  # sigmas of the chi-square test near an edge

SEEDS = st.integers(0, 2**32 - 1)


def moments(points):
    products = [(points[:, i] * points[:, j]).sum() for i in range(3) for j in range(i, 3)]
    return np.array([len(points), *points.sum(axis=0), *products])


@given(SEEDS)
def test_squares_about_a_plane_are_those_of_the_points(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.0, 2.0, (20, 3))
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    d = rng.uniform(-1.0, 1.0)
    weights = squares_about((*normal.tolist(), d, 1e-6))
    assert dot(weights, moments(points)) == pytest.approx(((points @ normal - d) ** 2).sum())


@given(SEEDS, st.floats(-2.0, 2.0))
def test_moments_are_added_with_a_weight(seed, weight):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1.0, 1.0, (2, 10))
    assert add_scaled(tuple(a.tolist()), b, weight) == pytest.approx(a + weight * b)
    assert add_scaled(NOTHING, b, weight) == pytest.approx(weight * b)


@pytest.mark.parametrize("n", [3, 10, 30, 100, 1000])
def test_noise_seldom_scatters_by_more_than_the_maximum(n):
    """As many of n squares as a normal distribution has beyond two and four deviations, nearly."""
    assert 0.01 < chi2.sf(max_scatter(float(n), STRICT), n) < 0.05
    assert chi2.sf(max_scatter(float(n), GATE), n) < 1e-3


@pytest.mark.parametrize(("slope_deg", "is_steep"), [(20.0, False), (70.0, True)])
def test_all_cuboids_of_a_cell_contribute_to_a_steep_plane(slope_deg, is_steep):
    """Lines 40 mm above each other are cuboids of their own; 20 mm further it has risen by 55."""
    rng = np.random.default_rng(1)
    slope = np.tan(np.radians(slope_deg))
    z = np.repeat(np.arange(0.2, 1.2, 0.04 if is_steep else 0.004), 400)
    x = 1.0 + (z - 0.2) / slope
    points = np.column_stack([x, rng.uniform(-0.5, 0.5, len(z)), z])
    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    noisy = points + rng.normal(0.0, 0.001, len(z))[:, None] * normal
    cuboids = part_map(noisy)
    _, per_cell = np.unique(np.column_stack([cuboids.ix, cuboids.iy]), axis=0, return_counts=True)
    assert (per_cell > 1).mean() > 0.5 if is_steep else (per_cell > 1).mean() < 0.1
    origin = np.rint(EYE * TICKS_PER_M)
    none = np.zeros(0, np.int32), np.zeros((0, 10))
    arrays = plane_map(CuboidArrays(*cuboids.arrays), *none, origin)
    members = np.arange(len(cuboids), dtype=np.int32)
    offset = float(normal @ (points[0] - EYE))
    total = np.zeros(10)
    deep = np.ones(len(members), bool)
    plane = fit_horizontal(arrays, members, deep, (*normal.tolist(), offset, 1e-6), total)
    assert total[0] > 0.9 * len(points)
    assert abs(np.array(plane[:3]) @ normal) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("scatter", "is_used"), [(1.4, True), (1.6, False)])
def test_cuboid_near_an_edge_is_used_up_to_two_deviations_of_scatter(scatter, is_used):
    """The sum of 32 squares has a mean of 32 and a sigma of 8: at most 48, 1.5 times the mean."""
    rng = np.random.default_rng(0)
    sigma, count = 0.002, 21
    z = sigma * np.tile([-1.0, 1.0], 16)
    ix, iy = np.arange(count, dtype=np.int32), np.zeros(count, np.int32)
    patches = [
        np.column_stack([0.02 * k + rng.uniform(0.0, 0.02, (32, 2)), z]) for k in range(count)
    ]
    patches[-1][:, 2] *= np.sqrt(scatter)
    M = np.array([moments(patch) for patch in patches])
    spans = np.full(count, -30, np.int32), np.full(count, 30, np.int32)
    none = np.zeros(0, np.int32), np.zeros((0, 10))
    cuboids = PlaneMap(M, ix, iy, *spans, *none, 200.0, 1e-4, np.zeros(3))
    total, near_edge = np.zeros(10), np.zeros(count, bool)
    fit_horizontal(cuboids, ix, near_edge, (0.0, 0.0, 1.0, 0.0, sigma**2), total)
    assert total[0] == 32 * (count if is_used else count - 1)
