"""Compiled loops over measured points do what numpy does."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.sensors.measured import kept_rows, mark_within

coordinates = st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0, np.nan, np.inf, -np.inf])
points = st.lists(st.tuples(coordinates, coordinates, coordinates), max_size=12).map(
    lambda rows: np.array(rows, float).reshape(-1, 3)
)


@settings(max_examples=100, deadline=None)
@given(points, points.filter(lambda p: len(p) > 1))
def test_points_within_a_box_are_those_of_numpy(points, corners):
    low, high = corners[0], corners[1]
    expected = ((points >= low) & (points <= high)).all(axis=1)
    assert np.array_equal(mark_within(points, low, high), expected)


@settings(max_examples=100, deadline=None)
@given(points, st.integers(0, 2**12 - 1))
def test_the_rows_that_are_kept_are_those_of_numpy(points, bits):
    keep = np.array([bits >> k & 1 for k in range(len(points))], bool)
    assert np.array_equal(kept_rows(points, keep), points[keep], equal_nan=True)
