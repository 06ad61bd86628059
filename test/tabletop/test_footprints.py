"""Hulls, rectangles, distances and clusters against plain libraries."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from shapely import Polygon

from tccm_ros.tabletop.footprints import (
    LooseCuboids,
    cluster_footprints,
    convex_hull,
    cuboids_above,
    rectangle,
)

SEEDS = st.integers(0, 2**32 - 1)


@settings(deadline=None)
@given(SEEDS, st.integers(3, 60), st.booleans())
def test_hull_is_the_convex_hull_of_shapely(seed, n, coarse):
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 5, (n, 2)).astype(float) if coarse else rng.normal(size=(n, 2))
    expected = shapely.convex_hull(shapely.multipoints(points))
    hull = convex_hull(points)
    if not isinstance(expected, Polygon):
        assert len(hull) < 3
        return
    assert Polygon(hull).exterior.is_ccw
    assert Polygon(hull).symmetric_difference(expected).area < 1e-9
    assert len(hull) == len(expected.exterior.coords) - 1


@settings(deadline=None)
@given(SEEDS, st.integers(3, 60))
def test_rectangle_is_the_smallest_around_the_hull(seed, n):
    hull = convex_hull(np.random.default_rng(seed).normal(size=(n, 2)))
    x, y, length, width, yaw = rectangle(hull)
    smallest = shapely.minimum_rotated_rectangle(Polygon(hull))
    assert length * width == pytest.approx(smallest.area)
    assert length >= width
    assert -np.pi / 2 < yaw <= np.pi / 2
    local = (hull - (x, y)) @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    np.testing.assert_allclose(np.abs(local).max(axis=0), (length / 2, width / 2))


@settings(deadline=None)
@given(SEEDS, st.integers(0, 80), st.floats(0.02, 0.5))
def test_clusters_are_the_connected_components(seed, n, gap):
    rng = np.random.default_rng(seed)
    mean = rng.uniform(0.0, 2.0, (n + 5, 3))
    chosen = np.sort(rng.permutation(n + 5)[:n])
    members, starts = cluster_footprints(mean, chosen, gap)
    pairs = cKDTree(mean[chosen, :2]).query_pairs(gap, output_type="ndarray") if n else []
    graph = coo_array((np.ones(len(pairs)), tuple(np.reshape(pairs, (-1, 2)).T)), shape=(n, n))
    count, label = connected_components(graph, directed=False) if n else (0, np.zeros(0, int))
    assert len(starts) == count + 1
    for k in range(count):
        np.testing.assert_array_equal(members[starts[k] : starts[k + 1]], chosen[label == k])


def test_cuboids_above_a_plane_lie_within_the_hull_and_high_enough():
    rng = np.random.default_rng(0)
    mean = rng.uniform(-1.0, 2.0, (500, 3))
    mean = mean[np.argsort(np.floor(mean[:, 0] / 0.02), kind="stable")]
    column = np.floor(mean[:, 0] / 0.02).astype(np.int64)
    hull = np.array([[0.0, 0.0], [1.0, 0.0], [1.2, 0.8], [0.3, 1.0]])
    normal, offset = np.array([0.0, 0.0, 1.0]), 0.5
    free = rng.random(500) < 0.8
    loose = LooseCuboids(column, np.ones(500), mean, mean, mean + 0.01, free, 0.02)
    found = cuboids_above(loose, hull, normal, offset, 0.05)
    expected = free & (mean[:, 2] + 0.01 - 0.5 >= 0.05)
    expected &= shapely.contains_xy(Polygon(hull), mean[:, 0], mean[:, 1])
    np.testing.assert_array_equal(found, np.flatnonzero(expected))
    assert len(found) > 10
