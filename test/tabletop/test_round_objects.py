"""Footprints of vertical cylinders and of boxes, seen whole or from one side."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.tabletop.footprints import convex_hull
from tccm_ros.tabletop.round_objects import round_footprint

NOISE = 0.003
"""Of the points, m, one sigma."""

SEEDS = st.integers(0, 2**32 - 1)


def hull_of(points, rng):
    """Return the convex hull of points with noise."""
    return convex_hull(points + rng.normal(0.0, NOISE, points.shape))


@settings(deadline=None)
@given(SEEDS, st.floats(0.04, 0.12), st.floats(1.05 * np.pi, 2.0 * np.pi))
def test_cylinder_seen_from_one_side_has_its_diameter_and_axis(seed, radius, arc):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi) + np.arange(0.0, arc, 0.01 / radius)
    points = [1.2, -0.7] + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    circle = round_footprint(hull_of(points, rng))
    assert circle is None or circle.radius == pytest.approx(radius, abs=4 * NOISE)
    if circle is not None:
        assert np.hypot(circle.x - 1.2, circle.y + 0.7) < 4 * NOISE
    else:
        assert arc < 1.5 * np.pi or radius < 0.06, "noise is a tenth of the smallest radius"


@settings(deadline=None)
@given(SEEDS, st.floats(0.08, 0.3), st.floats(0.5, 1.0), st.integers(2, 4))
def test_a_box_of_which_two_sides_or_more_were_seen_is_not_round(seed, length, ratio, sides):
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, 40)
    corners = 0.5 * length * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * [1, ratio]
    seen = [corners[k] + t[:, None] * (corners[k + 1] - corners[k]) for k in range(sides)]
    yaw = rng.uniform(-np.pi, np.pi)
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    assert round_footprint(hull_of(np.concatenate(seen) @ R.T, rng)) is None


def test_a_single_side_is_not_round():
    rng = np.random.default_rng(0)
    side = np.column_stack([np.linspace(0.0, 0.3, 40), np.zeros(40)])
    assert round_footprint(hull_of(side, rng)) is None
