"""Scan lines are found in points: their direction."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.surfaces.views.scan_lines import line_direction

SPACING = 0.08


def lines(yaw, step, sigma, seed):
    """Points of 8 lines of 0.8 m with beams each `step`, m, with noise, m, in any order."""
    rng = np.random.default_rng(seed)
    at = np.arange(0.0, 0.8, step)
    x = (at + step * rng.random((8, 1))).ravel()
    y = np.repeat(SPACING * np.arange(8), len(at))
    c, s = np.cos(yaw), np.sin(yaw)
    points = np.column_stack([c * x - s * y, s * x + c * y]) + rng.normal(0.0, sigma, (len(x), 2))
    return rng.permutation(points), np.array([c, s])


@given(st.floats(0.0, np.pi), st.sampled_from([0.01, 0.02, 0.04]), st.integers(0, 2**32 - 1))
def test_lines_have_their_direction(yaw, step, seed):
    points, along = lines(yaw, step, 0.002, seed)
    found = line_direction(points, SPACING)
    assert abs(found @ along) > np.cos(0.08)


def test_points_without_lines_have_no_direction():
    points = np.random.default_rng(4).uniform(0.0, 0.5, (900, 2))
    assert line_direction(points, 0.02) is None


def test_one_point_has_no_direction():
    assert line_direction(lines(0.3, 0.02, 0.0, 1)[0][:1], SPACING) is None
