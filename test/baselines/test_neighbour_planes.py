"""Planes by the labels of neighbours (IV.A), against brute force over all pairs of cuboids."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plane_rig import EYE, part_map, scan, sheet, table
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tccm_ros.baselines.neighbour_planes import find_neighbour_planes, label_neighbours
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.records import PlaneKind


def by_brute_force(cuboids, threshold):
    x, y, u = (np.asarray(k, np.int64) for k in (cuboids.ix, cuboids.iy, cuboids.top))
    near = (abs(x[:, None] - x) <= 1) & (abs(y[:, None] - y) <= 1)
    near &= (x[:, None] != x) | (y[:, None] != y)
    near &= abs(u[:, None] - u) < threshold * TICKS_PER_M
    _, label = connected_components(coo_array(near), directed=False)
    _, first, found = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[found]


@given(st.integers(0, 10**6), st.sampled_from([0.003, 0.01, 0.05]))
def test_labels_are_those_of_eight_neighbours(seed, threshold):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.2, -0.2, 0.0], [0.2, 0.2, 0.3], (150, 3))
    cuboids = part_map(points)
    np.testing.assert_array_equal(
        label_neighbours(cuboids, threshold), by_brute_force(cuboids, threshold)
    )


def boards(step):
    """Return a map of two boards side by side with a step in height between them."""
    rng = np.random.default_rng(1)
    low = sheet(rng, 8000, (0.4, -0.3), (0.8, 0.3), offset=0.7)
    high = sheet(rng, 4000, (0.8, -0.3), (1.0, 0.3), offset=0.7 + step)
    return part_map(np.concatenate([low, high]))


@pytest.mark.parametrize(("step", "planes"), [(0.008, 1), (0.012, 2)])
def test_a_step_of_the_height_threshold_parts_two_planes(step, planes):
    fits = find_neighbour_planes(boards(step), Config(), EYE)
    assert len(fits) == planes
    assert all(fit.kind == PlaneKind.HORIZONTAL for fit in fits)
    if planes == 2:
        assert [fit.offset for fit in fits] == pytest.approx([0.7, 0.7 + step], abs=1e-4)
        assert fits[0].area == pytest.approx(0.4 * 0.6, rel=0.05)


@pytest.mark.parametrize("front", [0.0, 0.05, 0.4, 1.1])
def test_a_plane_is_at_u_whatever_the_depth_of_its_cuboids(front):
    """A block whose whole inside is points, as a shelf seen from the front: thin and tall alike."""
    rng = np.random.default_rng(6)
    top = sheet(rng, 8000, (0.4, -0.3), (0.8, 0.3), offset=1.2)
    below = top[rng.integers(0, len(top), 60_000)] - [[0.0, 0.0, 1.0]] * rng.uniform(
        0.0, front, (60_000, 1)
    )
    fit = find_neighbour_planes(part_map(np.concatenate([top, below])), Config(), EYE)[0]
    assert fit.offset == pytest.approx(1.2, abs=1e-4)
    assert fit.rms < 1e-4
    assert fit.area == pytest.approx(0.4 * 0.6, rel=0.05)


def test_a_tilted_board_is_a_horizontal_plane_as_published():
    """No slope is estimated: a rise of 6 mm a cell passes for level, one of 16 mm does not."""
    rng = np.random.default_rng(2)
    for rise, planes in ((0.006, 1), (0.016, 0)):
        normal = (-rise / 0.02, 0.0, 1.0)
        tilted = part_map(sheet(rng, 20_000, (0.4, -0.3), (0.8, 0.3), normal, 0.4))
        fits = find_neighbour_planes(tilted, Config(), EYE)
        assert [fit.normal.tolist() for fit in fits] == [[0.0, 0.0, 1.0]] * planes


def test_a_table_of_one_tilt_cycle_falls_into_strips_as_published():
    points, _ = scan(table(), 0.0, 0)
    points = points[points[:, 0] > 0.52]
    assert len(find_neighbour_planes(part_map(points), Config(), EYE)) > 3
    coarse = part_map(points, cell=0.1)
    assert len(find_neighbour_planes(coarse, Config(), EYE)) == 1


def test_small_groups_are_no_planes():
    config = Config()
    board = part_map(sheet(np.random.default_rng(3), 400, (0.4, 0.0), (0.5, 0.1), offset=0.7))
    assert len(find_neighbour_planes(board, config, EYE)) == 0
    config.planes.min_area = 0.005
    assert len(find_neighbour_planes(board, config, EYE)) == 1
    config.planes.min_points = 401
    assert len(find_neighbour_planes(board, config, EYE)) == 0


def test_an_empty_map_has_no_planes():
    board = part_map(np.zeros((1, 3)))
    nothing = board.select(np.zeros(1, bool))
    assert len(find_neighbour_planes(nothing, Config(), EYE)) == 0
