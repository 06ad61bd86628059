"""Merging of patches: their heights are compared where they meet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surface_maps import default_tilt_covariance

from tccm_ros.config import Config
from tccm_ros.records import SurfaceCloud
from tccm_ros.surfaces.merging.carving import Survivors
from tccm_ros.surfaces.merging.merging import NumberedPatch, Remainders, merge_coplanar
from tccm_ros.surfaces.views.views import empty_view, with_cloud

KEPT_ROUNDS = 3  # rounds that an unused result survives

CONFIG = Config()
NOISE = 0.004


def patch(x, height, *, step=0.03, seed=0):
    """Return a patch over a range of x, 1 m wide, with a height for each x."""
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(np.arange(*x, step), np.arange(-0.5, 0.5, step))
    xs, ys = (axis.ravel() for axis in grid)
    z = height(xs) + rng.normal(0.0, NOISE, len(xs))
    points = np.column_stack([xs, ys, z]).astype(np.float32)
    cloud = SurfaceCloud(1, "base", points, np.zeros(len(points), np.uint32))
    (made,) = with_cloud(empty_view(1, 0, CONFIG), cloud, CONFIG).patches
    return made


def count(patches, views):
    """Return how many surfaces patches make, each of one of the views."""
    patches = [NumberedPatch(k, view, p) for k, (p, view) in enumerate(zip(patches, views))]
    T = np.tile(np.eye(4), (max(views) + 1, 1, 1))
    return len(merge_coplanar(patches, T, default_tilt_covariance(len(T)), CONFIG))


def horizontal(z):
    return lambda x: np.full(len(x), z)


def bent(z):
    """Rise from `z` at 3 m as a sensor errs: horizontal where it begins, 3.4 deg on the whole."""
    return lambda x: z + 0.03 * (x - 3.0) ** 2


@pytest.mark.parametrize("views", [(0, 0), (0, 1)])
def test_a_far_floor_that_bends_up_is_one_with_the_near_floor(views):
    near, far = patch((1.0, 3.0), horizontal(0.0)), patch((3.02, 5.0), bent(0.0), seed=1)
    assert count([near, far], views) == 1


@pytest.mark.parametrize("views", [(0, 0), (0, 1)])
@pytest.mark.parametrize("step", [0.035, 0.05])
@pytest.mark.parametrize("shape", [horizontal, bent])
def test_patches_with_a_step_between_them_are_two(step, shape, views):
    near, far = patch((1.0, 3.0), horizontal(0.0)), patch((3.02, 5.0), shape(step), seed=1)
    assert count([near, far], views) == 2


def test_a_step_of_two_centimetres_in_one_view_makes_two_surfaces():
    board, lid = patch((1.0, 2.0), horizontal(0.7)), patch((1.4, 1.7), horizontal(0.72), seed=1)
    assert count([board, lid], (0, 0)) == 2


def test_a_sheet_that_crosses_above_a_table_is_not_the_table():
    table = patch((1.0, 3.0), horizontal(0.7))
    above = patch((1.0, 3.0), lambda x: 0.735 + 0.02 * (x - 2.0), seed=1)
    assert count([table, above], (0, 0)) == 2


def test_tables_that_do_not_touch_are_two():
    assert (
        count([patch((1.0, 2.0), horizontal(0.7)), patch((2.06, 3.0), horizontal(0.7))], (0, 1))
        == 2
    )


def view_of_patches(rng, stamp_ns):
    points = [rng.uniform((k, -0.5, 0.7), (k + 0.6, 0.5, 0.7), (200, 3)) for k in (1.0, 3.0)]
    cloud = np.concatenate(points).astype(np.float32)
    surface = np.repeat(np.arange(2, dtype=np.uint32), 200)
    return with_cloud(empty_view(stamp_ns, 0, CONFIG), SurfaceCloud(1, "b", cloud, surface), CONFIG)


def random_masks(rng, views):
    return Survivors(
        [
            [rng.random(len(p.points)) < rng.choice([0.0, 0.5, 1.0]) for p in view.patches]
            for view in views
        ]
    )


def assert_same_patches(found, expected):
    assert [(p.number, p.view) for p in found] == [(p.number, p.view) for p in expected]
    for a, b in zip((p.patch for p in found), (p.patch for p in expected)):
        assert (a.count, a.spacing, a.outline.wkb) == (b.count, b.spacing, b.outline.wkb)
        assert np.array_equal(a.points, b.points)
        assert np.array_equal(a.cov, b.cov)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_cached_merging_equals_fresh_merging(seed):
    rng = np.random.default_rng(seed)
    views, remainders = [view_of_patches(rng, k + 1) for k in range(3)], Remainders(CONFIG)
    masks = [random_masks(rng, views) for _ in range(2)]
    for number in (0, 1, 0, 1):
        found = remainders.surviving_patches(views, masks[number])
        assert_same_patches(found, Remainders(CONFIG).surviving_patches(views, masks[number]))
    assert remainders.outlined == 0
    views[1] = view_of_patches(rng, 2)
    changed = random_masks(rng, views)
    found = remainders.surviving_patches(views, changed)
    assert_same_patches(found, Remainders(CONFIG).surviving_patches(views, changed))


def test_patches_that_several_solutions_did_not_use_are_forgotten():
    rng = np.random.default_rng(0)
    views, remainders = [view_of_patches(rng, 1)], Remainders(CONFIG)
    half = Survivors([[np.arange(len(p.points)) % 2 == 0 for p in views[0].patches]])
    remainders.surviving_patches(views, half)
    assert remainders.outlined == len(views[0].patches)
    for _ in range(KEPT_ROUNDS + 1):
        remainders.surviving_patches([], Survivors([]))
    remainders.surviving_patches(views, half)
    assert remainders.outlined == len(views[0].patches)
