"""Shared areas against a plain polygon library."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from tccm_ros.outlines.overlap import overlap_fraction, overlap_fractions


def star(seed, n, centre):
    """A ring (N, 2) around a centre that does not cross itself."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
    radius = rng.uniform(0.3, 1.0, n)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None] + centre


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(5, 40), st.floats(-2.5, 2.5), st.floats(-2.5, 2.5))
def test_overlap_fraction_is_that_of_the_polygons(seed, n, x, y):
    a, b = star(seed, n, (0.0, 0.0)), star(seed + 1, n, (x, y))
    first, second = Polygon(a), Polygon(b)
    if not (first.is_valid and second.is_valid):
        return
    expected = first.intersection(second).area / min(first.area, second.area)
    # The distance of the lines is at most 2 m / 48, and spikes may lie between two of them.
    assert overlap_fraction(a, b) == pytest.approx(expected, abs=0.08)
    assert overlap_fraction(a, b) == pytest.approx(overlap_fraction(b, a))


def test_a_ring_overlaps_itself_fully_and_one_beside_it_not_at_all():
    ring = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    assert overlap_fraction(ring, ring[::-1].copy()) == pytest.approx(1.0)
    assert overlap_fraction(ring, ring + np.array([2.5, 0.0])) == 0.0
    assert overlap_fraction(ring, ring + np.array([1.0, 0.0])) == pytest.approx(0.5)
    assert overlap_fraction(ring, ring[:2].copy()) == 0.0


def test_overlap_is_measured_against_the_normal_of_the_first_ring():
    wall = np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 2.0, 1.0], [1.0, 0.0, 1.0]])
    rings = np.concatenate([wall, wall + np.array([0.0, 1.0, 0.0])])
    ends = np.array([4, 8])
    pairs = np.array([[0, 0], [0, 1], [1, 1]])
    normals = np.array([[-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    fractions = overlap_fractions(rings, ends, normals, rings, ends, pairs)
    np.testing.assert_allclose(fractions, [1.0, 0.5, 1.0])
