"""Outlines of one size, and outlines that a surface left."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon, box
from shapely.affinity import rotate, translate

from tccm_ros.surfaces.displacement import (
    HorizontalOutline,
    footprint_in_map,
    is_displaced,
    is_of_one_size,
)

TABLE = box(0.0, 0.0, 0.7, 1.0)


def at(outline, z=0.7):
    return HorizontalOutline(outline, z)


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.01, 0.01))
def test_noise_of_edges_and_heights_is_no_motion(x, y, z):
    noisy = translate(TABLE.buffer(0.5 * x, join_style="mitre"), x, y)
    assert not is_displaced(at(TABLE), at(noisy, 0.7 + z))
    assert is_of_one_size(at(TABLE), at(noisy))


@given(st.floats(0.12, 3.0), st.floats(0.0, 2.0 * np.pi), st.floats(-3.0, 3.0))
def test_a_table_that_went_elsewhere_is_displaced_and_of_one_size(step, direction, yaw):
    turned = rotate(TABLE, yaw, use_radians=True)
    there = translate(turned, step * np.cos(direction), step * np.sin(direction))
    assert is_displaced(at(turned), at(there))
    assert is_of_one_size(at(TABLE), at(there))


@pytest.mark.parametrize("grown", [box(0, 0, 0.7, 1.6), box(-0.5, -0.2, 0.9, 1.0)])
def test_surface_that_grows_or_shrinks_has_not_moved(grown):
    assert not is_displaced(at(TABLE), at(grown))
    assert not is_displaced(at(grown), at(TABLE))
    assert not is_of_one_size(at(TABLE), at(grown))


@pytest.mark.parametrize("spacing", [0.02, 0.1, 0.15])
def test_the_distance_of_scan_lines_along_the_line_of_sight_is_no_motion(spacing):
    """A view sees each end anywhere within it; sideways, beams are dense."""
    first = footprint_in_map(TABLE, np.array([2.0, 0.0, 0.7]), spacing, np.eye(4))
    ahead, aside = spacing * np.eye(2)
    assert not is_displaced(first, at(translate(TABLE, *ahead)))
    assert not is_displaced(at(translate(TABLE, *-ahead)), first)
    assert is_displaced(first, at(translate(TABLE, *(1.5 * ahead + 0.1))))
    assert is_displaced(first, at(translate(TABLE, *aside))) == (spacing > 0.05)


def test_a_rotated_table_is_displaced_and_a_round_one_is_not():
    assert is_displaced(at(TABLE), at(rotate(TABLE, 30.0)))
    disc = Point(0.0, 0.0).buffer(0.5)
    assert not is_displaced(at(disc), at(rotate(disc, 30.0)))


def test_a_lowered_table_is_displaced():
    assert is_displaced(at(TABLE, 0.70), at(TABLE, 0.66))
    assert not is_displaced(at(TABLE, 0.70), at(TABLE, 0.69))


def test_a_round_table_is_not_of_the_size_of_a_square_one_of_its_width():
    assert not is_of_one_size(at(box(-0.5, -0.5, 0.5, 0.5)), at(Point(0, 0).buffer(0.43)))


def test_a_spike_at_a_corner_is_no_other_size():
    spike = TABLE.union(Polygon([(0.0, 1.0), (0.0, 1.2), (0.05, 1.0)]))
    assert is_of_one_size(at(TABLE), at(spike))
    assert np.abs(at(spike).middle - at(TABLE).middle).max() < 0.01


def test_a_patch_is_placed_by_the_pose_of_its_view():
    T = np.eye(4)
    T[:3, 3] = 2.0, -1.0, 0.1
    T[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    placed = footprint_in_map(TABLE, np.array([0.35, 0.5, 0.7]), 0.02, T)
    assert placed.z == pytest.approx(0.8)
    assert placed.middle == pytest.approx([1.5, -0.65, 0.8])


@pytest.mark.parametrize(("spacing", "expected"), [(0.1, True), (0.0, False)])
def test_a_far_table_that_lost_a_scan_line_is_of_one_size(spacing, expected):
    """Its nearer end may be where the next scan line would have been; with dense ones it is not."""
    whole, far = box(0.0, 0.0, 0.41, 1.11), box(0.0, 0.0, 0.28, 1.11)
    seen = HorizontalOutline(far, 0.7, (spacing, 0.0))
    assert is_of_one_size(seen, at(whole)) == expected
    assert is_of_one_size(at(whole), seen) == expected
