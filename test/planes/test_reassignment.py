"""Cuboids that two planes could hold: boards before a wall keep their rears, the wall its rows."""

import numpy as np
import pytest
from plane_rig import EYE, part_map

from tccm_ros.config import Config
from tccm_ros.planes import find_planes
from tccm_ros.planes.arrays import PLANE
from tccm_ros.planes.blocks import sort_into_blocks
from tccm_ros.planes.reassignment import (
    horizontal_planes_around,
    horizontal_planes_by_block,
    reassign_inliers,
)

GATE = 3.0  # sigmas: 99.7 % of all measurements
INLIER_GATE = 4.0  # sigmas of an inlier: one point of a plane in 16,000 is further away
MIN_VARIANCE_RATIO = 4.0  # of the variances of two planes: half the standard deviation

CONFIG = Config()
SIGMA = 0.003


def grid(x, y, z, noise, rng):
    """Return points of a rectangle, one of x, y, z a number: its noise is across."""
    axes = [np.atleast_1d(a) for a in (x, y, z)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    flat = [len(a) for a in axes].index(1)
    points[:, flat] += rng.normal(0.0, noise, len(points))
    return points


def shelf(rng, depth):
    """Return points of a wall, and of three boards that stand against it, `depth` of them seen."""
    y = np.arange(-0.5, 0.5, 0.006)
    wall = grid(1.9, y, np.arange(0.1, 1.4, 0.022), SIGMA, rng)
    boards = [grid(np.arange(1.9 - depth, 1.9, 0.012), y, z, SIGMA, rng) for z in (0.42, 0.8, 1.2)]
    return wall, np.concatenate(boards)


def kinds_of(points, cuboids, fits):
    """Return the fractions of points that lie in cuboids of horizontal and of vertical planes."""
    cell = np.floor(points[:, :2] / cuboids.cell_size + 1e-9).astype(int)
    lookup = {}
    for k in range(len(cuboids)):
        lookup.setdefault((int(cuboids.ix[k]), int(cuboids.iy[k])), []).append(k)
    horizontal = vertical = 0
    for (x, y), z in zip(cell, 1e4 * points[:, 2], strict=True):
        for k in lookup.get((x, y), ()):
            if cuboids.bottom[k] <= z <= cuboids.top[k] + 1 and fits.labels[k] >= 0:
                is_horizontal = fits[fits.labels[k]].kind == "horizontal"
                horizontal, vertical = horizontal + is_horizontal, vertical + (not is_horizontal)
    return horizontal / len(points), vertical / len(points)


@pytest.mark.parametrize("depth", [0.15, 0.3])
def test_boards_and_the_wall_behind_keep_their_own_cuboids(depth):
    wall, boards = shelf(np.random.default_rng(0), depth)
    cuboids = part_map(np.concatenate([wall, boards]))
    fits = find_planes(cuboids, CONFIG, EYE)
    rear = boards[(boards[:, 0] > 1.84) & (boards[:, 0] < 1.88)]
    horizontal, _ = kinds_of(rear, cuboids, fits)
    assert horizontal > 0.9
    _, vertical = kinds_of(wall[np.abs(wall[:, 1]) < 0.45], cuboids, fits)
    assert vertical > 0.85


def test_support_is_the_points_of_the_labelled_cuboids():
    rng = np.random.default_rng(1)
    cuboids = part_map(np.concatenate(shelf(rng, 0.25)))
    fits = find_planes(cuboids, CONFIG, EYE)
    for k, fit in enumerate(fits):
        assert fit.support == cuboids.count[fits.labels == k].sum()


def plain_reassignment(points, labels, planes, is_vertical):
    """Return the labels by the rule alone, for cuboids of one point in one block."""
    labels = labels.copy()
    for q in np.flatnonzero(~is_vertical):
        if not (labels == q).any():
            continue
        for i, p in enumerate(labels):
            if p < 0 or not is_vertical[p]:
                continue
            to_q, to_p = (points[i] @ planes["normal"][k] - planes["offset"][k] for k in (q, p))
            variance = planes["variances"][q, 2]
            near = abs(to_q) <= INLIER_GATE * variance**0.5
            if near and to_p**2 > max(GATE**2 * variance, MIN_VARIANCE_RATIO * to_q**2):
                labels[i] = q
    return labels


@pytest.mark.parametrize("seed", range(20))
def test_reassignment_equals_a_rule_on_distances_of_points(seed):
    rng = np.random.default_rng(seed)
    n, planes = 40, np.zeros(3, PLANE)
    planes["normal"], planes["offset"] = [(0, 0, 1), (1, 0, 0), (0, 0, 1)], (0, 0, 0.02)
    planes["variances"][:, 2] = rng.uniform(0.002, 0.006, 3) ** 2
    points = rng.uniform(-0.03, 0.03, (n, 3))
    labels = rng.integers(-1, 3, n).astype(np.int32)
    planes["support"] = [(labels == k).sum() for k in range(3)]
    is_vertical = np.array([False, True, False])
    products = np.stack([points[:, i] * points[:, j] for i in range(3) for j in range(i, 3)], 1)
    M = np.column_stack([np.ones(n), points, products])
    cells = np.zeros(n, np.int32)
    blocks = sort_into_blocks(cells, cells)
    expected = plain_reassignment(points, labels, planes, is_vertical)
    had = planes["support"][1]
    left = reassign_inliers(M, blocks, labels, planes, is_vertical)
    if (expected == 1).sum() < 0.5 * had:  # it lost too much, and is gone
        number = np.array([0, -1, 1, -1])
        expected = number[expected]
        assert len(left) == 2
    else:
        assert len(left) == 3
    np.testing.assert_array_equal(labels, expected)
    counts = [(labels == k).sum() for k in range(len(left))]
    np.testing.assert_array_equal(left["support"], counts)


@pytest.mark.parametrize("seed", range(20))
def test_horizontal_planes_around_a_block_are_those_of_its_cells(seed):
    rng = np.random.default_rng(seed)
    n, planes, rows, wide = 120, 6, 4, 5
    x, y = rng.integers(0, 4 * rows, n), rng.integers(0, 4 * wide, n)
    x[:2], y[:2] = (0, 4 * rows - 1), (0, 4 * wide - 1)
    order = np.lexsort((y, x))
    x, y = x[order].astype(np.int32), y[order].astype(np.int32)
    labels = rng.integers(-1, planes, n).astype(np.int32)
    is_vertical = rng.random(planes) < 0.5
    blocks = sort_into_blocks(x, y)
    assert (blocks.rows, blocks.wide, blocks.low_x, blocks.low_y) == (rows, wide, 0, 0)
    first, horizontal, is_held = horizontal_planes_by_block(blocks, labels, is_vertical)
    near = np.empty(planes, np.int32)
    for b in range(rows * wide):
        inside = (x // 4 == b // wide) & (y // 4 == b % wide) & (labels >= 0)
        assert is_held[b] == is_vertical[labels[inside]].any()
        around = (abs(x // 4 - b // wide) <= 1) & (abs(y // 4 - b % wide) <= 1) & (labels >= 0)
        expected = sorted({int(p) for p in labels[around] if not is_vertical[p]})
        count = horizontal_planes_around(b, blocks, first, horizontal, near)
        assert near[:count].tolist() == expected
