"""How far a base can move, against shapely and a brute force over small steps."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon, affinity

from tccm_ros.approach.footprint import Footprint
from tccm_ros.errors import MotionError

BASE = Footprint.of([(0.3, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.3, -0.2)])
coordinates = st.floats(-1.0, 1.0)


def test_distances_are_never_more_than_true_ones():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (400, 2))
    found = BASE.distance(points)
    polygon = Polygon(BASE.corners)
    true = shapely.distance(polygon, shapely.points(points))
    assert (found <= true + 1e-12).all()
    assert ((found < 0.0) == shapely.contains_xy(polygon, *points.T)).all()
    beside = (np.abs(points[:, 1]) < 0.2) & (points[:, 0] > 0.3)
    assert np.allclose(found[beside], true[beside])


@given(coordinates, coordinates, st.sampled_from([-1.0, 1.0]))
def test_a_straight_way_ends_where_a_point_comes_within_its_margin(x, y, direction):
    margin, point = 0.05, np.array([[x, y]])
    if BASE.distance(point)[0] < margin:
        return
    way = BASE.free_way(point, np.array([margin]), direction)
    steps = np.arange(0.0, 1.5, 0.002)
    near = [BASE.distance(point - [direction * s, 0.0])[0] < margin - 1e-9 for s in steps]
    first = steps[int(np.argmax(near))] if any(near) else np.inf
    assert (way == np.inf) == (first == np.inf) or way == pytest.approx(first, abs=0.004)
    if np.isfinite(first):
        assert way == pytest.approx(first, abs=0.004)


def test_base_leaves_near_obstacles_behind_and_passes_those_beside():
    margins = np.array([0.05])
    assert BASE.free_way(np.array([[0.32, 0.0]]), margins, -1.0) == np.inf
    assert BASE.free_way(np.array([[0.32, 0.0]]), margins, 1.0) == 0.0
    assert BASE.free_way(np.array([[0.0, 0.22]]), margins, 1.0) == np.inf


@given(coordinates, coordinates, st.floats(0.1, 2.0), st.booleans())
def test_a_rotation_touches_nothing_that_it_is_free_of(x, y, angle, is_left):
    point = np.array([[x, y]])
    if BASE.distance(point)[0] < 0.05:
        return
    angle = angle if is_left else -angle
    free = BASE.free_rotation(point, np.array([0.05]), angle)
    polygon = Polygon(BASE.corners)
    for part in np.linspace(0.0, free, 50):
        turned = affinity.rotate(polygon, part, (0, 0), use_radians=True)
        assert not turned.contains(Point(x, y))


def test_a_grown_footprint_is_a_margin_wider_on_each_side():
    grown = Polygon(BASE.grown(0.1).corners)
    assert grown.symmetric_difference(shapely.box(-0.3, -0.3, 0.4, 0.3)).area < 1e-9


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ([0.1, 0.2], "footprint has 2 numbers"),
        ([1.0, 1.0, 2.0, 1.0, 2.0, 2.0], "does not hold the base's origin"),
        ([0.0, 0.0, 1.0, 0.0, 2.0, 0.0], "on one line"),
        ([np.nan] * 6, "beyond 3 m, or none at all"),
    ],
)
def test_invalid_footprint_is_reported(corners, words):
    with pytest.raises(MotionError, match=words):
        Footprint.of(corners)
