"""Faces of compartments: measured, open or unknown."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.geometry import spatial
from tccm_ros.racks.compartment import FaceState, SeenView
from tccm_ros.racks.faces import Face, lower_end, measure_face
from tccm_ros.racks.hits import HitsInMap
from tccm_ros.records import ViewIntervals

EYE = np.array([0.0, 0.0, 0.4])
FACE = Face(spatial(np.array([2.0, 0.0, np.pi])), 0.8, 0.6)
"""It faces the sensor."""

GRID = np.array([[y, z] for y in np.arange(-0.6, 0.6, 0.03) for z in np.arange(0.0, 0.8, 0.03)])


def seen(distances, free=None):
    """Return what is seen of the face by beams over a grid that end at distances."""
    ends = np.column_stack([np.full(len(GRID), FACE.T_map_face[0, 3]), GRID])
    ends = EYE + (ends - EYE) * (distances / ends[:, 0])[:, None]
    hits = np.column_stack([ends, ends[:, 2]])
    hits = hits[np.isfinite(distances)]
    columns = FreeColumns.of(free, 0.1)
    views = [SeenView(np.eye(4), EYE, hits, columns)]
    hits = HitsInMap(views).near(shapely.box(-9.0, -9.0, 9.0, 9.0), 0.0)
    return measure_face(FACE, hits, views)


def test_beams_that_end_on_a_face_measure_it_and_where_it_is():
    face = seen(np.full(len(GRID), 2.03))
    assert face.state == FaceState.MEASURED
    assert face.measured > 0.9
    assert face.passed == 0.0
    assert abs(face.offset + 0.03) < 1e-9  # outward is towards the sensor


def test_beams_that_end_behind_a_face_passed_it():
    face = seen(np.full(len(GRID), 2.4))
    assert face.state == FaceState.OPEN
    assert face.passed > 0.9
    assert face.offset == 0.0


def test_beams_that_end_before_a_face_leave_it_unknown():
    face = seen(np.full(len(GRID), 1.5))
    assert (face.state, face.measured, face.passed) == (FaceState.UNKNOWN, 0.0, 0.0)


def test_a_face_of_which_as_much_was_passed_as_measured_is_not_measured():
    """Otherwise one beam on a leg is a wall of a low compartment."""
    is_panel = GRID[:, 0] > 0.0
    face = seen(np.where(is_panel, 2.0, 2.4))
    assert face.measured == face.passed == 0.5
    assert face.state == FaceState.OPEN


def test_posts_leave_a_face_open():
    is_post = np.abs(np.abs(GRID[:, 0]) - 0.38) < 0.02
    assert seen(np.where(is_post, 2.0, 2.4)).state == FaceState.OPEN


def test_a_board_across_an_open_face_is_a_bar_with_its_lower_end():
    is_board = (GRID[:, 1] > 0.31) & (GRID[:, 1] < 0.36)
    face = seen(np.where(is_board, 2.0, 2.4))
    assert face.state == FaceState.OPEN
    assert face.bar == pytest.approx(0.315)  # between the beams that end on it and pass below it


def test_a_bar_is_found_although_nothing_above_it_is_in_view():
    """The top board of a rack is at the upper end of a camera's image."""
    is_board = (GRID[:, 1] > 0.21) & (GRID[:, 1] < 0.26)
    ends = np.where(is_board, 2.0, 2.4)
    ends[GRID[:, 1] > 0.26] = np.inf
    face = seen(ends)
    assert face.state == FaceState.OPEN
    assert face.bar == pytest.approx(0.225)  # between the beams that end on it and pass below it
    assert face.passed > 0.9


def test_bar_without_returns_below_is_ignored():
    ends = np.where((GRID[:, 1] > 0.31) & (GRID[:, 1] < 0.36), 2.0, 2.4)
    ends[GRID[:, 1] < 0.31] = np.inf
    assert seen(ends).bar == np.inf


def test_a_wall_and_a_leaf_from_below_are_no_bars():
    assert seen(np.full(len(GRID), 2.0)).bar == np.inf
    assert seen(np.where(GRID[:, 1] < 0.36, 2.0, 2.4)).bar == np.inf
    assert seen(np.full(len(GRID), 2.4)).bar == np.inf


def test_a_bar_across_a_small_part_of_a_face_is_none():
    is_object = (GRID[:, 1] > 0.31) & (GRID[:, 1] < 0.36) & (GRID[:, 0] > 0.3)
    assert seen(np.where(is_object, 2.0, 2.4)).bar == np.inf


def test_face_with_free_columns_on_both_sides_of_a_beam_is_open():
    """Columns beside the face alone tell nothing: a beam need not have passed it."""
    xy = [[x, y] for x in np.arange(0.05, 3.0, 0.1) for y in np.arange(-1.45, 1.5, 0.1)]
    rows = np.column_stack([xy, np.full(len(xy), -0.5), np.full(len(xy), 1.5)]).astype(np.float32)
    nothing = np.full(len(GRID), np.inf)
    assert seen(nothing, ViewIntervals(1, "base", rows)).state == FaceState.OPEN
    before = rows[rows[:, 0] < 2.0]
    assert seen(nothing, ViewIntervals(1, "base", before)).state == FaceState.UNKNOWN


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 0.5))
def test_lower_end_of_a_front_is_between_hits_and_passes(seed, height):
    """Ranges have errors along the beams, and a tenth of the beams end on mixed pixels."""
    rng = np.random.default_rng(seed)
    crossing = np.column_stack(
        [np.zeros(400), rng.uniform(-0.4, 0.4, 400), height + rng.uniform(-0.08, 0.03, 400)]
    )
    origins = np.array([1.2, 0.0, 1.4]) + rng.normal(0.0, 0.05, (400, 3))
    on = crossing[:, 2] > height
    ranges = np.where(on, 1.0 + rng.normal(0.0, 0.008, 400), rng.uniform(1.1, 1.3, 400))
    mixed = ~on & (rng.random(400) < 0.1)
    ranges[mixed], on[mixed] = 1.01, True
    ends = origins + (crossing - origins) * ranges[:, None]
    found = lower_end(on, ends, origins, np.zeros(400), 0.0, 0.5, height - 0.04)
    assert abs(found - height) < 0.005


def test_a_face_that_no_beam_passed_below_has_no_lower_end():
    ends = np.column_stack([np.zeros(50), np.zeros(50), np.linspace(0.3, 0.4, 50)])
    origins = np.repeat([[1.2, 0.0, 1.4]], 50, axis=0)
    assert lower_end(np.ones(50, bool), ends, origins, np.zeros(50), 0.0, 0.5, 0.26) is None


def test_an_end_of_a_beam_from_below_may_be_on_the_lower_side():
    """Behind the front, it has the height of the lower side; its beam passed below the front."""
    x, y = np.repeat([0.0, -0.03, -0.3], 20), np.tile(np.linspace(-0.3, 0.3, 20), 3)
    ends = np.column_stack([x, y, np.repeat([0.305, 0.3, 0.3], 20)])
    origins = np.repeat([[1.2, 0.0, -0.5]], 60, axis=0)
    assert lower_end(x > -0.05, ends, origins, np.zeros(60), 0.0, 0.5, 0.29) == pytest.approx(0.295)
