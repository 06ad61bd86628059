"""Points far from all others of a surface: strays where they are few."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.surfaces.stray_points import mark_strays
from tccm_ros.surfaces.views import _make_patches

SPACING = 0.04


def grid(x, y):
    xs, ys = np.meshgrid(np.arange(*x, SPACING), np.arange(*y, SPACING))
    return np.column_stack([xs.ravel(), ys.ravel()])


TABLE = grid((1.0, 1.5), (-0.4, 0.4))


@pytest.mark.parametrize(("count", "gap", "are_strays"), [(5, 0.16, True), (5, 0.1, False)])
def test_a_few_points_far_from_all_others_are_strays(count, gap, are_strays):
    far = np.column_stack([np.full(count, TABLE[:, 0].max() + gap), 0.01 * np.arange(count)])
    strays = mark_strays(np.vstack([TABLE, far]), np.ones(len(TABLE) + count, np.int32), SPACING)
    assert not strays[: len(TABLE)].any()
    assert (strays[len(TABLE) :] == are_strays).all()


def test_what_an_object_hides_is_seen_to_both_sides():
    both = np.vstack([TABLE, grid((1.0, 1.5), (0.6, 0.8))])
    assert not mark_strays(both, np.ones(len(both), np.int32), SPACING).any()


def test_points_without_spacing_have_no_strays():
    assert not mark_strays(TABLE[:2], np.ones(2, np.int32), 0.0).any()
    assert not len(mark_strays(np.zeros((0, 2)), np.zeros(0, np.int32), SPACING))


def test_a_patch_does_not_go_on_to_the_front_of_the_next_table():
    front = np.column_stack([np.full(4, 1.66), np.linspace(-0.4, -0.3, 4)])
    plan = np.vstack([TABLE, front])
    points = np.column_stack([plan, np.full(len(plan), 0.5)]).astype(np.float32)
    (patch,) = _make_patches(points, Config())
    assert patch.count == len(TABLE)
    assert patch.outline.bounds[2] < 1.52
