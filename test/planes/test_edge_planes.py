"""Bands along the rims of surfaces are their edges, not surfaces of their own."""

import numpy as np
import pytest

from tccm_ros.planes.arrays import PLANE, PlaneMap
from tccm_ros.planes.blocks import sort_into_blocks
from tccm_ros.planes.edge_planes import drop_edge_planes

MAX_CELLS = 2  # cells between neighbouring cuboids
MIN_EDGE_FRACTION = 0.8  # of an edge plane's cuboids are beside flatter planes
MIN_VARIANCE_RATIO = 4.0  # of the variances of two planes: half the standard deviation


def sample(rng):
    """Return a random map in small: cuboids in three layers, labels and planes."""
    n = 1200
    ix, iy = rng.integers(0, 40, (2, n)).astype(np.int32)
    first = np.lexsort((iy, ix))
    ix, iy = ix[first], iy[first]
    bottom = (300 * rng.integers(0, 3, n)).astype(np.int32)
    top = bottom + rng.integers(1, 400, n).astype(np.int32)
    labels = (ix // 3 % 5).astype(np.int32) - (rng.random(n) < 0.2) * 9
    labels = np.maximum(labels, -1).astype(np.int32)
    planes = np.zeros(5, PLANE)
    planes["offset"] = np.arange(5)
    planes["variances"][:, 2] = rng.choice([1.0, 1.5, 3.9, 4.1, 20.0], 5) * 1e-6
    return ix, iy, bottom, top, labels, planes, rng.random(5) < 0.2


def kept_by_all_pairs(ix, iy, bottom, top, labels, planes, is_vertical):
    """Return the rows that stay, by looking at all pairs of cuboids."""
    i = np.arange(len(ix))
    beside = (
        (np.abs(ix[:, None] - ix) <= MAX_CELLS) & (np.abs(iy[:, None] - iy) <= MAX_CELLS)
        & (bottom[:, None] <= top) & (top[:, None] >= bottom)
    )  # fmt: skip
    kept, variance = [], planes["variances"][:, 2]
    for p in range(len(planes)):
        flatter = ~is_vertical & (MIN_VARIANCE_RATIO * variance <= variance[p])
        held = i[(labels >= 0) & flatter[labels]]
        own = i[labels == p]
        off = len(own) - beside[np.ix_(own, held)].any(axis=1).sum()
        if is_vertical[p] or not flatter.any() or off > (1.0 - MIN_EDGE_FRACTION) * len(own):
            kept.append(p)
    return kept


@pytest.mark.parametrize("seed", range(60))
def test_dropped_planes_equal_those_of_a_test_of_all_pairs(seed):
    ix, iy, bottom, top, labels, planes, is_vertical = sample(np.random.default_rng(seed))
    kept = kept_by_all_pairs(ix, iy, bottom, top, labels, planes, is_vertical)
    blocks = sort_into_blocks(ix, iy)
    none = np.zeros((0, 10))
    cuboids = PlaneMap(none, ix, iy, bottom, top, ix[:0], none, 200.0, 1e-4, np.zeros(3))
    after = labels.copy()
    left = drop_edge_planes(cuboids, blocks, after, planes, is_vertical)
    assert left["offset"].astype(int).tolist() == kept
    number = {p: k for k, p in enumerate(kept)}
    assert after.tolist() == [number.get(p, -1) for p in labels.tolist()]


def test_random_samples_have_edge_planes_and_others():
    kept = [len(kept_by_all_pairs(*sample(np.random.default_rng(seed)))) for seed in range(60)]
    assert min(kept) < 5
    assert kept.count(5) > 5
