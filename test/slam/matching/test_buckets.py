import numpy as np
import pytest

from tccm_ros.slam.matching.buckets import extent_near_median, sort_into_buckets

BUCKET = 0.30  # m, edge of a bucket


@pytest.mark.parametrize("half", [1.0, 3.0, 100.0])
def test_only_points_far_from_the_median_are_left_out(half):
    points = np.random.default_rng(1).normal(size=(200, 2))
    near, low, high = extent_near_median(points, half)
    away = np.abs(points - np.median(points, axis=0)).max(axis=1)
    assert np.array_equal(points[near], points[away < half])
    assert np.array_equal(low, points[near].min(axis=0))
    assert np.array_equal(high, points[near].max(axis=0))


def test_a_bucket_holds_the_points_within_it_in_their_order():
    points = np.random.default_rng(2).uniform(0.0, 2.0, size=(300, 2))
    order, starts = sort_into_buckets(points, np.zeros(2), np.array([8, 8]))
    assert sorted(order) == list(range(300))
    for cell in np.ndindex(8, 8):
        first, last = starts[cell]
        inside = np.flatnonzero(np.all(np.floor(points / BUCKET) == cell, axis=1))
        assert np.array_equal(order[first:last], inside)
