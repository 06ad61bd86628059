"""Carving again after poses moved a little equals carving from the start; grids equal columns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.geometry import pose_from_rpy, transform
from tccm_ros.records import SurfaceCloud, ViewIntervals
from tccm_ros.surfaces.merging.carving import Carver, _in_block, _rpy, _with_strays, carve
from tccm_ros.surfaces.merging.free_grid import FreeGrid, blocks_of
from tccm_ros.surfaces.views.views import empty_view, with_cloud, with_intervals

MAJORITY = 0.5  # of the whole
MAX_FRACTION = 0.05  # of a surface's points, without evidence of it
STEP_M = 0.002  # m, to which relative positions of views are rounded

CONFIG = Config()
VIEWS = 5


def random_view(rng, stamp_ns):
    """Return a view of some tables at random places, and of the free space over and beside them."""
    points, surface = [], []
    for k in range(int(rng.integers(1, 4))):
        x, y = np.meshgrid(np.arange(0.0, 0.6, 0.04), np.arange(0.0, 0.5, 0.04))
        x, y = x.ravel() + rng.uniform(-1.5, 1.0), y.ravel() + rng.uniform(-1.5, 1.0)
        z = rng.choice([0.4, 0.7, 0.75]) + rng.normal(0.0, 0.002, len(x))
        points.append(np.column_stack([x, y, z]))
        surface.append(np.full(len(x), k, np.uint32))
    points = np.concatenate(points).astype(np.float32)
    cloud = SurfaceCloud(stamp_ns, "base", points, np.concatenate(surface))
    corners = np.stack(np.meshgrid(*[np.arange(-2.0, 2.0, 0.1)] * 2), axis=-1).reshape(-1, 2) + 0.05
    corners = corners[rng.random(len(corners)) < 0.8]
    low = rng.choice([0.05, 0.5, 0.8], len(corners))
    rows = np.column_stack([corners, low, np.full(len(corners), 1.2)]).astype(np.float32)
    view = with_cloud(empty_view(stamp_ns, 0, CONFIG), cloud, CONFIG)
    return with_intervals(view, ViewIntervals(stamp_ns, "base", rows))


def random_poses(rng, count):
    spread = np.array([0.5, 0.5, 0.01, 0.005, 0.005, 1.5])
    rows = rng.normal(size=(count, 6)) * spread
    rows[rng.random(count) < 0.5] = 0.0  # some views are from one place
    return np.array([pose_from_rpy(row) for row in rows])


def assert_same(a, b):
    assert a.replaced_by == b.replaced_by
    for masks, others in zip(a.keep, b.keep, strict=True):
        for mask, other in zip(masks, others, strict=True):
            assert np.array_equal(mask, other)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_cached_carving_equals_fresh_carving(seed):
    """Views come one after the other; poses move by less and by more than a step; one is gone."""
    rng = np.random.default_rng(seed)
    carver = Carver(CONFIG)
    views = [random_view(rng, k + 1) for k in range(VIEWS)]
    T = random_poses(rng, VIEWS)
    for count in range(2, VIEWS + 1):
        assert_same(carver.carve(views[:count], T[:count]), carve(views[:count], T[:count], CONFIG))
    moved = T.copy()
    moved[1, 0, 3] += rng.choice([1e-5, 0.3]) * rng.uniform(0.1, 1.0)
    assert_same(carver.carve(views, moved), carve(views, moved, CONFIG))
    again = random_view(rng, 2)
    changed = [views[0], again, *views[3:]]
    assert_same(
        carver.carve(changed, moved[[0, 1, 3, 4]]), carve(changed, moved[[0, 1, 3, 4]], CONFIG)
    )


def test_only_pairs_with_a_new_or_moved_view_are_looked_at():
    rng = np.random.default_rng(1)
    views, T = [random_view(rng, k + 1) for k in range(VIEWS)], np.stack([np.eye(4)] * VIEWS)
    T[:, 0, 3] = 0.3 * np.arange(VIEWS)
    carver = Carver(CONFIG)
    carver.carve(views[:-1], T[:-1])
    assert carver.compared == (VIEWS - 1) * (VIEWS - 2) // 2
    carver.carve(views, T)
    assert carver.compared == VIEWS - 1
    T[2, 0, 3] += 10.0 * STEP_M
    carver.carve(views, T)
    assert carver.compared == VIEWS - 1
    carver.carve(views, T)
    assert carver.compared == 0


def test_results_of_a_repeated_pose_are_cached():
    rng = np.random.default_rng(3)
    views, T = [random_view(rng, k + 1) for k in range(3)], random_poses(rng, 3)
    moved = T.copy()
    moved[1, 0, 3] += 10.0 * STEP_M
    carver = Carver(CONFIG)
    for poses in (T, moved):
        carver.carve(views, poses)
    for poses in (T, moved, T):
        assert_same(carver.carve(views, poses), carve(views, poses, CONFIG))
        assert carver.compared == 0


def test_callers_with_different_views_use_one_carver():
    rng = np.random.default_rng(4)
    views, T = [random_view(rng, k + 1) for k in range(VIEWS)], random_poses(rng, VIEWS)
    carver = Carver(CONFIG)
    for _ in range(8):
        for first in (0, 2):
            some = views[first:], T[first:]
            assert_same(carver.carve(*some), carve(*some, CONFIG))
    assert carver.compared == 0
    for _ in range(5):
        carver.carve(views[2:], T[2:])
    carver.carve(views, T)
    assert carver.compared > 0


def test_changed_parameter_clears_the_cache():
    rng = np.random.default_rng(2)
    views, T = [random_view(rng, k + 1) for k in range(3)], random_poses(rng, 3)
    config = Config()
    carver = Carver(config)
    carver.carve(views, T)
    config.views.clear_margin = 0.0
    left = carver.carve(views, T)
    assert carver.compared > 0
    assert_same(left, carve(views, T, config))


@pytest.mark.parametrize("seed", range(5))
def test_a_grid_answers_as_its_columns(seed):
    rng = np.random.default_rng(seed)
    rows = np.column_stack([rng.uniform(-2.0, 2.0, (300, 2)), np.zeros((300, 2))])
    rows[:, 2] = rng.uniform(0.0, 1.0, 300)
    rows[:, 3] = rows[:, 2] + rng.uniform(0.0, 0.5, 300)
    free = FreeColumns.of(ViewIntervals(1, "base", rows.astype(np.float32)), 0.1)
    points = rng.uniform((-2.5, -2.5, -0.2), (2.5, 2.5, 1.6), (4000, 3)).astype(np.float32)
    T = pose_from_rpy([0.3, -0.2, 0.05, 0.01, -0.02, 0.7])
    moved, through, margin = FreeGrid.of(free).look(points, T, 2.0, (0.02, 0.006))
    expected = transform(T, points)
    distance = np.hypot(expected[:, 0], expected[:, 1])
    is_near = distance <= 2.0
    assert np.allclose(moved, expected, atol=1e-12)
    assert np.allclose(margin, np.where(is_near, 0.02 + 0.006 * distance, -1.0))
    inside = free.contains(moved, 0.02 + 0.006 * distance) & is_near
    assert np.array_equal(through, inside)
    assert 0 < inside.sum() < len(inside)


@pytest.mark.parametrize("seed", range(3))
def test_blocks_leave_out_no_points_that_count(seed):
    """Small patches at any height and tilt; blocks decide for most that none of them counts."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(0.0, 1.0, (300, 1))
    rows = np.hstack([rng.uniform(-2.0, 2.0, (300, 2)), low, low + 0.3]).astype(np.float32)
    grid = FreeGrid.of(FreeColumns.of(ViewIntervals(1, "base", rows), 0.1))
    counts, may_count = [], []
    for _ in range(400):
        corner = rng.uniform((-2.5, -2.5, -0.2), (2.5, 2.5, 1.6))
        points = (corner + rng.uniform(0, (0.2, 0.3, 0.03), (40, 3))).astype(np.float32)
        T = pose_from_rpy(
            [*rng.uniform(-0.3, 0.3, 3), *rng.uniform(-0.1, 0.1, 2), rng.uniform(0, 3)]
        )
        how = T, 2.0, (0.02, 0.006)
        counts.append(grid.look(points, *how)[1].any())
        may_count.append(grid.may_touch(blocks_of(points, 0.1), *how))
    counts, may_count = np.array(counts), np.array(may_count)
    assert may_count[counts].all()
    assert counts.sum() > 0
    assert np.mean(~may_count[~counts]) > 0.5


