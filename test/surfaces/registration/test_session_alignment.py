"""Sessions are aligned by the free space of views: its frontier, and rooms with known poses."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2, inverse2, planar, spatial, transform2
from tccm_ros.records import ViewIntervals
from tccm_ros.surfaces.registration.session_alignment import (
    AlignmentResult,
    _frontier,
    _keyframes,
    _open_cells,
    align_session,
)
from tccm_ros.surfaces.views.views import empty_view, with_intervals

BAND = (0.3, 1.6)  # m above the floor, where an open column is free
MAJORITY = 0.5  # of the whole

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
    expected = cells[inside >= MAJORITY * (BAND[1] - BAND[0])]
    found = _open_cells(view_of(cells, low, high), 0.0)
    assert sorted(map(tuple, found.tolist())) == sorted(map(tuple, expected.tolist()))


@given(SEEDS)
def test_frontier_is_the_first_cell_behind_open_columns(seed):
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


def test_each_view_with_free_space_is_a_keyframe_with_its_frontier_as_scan():
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-9, 9), np.arange(-9, 9)))
    disc = np.column_stack([x, y])[np.hypot(x + 0.5, y + 0.5) < 7.0]
    view = view_of(disc, np.zeros(len(disc)), np.full(len(disc), 2.0))
    blind = view_of(disc[:0], np.zeros(0), np.zeros(0))
    poses = np.array([[0.0, 0.0, 0.0], [9.0, 9.0, 0.0], [3.0, -1.0, 0.4]])
    found = _keyframes([view, blind, view], spatial(poses), 0.0)
    assert [k.id for k in found] == [0, 1]
    assert np.array([k.pose for k in found]) == pytest.approx(poses[[0, 2]])
    behind = (_frontier(disc, SIZE) + 0.5) * SIZE
    for keyframe in found:
        assert np.sort(keyframe.scan.beams, axis=0) == pytest.approx(np.sort(behind, axis=0))
        assert (np.diff(np.arctan2(*keyframe.scan.beams.T[::-1])) >= 0.0).all(), "in beam order"


L_SHAPE = shapely.box(0, 0, 7, 4).union(shapely.box(0, 0, 3, 6.5)) - shapely.box(4.4, 0, 5.2, 1)
"""A room with a column at a wall, m."""

OTHER = shapely.box(0, 0, 5, 7) - shapely.box(0, 2.5, 1.4, 3.2) - shapely.box(3, 5.5, 5, 7)
SQUARE = shapely.box(0, 0, 5, 5)
MAX_M, MAX_RAD = SIZE, np.radians(2.0)
"""A column, over three metres."""


def view_in(room, pose):
    """Return a view of the columns that are seen from a planar pose in a room."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-70, 70), np.arange(-70, 70)))
    cells = np.column_stack([x, y])
    seen = transform2(pose, (cells + 0.5) * SIZE)
    lines = shapely.linestrings(np.stack([np.broadcast_to(pose[:2], seen.shape), seen], axis=1))
    cells = cells[shapely.covers(room, lines)]
    return view_of(cells, np.zeros(len(cells)), np.full(len(cells), 2.0))


def aligned(room, poses, other, other_poses, T_session_map):
    """Align views in a room with those in another one, by poses in the session's frame."""
    poses, other_poses = np.array(poses, float), np.array(other_poses, float)
    new = spatial(compose2(T_session_map, other_poses))
    views = [view_in(room, pose) for pose in poses]
    others = [view_in(other, pose) for pose in other_poses]
    return align_session(views, spatial(poses), others, new, Config())


HERE, THERE = [(1.2, 1.0, 0.3), (3.6, 2.8, 1.0)], [(2.0, 4.5, -1.0), (1.8, 2.2, 2.0)]


@given(st.floats(-np.pi, np.pi), st.floats(-20.0, 20.0))
@settings(max_examples=5, deadline=None)
def test_a_session_in_the_room_of_the_map_is_found_in_any_frame(yaw, x):
    T = np.array([x, -3.0, yaw])
    found = aligned(L_SHAPE, HERE, L_SHAPE, THERE, T)
    assert found.found
    assert abs(between2(inverse2(T), planar(found.T_map_session))[2]) < MAX_RAD
    # At the room, as the frame of the session may be far from it.
    middle = compose2(T, np.array([2.0, 3.0, 0.0]))
    at = compose2(planar(found.T_map_session), middle)
    assert np.hypot(*(at[:2] - [2.0, 3.0])) < MAX_M


def test_another_room_and_two_possible_poses_are_refused():
    assert not aligned(L_SHAPE, HERE, OTHER, [(2.5, 1.5, 0.0), (2.5, 4.5, 1.0)], np.zeros(3)).found
    square = aligned(SQUARE, [(1.8, 2.9, 0.2)], SQUARE, [(2.2, 2.0, 1.0)], np.zeros(3))
    assert square.result is AlignmentResult.AMBIGUOUS


def test_a_view_with_hardly_any_frontier_is_not_aligned():
    few = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    view = view_of(few, np.zeros(4), np.full(4, 2.0))
    T = np.eye(4)[None]
    found = align_session([view], T, [view_in(SQUARE, np.array([1.8, 2.9, 0.2]))], T, Config())
    assert found.result is AlignmentResult.TOO_FEW_ENDS
