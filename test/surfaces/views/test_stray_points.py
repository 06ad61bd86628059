"""Points far from all others of a surface: strays where they are few."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.records import SensorKind
from tccm_ros.surfaces.views.stray_points import mark_strays
from tccm_ros.surfaces.views.views import _make_patches

SPACING = 0.04


def points(x, y, z=0.5):
    return np.column_stack([x, y, np.full(len(x), z)]).astype(np.float32)


def grid(x, y):
    xs, ys = np.meshgrid(np.arange(*x, SPACING), np.arange(*y, SPACING))
    return points(xs.ravel(), ys.ravel())


TABLE = grid((1.0, 1.5), (-0.4, 0.4))
NEXT = grid((1.7, 2.0), (-0.4, 0.4)) + np.float32([0, 0, 0.04])
"""A higher table, whose front is at x = 1.7 m."""


def front(count, x=1.71):
    return points(np.full(count, x), 0.01 * np.arange(count))


def strays_of(extra, others):
    """Which of some points beside the table are strays; none of the table's is."""
    both = np.vstack([TABLE, extra])
    strays = mark_strays(both, np.ones(len(both), np.int32), SPACING, others, 0.05)
    assert not strays[: len(TABLE)].any()
    return strays[len(TABLE) :]


def test_a_few_points_on_the_front_of_the_next_table_are_strays():
    assert strays_of(front(5), NEXT).all()


def test_a_whole_scan_line_on_the_front_of_the_next_table_is_stray():
    """It has a sixth of the points, in a strip of 2 cm."""
    line = np.vstack([front(40, 1.70), front(20, 1.72)]) - np.float32([0, 0.3, 0])
    assert len(line) > 0.15 * len(TABLE)
    assert strays_of(line, NEXT).all()


@pytest.mark.parametrize(("below", "is_stray"), [(0.0, True), (0.004, True), (0.02, False)])
def test_points_that_went_to_the_lower_table_of_one_height_are_strays(below, is_stray):
    """They are of a table beside, whose points are no higher than they are."""
    beside = grid((1.68, 2.1), (-0.4, 0.4)) - np.float32([0, 0, below])
    assert strays_of(points([1.7, 1.7], [0.0, 0.01]), beside).all() == is_stray


@pytest.mark.parametrize(
    ("extra", "others"),
    [
        (front(5), NEXT - np.float32([0, 0, 0.1])),
        (front(5), NEXT + np.float32([0.2, 0, 0])),
        (front(5), NEXT[:0]),
        (front(5, TABLE[:, 0].max() + 0.1), NEXT),
        (grid((1.64, 1.9), (-0.2, 0.2)), NEXT),
    ],
    ids=["of a lower table", "far from it", "with no other", "near the own table", "many"],
)
def test_others_are_none(extra, others):
    assert not strays_of(extra, others).any()


def test_points_without_spacing_have_no_strays():
    assert not mark_strays(TABLE[:2], np.ones(2, np.int32), 0.0, NEXT, 0.05).any()


def test_a_patch_does_not_go_on_to_the_front_of_the_next_table():
    (patch,) = _make_patches(np.vstack([TABLE, front(4)]), NEXT, SensorKind.LASER, Config())
    assert patch.count == len(TABLE)
    assert patch.outline.bounds[2] < 1.52
