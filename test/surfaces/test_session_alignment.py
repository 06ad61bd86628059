"""The free space of views, which aligns sessions: open columns and their frontier, one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.records import ViewIntervals
from tccm_ros.surfaces.session_alignment import (
    BAND,
    CELL,
    MIN_FREE_FRACTION,
    _fit,
    _free_space,
    _frontier,
    _open_cells,
    _raster,
)
from tccm_ros.surfaces.views import empty_view, with_intervals

SEEDS = st.integers(0, 2**32 - 1)
SIZE = Config().views.cell_size


def view_of(cells, low, high):
    """Return a view with one free interval in each column."""
    middle = (np.asarray(cells).reshape(-1, 2) + 0.5) * SIZE
    rows = np.column_stack([middle, low, high]).astype(np.float32)
    return with_intervals(empty_view(1, 0, Config()), ViewIntervals(1, "base", rows))


@given(SEEDS)
def test_open_columns_are_free_over_a_fraction_of_the_band(seed):
    rng = np.random.default_rng(seed)
    cells = np.unique(rng.integers(-12, 12, (80, 2)), axis=0)
    low = rng.uniform(0.0, 1.0, len(cells))
    high = low + rng.uniform(0.1, 1.8, len(cells))
    inside = np.minimum(high, BAND[1]) - np.maximum(low, BAND[0])
    expected = cells[inside >= MIN_FREE_FRACTION * (BAND[1] - BAND[0])]
    found = _open_cells(view_of(cells, low, high), 0.0)
    assert sorted(map(tuple, found.tolist())) == sorted(map(tuple, expected.tolist()))


@given(SEEDS)
def test_the_frontier_is_what_is_first_behind_open_columns(seed):
    """Along the ray from the base through the middle of an open column, one column further."""
    rng = np.random.default_rng(seed)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-9, 9), np.arange(-9, 9)))
    cells = np.column_stack([x, y])[np.hypot(x + 0.5, y + 0.5) < rng.uniform(3.0, 12.0)]
    cells = cells[rng.random(len(cells)) < 0.9]
    border = np.abs(cells + 0.5).max()
    expected = set()
    for cell in cells:
        ray = (cell + 0.5) / np.hypot(*(cell + 0.5))
        behind = np.floor(cell + 0.5 + ray).astype(int)
        if not np.any(np.all(cells == behind, axis=1)) and np.abs(behind + 0.5).max() < border:
            expected.add(tuple(behind.tolist()))
    assert set(map(tuple, _frontier(cells, SIZE).tolist())) == expected


def test_free_space_is_that_of_all_views_where_they_stand():
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-9, 9), np.arange(-9, 9)))
    disc = np.column_stack([x, y])[np.hypot(x + 0.5, y + 0.5) < 7.0]
    view = view_of(disc, np.zeros(len(disc)), np.full(len(disc), 2.0))
    c, s = np.cos(0.4), np.sin(0.4)
    T = np.array([[c, -s, 0, 3.0], [s, c, 0, -1.0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    found = _free_space([view, view], np.array([np.eye(4), T]), 0.0)
    own = (disc + 0.5) * SIZE
    behind = (_frontier(disc, SIZE) + 0.5) * SIZE
    for points, one in ((found.open, own), (found.frontier, behind)):
        expected = np.concatenate([one, one @ [[c, s], [-s, c]] + [3.0, -1.0]])
        assert np.sort(points, axis=0) == pytest.approx(np.sort(expected, axis=0), abs=1e-6)
    nothing = _free_space([], np.zeros((0, 4, 4)), 0.0)
    assert nothing.open.shape == nothing.frontier.shape == (0, 2)


def test_points_are_counted_in_the_cells_of_a_raster_and_not_beside_it():
    points = np.array([[0.05, 0.05], [0.06, 0.01], [0.25, 0.31], [-0.01, 0.1], [0.1, 0.41]])
    expected = np.zeros((3, 4))
    expected[0, 0], expected[2, 3] = 2.0, 1.0
    assert CELL == 0.1
    assert _raster(points, np.zeros(2), (3, 4)).tolist() == expected.tolist()


@given(SEEDS)
def test_a_fit_finds_the_pose_that_moved_points(seed):
    rng = np.random.default_rng(seed)
    pose = rng.uniform(-1.0, 1.0, 3) * [2.0, 2.0, 3.0]
    source = rng.uniform(-3.0, 3.0, (20, 2))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    target = source @ [[c, s], [-s, c]] + pose[:2]
    assert _fit(source, target, rng.uniform(0.1, 1.0, 20)) == pytest.approx(pose, abs=1e-9)
