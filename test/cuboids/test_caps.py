"""Caps of cuboids: against plain sums over the points at the tops."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.cuboids.part_map import PartMapBuilder

CAP_DEPTH = 150  # ticks: 15 mm, the height noise of a horizontal surface to both sides


def built(points):
    builder = PartMapBuilder(Config())
    builder.add_points(points)
    return builder.close(0, 0, 1)


def plain_caps(part):
    """Return count, sums and products of the points at each cuboid's top, float64 (N, 10)."""
    cuboids, owner = part.cuboids(), part.point_cuboids()
    points = np.rint(part.positions() * TICKS_PER_M) - cuboids.cell_origin[owner]
    sums = np.zeros((len(cuboids), 10))
    for p, k in zip(points, owner, strict=True):
        if p[2] >= cuboids.top[k] - CAP_DEPTH:
            products = [p[i] * p[j] for i in range(3) for j in range(i, 3)]
            sums[k] += [1.0, *p, *products]
    return sums


@given(st.integers(0, 10_000), st.integers(1, 200), st.floats(0.001, 0.5))
@settings(deadline=None, max_examples=40)
def test_caps_are_the_points_at_the_top(seed, n, height):
    rng = np.random.default_rng(seed)
    part = built(rng.uniform((-0.05, -0.05, 0.3), (0.05, 0.05, 0.3 + height), (n, 3)))
    caps, expected = part.cuboids().caps, plain_caps(part)
    whole = expected[:, 0] == part.moments[:, 0]
    np.testing.assert_array_equal(caps.of < 0, whole)
    np.testing.assert_array_equal(caps.moments, expected[~whole])
    assert sorted(caps.of[~whole]) == list(range(len(caps.moments)))


def test_without_points_no_caps_are_known():
    part = built(np.random.default_rng(0).uniform(0.0, 0.5, (50, 3)))
    caps = part.without_points().cuboids().caps
    assert len(caps.of) == 0
    assert len(caps.moments) == 0
