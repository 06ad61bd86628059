"""A map as the plane kernels read it: moments about one origin against plain sums over points."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.mapping.caps import CAP_DEPTH
from tccm_ros.mapping.cuboids import TICK, TICKS_PER_M
from tccm_ros.mapping.part_map import PartMapBuilder
from tccm_ros.mapping.plane_map import cap_of, plane_map
from tccm_ros.mapping.plane_members import drain


def sums_of(points):
    products = [(points[:, i] * points[:, j]).sum() for i in range(3) for j in range(i, 3)]
    return np.array([len(points), *points.sum(axis=0), *products])


@given(st.integers(0, 10_000), st.integers(1, 150), st.floats(0.001, 0.5))
@settings(deadline=None, max_examples=25)
def test_moments_and_caps_are_sums_over_points_about_the_origin(seed, n, height):
    rng = np.random.default_rng(seed)
    builder = PartMapBuilder(Config())
    builder.add_points(rng.uniform((-0.05, -0.05, 0.3), (0.05, 0.05, 0.3 + height), (n, 3)))
    part = builder.close(0, 0, 1)
    cuboids, owner = part.cuboids(), part.point_cuboids()
    origin = rng.integers(-20_000, 20_000, 3).astype(float)
    arrays = plane_map(
        cuboids.ix, cuboids.iy, cuboids.bottom, cuboids.top, cuboids.count, cuboids.s, cuboids.S,
        cuboids.caps.of, cuboids.caps.moments, cuboids.cell_size * TICKS_PER_M, TICK, origin,
    )  # fmt: skip
    ticks = np.rint(part.positions() * TICKS_PER_M)
    points = (ticks - origin) * TICK
    for k in range(len(cuboids)):
        own = owner == k
        np.testing.assert_allclose(arrays.M[k], sums_of(points[own]), rtol=1e-9, atol=1e-9)
        in_cap = own & (ticks[:, 2] >= cuboids.top[k] - CAP_DEPTH)
        np.testing.assert_allclose(cap_of(arrays, k), sums_of(points[in_cap]), rtol=1e-9, atol=1e-9)


@given(st.sets(st.integers(0, 300)))
@settings(deadline=None)
def test_drained_bits_are_the_set_rising_and_then_none(chosen):
    words = np.zeros(5, np.uint64)
    for i in chosen:
        words[i // 64] |= np.uint64(1) << np.uint64(i % 64)
    assert drain(words, len(chosen)).tolist() == sorted(chosen)
    assert not words.any()
