"""Common areas of outlines against an integral along parallel lines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.outlines.overlap import overlaps

FAR = 1e6


def star(seed, n, centre):
    """A ring (N, 2) around a centre that does not cross itself."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
    radius = rng.uniform(0.3, 1.0, n)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None] + centre


def lines_in(ring, y):
    """Return the ends (L, K) in x of the parts of lines of constant y (L,) in a ring.

    Lines with fewer parts have further ones of no length, far away.
    """
    x, v = ring[:, 0], ring[:, 1] - y[:, None]
    x2, v2 = np.roll(x, -1), np.roll(v, -1, axis=1)
    crosses = (v > 0.0) != (v2 > 0.0)
    at = np.where(crosses, x + (x2 - x) * v / np.where(crosses, v - v2, 1.0), FAR)
    at = np.sort(at, axis=1)
    return at[:, : len(ring) // 2 * 2 : 2], at[:, 1::2]


def common_area(a, b, lines=2000):
    """Integrate the common length of two rings along parallel lines."""
    low, high = min(a[:, 1].min(), b[:, 1].min()), max(a[:, 1].max(), b[:, 1].max())
    step = (high - low) / lines
    y = low + (np.arange(lines) + 0.5) * step
    (p, q), (r, s) = ([end[:, :, None] for end in lines_in(a, y)], lines_in(b, y))
    r, s = r[:, None], s[:, None]
    return np.maximum(np.minimum(q, s) - np.maximum(p, r), 0.0).sum() * step


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(5, 40), st.floats(-2.5, 2.5), st.floats(-2.5, 2.5))
def test_overlap_is_the_common_area_by_that_of_the_union(seed, n, x, y):
    a, b = star(seed, n, (0.0, 0.0)), star(seed + 1, n, (x, y))
    shared = common_area(a, b)
    expected = shared / (common_area(a, a) + common_area(b, b) - shared)
    tilted = np.array([0.3, -0.2, 0.9])
    on_plane = [np.column_stack([ring, -(ring @ tilted[:2]) / tilted[2]]) for ring in (a, b)]
    for order in (1, -1):
        one, other = on_plane[::order]
        (overlap,) = overlaps([one], tilted[None], [other], np.array([[0, 0]]))
        assert overlap == pytest.approx(expected, abs=0.01)


def test_overlap_is_measured_against_the_normal_of_the_first_ring():
    wall = np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 2.0, 1.0], [1.0, 0.0, 1.0]])
    rings = [wall, wall[::-1] + np.array([0.0, 1.0, 0.0]), wall + np.array([0.0, 2.5, 0.0])]
    pairs = np.array([[0, 0], [0, 1], [1, 1], [0, 2]])
    normals = np.array([[-1.0, 0.0, 0.0]] * 3)
    found = overlaps(rings, normals, rings, pairs)
    np.testing.assert_allclose(found, [1.0, 1.0 / 3.0, 1.0, 0.0])


def test_a_ring_that_crosses_itself_has_the_area_that_it_encloses():
    bow = np.array([[0.0, 0.0, 0.0], [2.0, 2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    square = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [1.0, 2.0, 0.0]])
    pairs = np.array([[0, 0]])
    up = np.array([[0.0, 0.0, 1.0]])
    np.testing.assert_allclose(overlaps([bow], up, [square], pairs), [1.0 / 3.0])
