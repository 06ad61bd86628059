"""Merging as published: against the distances of all pairs of points."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from tccm_ros.baselines.distance_merging import merge_by_distance


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 12))
def test_merged_clouds_equal_those_of_brute_force(seed, count):
    rng = np.random.default_rng(seed)
    flat = [1.0, 1.0, 0.1]
    middles = rng.uniform(0.0, 1.5, (count, 3)) * flat
    clouds = [middle + rng.uniform(-0.2, 0.2, (40, 3)) * flat for middle in middles]
    root = np.arange(count)
    for _ in range(count):
        for a in range(count):
            for b in range(a):
                if cdist(clouds[a], clouds[b]).min() <= 0.05:
                    root[root == max(root[a], root[b])] = min(root[a], root[b])
    np.testing.assert_array_equal(merge_by_distance(clouds, 0.05), root)


def test_clouds_at_exactly_the_distance_are_merged():
    distance = 0.0625  # exact in binary, so that the squared distance is exact too
    ends = [distance, np.nextafter(distance, 1.0)]
    pairs = [[np.zeros((1, 3)), np.array([[x, 0.0, 0.0]])] for x in ends]
    assert [merge_by_distance(pair, distance).tolist() for pair in pairs] == [[0, 0], [0, 1]]


def test_no_clouds_give_no_surfaces():
    assert len(merge_by_distance([], 0.05)) == 0
