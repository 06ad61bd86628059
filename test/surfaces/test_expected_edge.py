"""Where surfaces are expected to end: far edges further out, near ones where they are."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon
from tccm_ros.surfaces.expected_edge import FURTHEST, LEAST_SIDEWAYS, SHARE, expected_area

SPACING = 0.05


def test_a_far_edge_moves_out_and_a_near_one_stays():
    board = shapely.box(1.0, -0.3, 1.6, 0.3)
    area = shapely.union_all(expected_area(MultiPolygon([board]), SPACING))
    aside = 0.15 * SPACING
    x_min, _, x_max, _ = area.bounds
    assert x_min == pytest.approx(1.0 - aside, abs=1e-6)
    # The corners are moved, and they are not straight ahead.
    out = SHARE * SPACING * np.cos(np.arctan2(0.3, 1.6))
    assert x_max == pytest.approx(1.6 + out + aside, abs=1e-5)


@given(st.integers(0, 10**6), st.floats(0.3, 4.0), st.floats(-np.pi, np.pi), st.floats(0.0, 0.5))
@settings(max_examples=60, deadline=None)
def test_the_area_grows_by_what_is_allowed_and_loses_nothing(seed, distance, bearing, spacing):
    rng = np.random.default_rng(seed)
    middle = distance * np.array([np.cos(bearing), np.sin(bearing)])
    hull = shapely.MultiPoint(middle + rng.uniform(-0.25, 0.25, (8, 2))).convex_hull
    grown = shapely.union_all(expected_area(MultiPolygon([hull]), spacing))
    assert grown.buffer(1e-5).contains(hull)
    assert grown.area > hull.area + 0.5 * LEAST_SIDEWAYS * hull.length
    # A mitred corner reaches out twice as far as its sides.
    most = min(SHARE * spacing, FURTHEST) + 2.0 * 0.0125 + 1e-5
    assert hull.buffer(1.01 * most).contains(grown)


@given(st.integers(0, 10**6), st.floats(-np.pi, np.pi))
@settings(max_examples=30, deadline=None)
def test_it_turns_with_the_area(seed, angle):
    rng = np.random.default_rng(seed)
    corners = np.array([2.0, 0.0]) + rng.uniform(-0.4, 0.4, (7, 2))
    c, s = np.cos(angle), np.sin(angle)
    turned = corners @ np.array([[c, s], [-s, c]])
    areas = [
        shapely.union_all(expected_area(MultiPolygon([shapely.MultiPoint(p).convex_hull]), 0.04))
        for p in (corners, turned)
    ]
    assert areas[1].area == pytest.approx(areas[0].area, rel=1e-3)


def test_a_floor_around_the_robot_keeps_its_hole():
    floor = shapely.Point(0.0, 0.0).buffer(2.0).difference(shapely.Point(0.0, 0.0).buffer(0.4))
    (part,) = expected_area(MultiPolygon([floor]), 0.05).geoms
    assert len(part.interiors) == 1
    assert expected_area(MultiPolygon(), 0.05).is_empty
