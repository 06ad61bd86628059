"""A map as the plane kernels read it against plain sums over points, and who may shape a fit."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, CuboidArrays
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.planes.arrays import cap_of, plane_map
from tccm_ros.planes.inliers import drain, fit_horizontal, sharing_cells

CAP_DEPTH = 150  # ticks: 15 mm, the height noise of a horizontal surface to both sides


def sums_of(points):
    products = [(points[:, i] * points[:, j]).sum() for i in range(3) for j in range(i, 3)]
    return np.array([len(points), *points.sum(axis=0), *products])


def about(cuboids, origin):
    caps = cuboids.caps
    return plane_map(CuboidArrays(*cuboids.arrays), caps.of, caps.moments, origin)


@given(st.integers(0, 10_000), st.integers(1, 150), st.floats(0.001, 0.5))
@settings(deadline=None, max_examples=25)
def test_moments_and_caps_are_sums_over_points_about_the_origin(seed, n, height):
    rng = np.random.default_rng(seed)
    builder = PartMapBuilder(Config())
    builder.add_points(rng.uniform((-0.05, -0.05, 0.3), (0.05, 0.05, 0.3 + height), (n, 3)))
    part = builder.close(0, 0, 1)
    cuboids, owner = part.cuboids(), part.point_cuboids()
    origin = rng.integers(-20_000, 20_000, 3).astype(float)
    arrays = about(cuboids, origin)
    ticks = np.rint(part.positions() * TICKS_PER_M)
    points = (ticks - origin) * TICK
    for k in range(len(cuboids)):
        own = owner == k
        np.testing.assert_allclose(arrays.M[k], sums_of(points[own]), rtol=1e-9, atol=1e-9)
        in_cap = own & (ticks[:, 2] >= cuboids.top[k] - CAP_DEPTH)
        np.testing.assert_allclose(cap_of(arrays, k), sums_of(points[in_cap]), rtol=1e-9, atol=1e-9)


@given(st.sets(st.integers(0, 300)))
@settings(deadline=None)
def test_drained_bits_are_those_set_in_rising_order_and_are_cleared(chosen):
    words = np.zeros(5, np.uint64)
    for i in chosen:
        words[i // 64] |= np.uint64(1) << np.uint64(i % 64)
    assert drain(words, len(chosen)).tolist() == sorted(chosen)
    assert not words.any()


@pytest.mark.parametrize("seed", range(5))
def test_cells_with_two_heights_take_no_part_in_a_horizontal_fit(seed):
    # A top of one point or more in each cell, and 40 mm below it the edge rows of its front.
    rng = np.random.default_rng(seed)
    x, y = (g.ravel() for g in np.meshgrid(np.arange(0.81, 0.95, 0.01), np.arange(0.0, 0.3, 0.01)))
    top = np.column_stack([x, y, 0.9 + rng.normal(0.0, 0.0025, len(x))])
    across = np.arange(0.0, 0.3, 0.01)
    rows = [np.column_stack([0.8 + 0 * across, across, z + 0 * across]) for z in (0.86, 0.82)]
    builder = PartMapBuilder(Config())
    builder.add_points(np.concatenate([top, *rows]))
    cuboids = builder.close(0, 0, 1).cuboids()
    arrays = about(cuboids, np.zeros(3))
    members = np.arange(len(cuboids), dtype=np.int32)
    cells = Counter(zip(cuboids.ix.tolist(), cuboids.iy.tolist(), strict=True))
    shared = np.array([cells[c] > 1 for c in zip(cuboids.ix, cuboids.iy, strict=True)])
    assert shared.any()
    np.testing.assert_array_equal(sharing_cells(arrays.ix, arrays.iy, members), shared)
    total = np.zeros(10)
    # A guess with the scatter of top and front together takes in both.
    plane = fit_horizontal(
        arrays, members, np.ones(len(members), np.bool_), (0.0, 0.0, 1.0, 0.895, 4e-4), total
    )
    assert total[0] == arrays.M[~shared, 0].sum()
    middle = np.array([*top[:, :2].mean(axis=0), 0.0])
    assert plane[3] - np.dot(plane[:3], middle) == pytest.approx(0.9, abs=4 * 0.0025 / 15)
    assert abs(plane[2]) > np.cos(np.radians(0.5))