def test_a_view_without_free_columns_looks_through_nothing():
    grid = FreeGrid.of(FreeColumns.of(None, 0.1))
    assert not grid.look(np.zeros((3, 3), np.float32), np.eye(4), 9.0, (0.0, 0.0))[1].any()


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_a_block_is_a_square_of_two_by_two_columns(seed, fraction):
    """Each point of a square of columns in each of which most points are chosen; one by one."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.35, 0.35, (150, 3))
    is_column_gone = rng.random((20, 20)) < fraction
    columns = np.floor(points[:, :2] / 0.1).astype(int)
    chosen = is_column_gone[columns[:, 0], columns[:, 1]] ^ (rng.random(150) < 0.1)

    def is_full(x, y):
        own = np.all(columns == (x, y), axis=1)
        return own.any() and chosen[own].mean() > MAJORITY

    def is_in_square(x, y):
        corners = [(x - i, y - j) for i in (0, 1) for j in (0, 1)]
        return any(all(is_full(a + i, b + j) for i in (0, 1) for j in (0, 1)) for a, b in corners)

    expected = [is_in_square(x, y) for x, y in columns] if chosen.any() else [False] * 150
    assert _in_block(points, chosen, 0.1).tolist() == expected


@given(st.integers(0, 2**32 - 1))
def test_angles_of_poses_are_those_that_make_them(seed):
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-1.4, 1.4, (5, 6)) * [9.0, 9.0, 9.0, 2.0, 1.0, 2.0]
    assert _rpy(np.array([pose_from_rpy(row) for row in rows])) == pytest.approx(rows, abs=1e-9)


@given(st.integers(50, 400), st.floats(0.0, 1.0), st.floats(0.0, 0.05))
def test_rest_of_a_carved_patch_is_more_than_stray_points(count, before, left):
    """A few points are gone with the rest; who takes nothing leaves everything."""
    rng = np.random.default_rng(count)
    keep = rng.random(count) >= before
    kept = np.flatnonzero(keep)
    gone = kept[rng.random(len(kept)) >= left]
    rest = len(kept) - len(_with_strays(gone, keep))
    assert rest == 0 or rest > MAX_FRACTION * count or len(gone) == 0
    assert set(gone) <= set(_with_strays(gone, keep)) <= set(kept)
    assert len(_with_strays(kept[:0], keep)) == 0
