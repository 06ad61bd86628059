"""Which cuboids of a plane are labelled: those near it on the mean, and that scatter as it does."""

from types import SimpleNamespace

import numpy as np
import pytest

from tccm_ros.planes.search import label_members, queue_region

GATE = 4.0  # sigmas of an inlier: one point of a plane in 16,000 is further away

HEIGHT, SIGMA, COUNT = 0.7, 0.001, 10


def moments(heights):
    """Return the moments of points above each other, float64 (10,)."""
    z = np.asarray(heights, float)
    return np.array([len(z), 0.0, 0.0, z.sum(), 0.0, 0.0, 0.0, 0.0, 0.0, (z * z).sum()])


def labelled(last):
    """Return the labels and points of 60 cuboids with noise `SIGMA` and of one more cuboid."""
    noise = SIGMA * np.resize([-1.0, 1.0], COUNT)
    M = np.array([moments(HEIGHT + noise)] * 60 + [moments(last)])
    cuboids = SimpleNamespace(M=M, ix=np.arange(61, dtype=np.int32), iy=np.zeros(61, np.int32))
    labels = np.full(61, -1, np.int32)
    members = np.arange(61, dtype=np.int32)
    plane = (0.0, 0.0, 1.0, HEIGHT, SIGMA**2)
    points = label_members.py_func(cuboids, members, plane, labels, 4)
    assert set(labels[:60]) == {4}
    return labels[60] == 4, points


@pytest.mark.parametrize(
    ("offset", "scatter", "is_member"),
    [
        (0.0, SIGMA, True),
        (GATE * SIGMA * 0.9, 0.0, True),
        (GATE * SIGMA * 1.5, 0.0, False),
        (-GATE * SIGMA * 1.5, 0.0, False),
        (0.0, GATE * SIGMA * 0.9, True),
        (0.0, GATE * SIGMA * 1.5, False),
    ],
)
def test_a_cuboid_far_off_on_the_mean_or_scattered_wide_is_no_member(offset, scatter, is_member):
    """The last one is 1 of 61: it raises the plane's deviation, so the gate, by up to a quarter."""
    heights = HEIGHT + offset + scatter * np.resize([-1.0, 1.0], COUNT)
    assert labelled(heights) == (is_member, 60 * COUNT + is_member * COUNT)


def test_a_region_is_searched_in_its_blocks_and_a_margin_of_their_width():
    """A patch of 2 by 2 blocks in the middle of 7 by 6, beside one block in a corner."""
    rows, wide = 7, 6
    place = np.array([[1, 1, 1], [0, 6, 0]], np.int32)
    flood = SimpleNamespace(queue=np.full(99, -1), stamp=np.zeros(rows * wide, np.int64))
    blocks = SimpleNamespace(rows=rows, wide=wide)
    queued = queue_region.py_func(np.arange(2, dtype=np.int32), place, blocks, flood, 1)
    wanted = {x * wide + y for x in range(6) for y in range(6)} | {6 * wide}
    assert queued == len(wanted)
    assert set(flood.queue[:queued].tolist()) == wanted
