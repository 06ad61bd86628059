"""Rings with fewer corners, and crossings, against a plain library."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LinearRing, Point, hausdorff_distance

from tccm_ros.outlines.rings import crosses, simplify

SEEDS = st.integers(0, 2**32 - 1)


@settings(deadline=None)
@given(SEEDS, st.integers(3, 40), st.floats(0.0, 2.0))
def test_a_simplified_ring_is_within_the_tolerance(seed, n, tolerance):
    ring = np.random.default_rng(seed).normal(size=(n, 2))
    fewer = simplify(ring, tolerance)
    assert {tuple(c) for c in fewer} <= {tuple(c) for c in ring}
    if len(fewer) >= 3:
        kept = LinearRing(fewer)
        assert max(kept.distance(Point(c)) for c in ring) <= tolerance + 1e-9
    assert len(simplify(ring, 0.0)) == n


def test_a_straight_side_has_two_corners():
    square = [(a, 0.0) for a in range(9)] + [(8.0, b) for b in range(1, 9)]
    square += [(a, 8.0) for a in range(7, -1, -1)] + [(0.0, b) for b in range(7, 0, -1)]
    fewer = simplify(np.array(square, float), 0.01)
    assert sorted(map(tuple, fewer)) == [(0, 0), (0, 8), (8, 0), (8, 8)]
    assert hausdorff_distance(LinearRing(fewer), LinearRing(square)) == 0.0


@settings(deadline=None)
@given(SEEDS, st.integers(3, 12))
def test_crossings_are_those_that_shapely_finds(seed, n):
    rng = np.random.default_rng(seed)
    ring = rng.integers(0, 6, (n, 2)).astype(float)
    if (ring == np.roll(ring, 1, axis=0)).all(axis=1).any():
        return
    simple = LinearRing(ring).is_simple
    assert crosses(ring, np.array([n], np.int32)) == (not simple)
