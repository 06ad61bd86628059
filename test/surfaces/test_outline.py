"""Outlines at the scale of the point spacing; far edges are moved out, near ones stay."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon

from tccm_ros.surfaces.outline import (
    FAR_EDGE_FRACTION,
    MAX_FAR_EDGE,
    MIN_SIDE_EDGE,
    expected_area,
    horizontal_outline,
)
from tccm_ros.surfaces.polygons import polygon_rings, polygons_of

L_SHAPE = shapely.Polygon([(0, 0), (2, 0), (2, 0.6), (0.6, 0.6), (0.6, 2), (0, 2)])


def scan_lines(polygon, gap, noise, seed=0):
    """Return noisy points on lines of constant x at a distance of `gap`, m."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.01, 2.0, gap)
    points = np.stack(np.meshgrid(x, np.linspace(0.0, 2.0, 300)), axis=-1).reshape(-1, 2)
    inside = shapely.contains_xy(polygon, points[:, 0], points[:, 1])
    points = points[inside]
    return points + np.c_[rng.normal(0, noise, len(points)), np.zeros(len(points))]


def iou(a, b):
    return a.intersection(b).area / a.union(b).area


@pytest.mark.parametrize(
    ("gap", "noise", "min_iou"),
    [(0.02, 0.004, 0.93), (0.1, 0.006, 0.85), (0.2, 0.006, 0.75), (0.3, 0.01, 0.7)],
)
def test_an_l_shape_is_outlined_at_any_spacing(gap, noise, min_iou):
    outline, spacing = horizontal_outline(scan_lines(L_SHAPE, gap, noise), 0.05)
    assert len(outline.geoms) == 1
    assert iou(outline, L_SHAPE) >= min_iou
    assert spacing == pytest.approx(max(gap, 0.025), rel=0.5)


def test_a_hole_in_a_table_is_a_hole_in_its_outline():
    table = shapely.box(0, 0, 1.6, 1.0).difference(shapely.box(0.6, 0.3, 1.0, 0.7))
    outline, _ = horizontal_outline(scan_lines(table, 0.02, 0.003), 0.05)
    assert len(outline.geoms[0].interiors) == 1
    assert iou(outline, table) >= 0.9


def test_two_boards_with_a_gap_are_two_parts():
    parts = shapely.union_all([shapely.box(0, 0, 0.8, 1.0), shapely.box(1.1, 0, 1.9, 1.0)])
    outline, _ = horizontal_outline(scan_lines(parts, 0.03, 0.002), 0.05)
    assert len(outline.geoms) == 2


@pytest.mark.parametrize(
    "points", [np.zeros((0, 2)), np.zeros((1, 2)), np.c_[np.arange(50) * 0.05, np.zeros(50)]]
)
def test_points_without_area_have_no_outline(points):
    outline, _ = horizontal_outline(points, 0.05)
    assert outline.area == 0.0


def test_rings_begin_at_their_smallest_vertex():
    square = shapely.Polygon(
        [(1, 1), (1, 0), (0, 0), (0, 1)], [[(0.2, 0.2), (0.4, 0.2), (0.4, 0.4), (0.2, 0.4)]]
    )
    boundary, holes = polygon_rings(square)
    assert boundary.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert shapely.LinearRing(holes[0]).is_ccw is False
    assert holes[0][0].tolist() == [0.2, 0.2]


SPACING = 0.05


def test_the_far_edge_moves_out_and_the_near_one_stays():
    board = shapely.box(1.0, -0.3, 1.6, 0.3)
    area = shapely.union_all(expected_area(MultiPolygon([board]), SPACING))
    aside = 0.15 * SPACING
    x_min, _, x_max, _ = area.bounds
    assert x_min == pytest.approx(1.0 - aside, abs=1e-6)
    # The corners are moved, and they are not straight ahead.
    out = FAR_EDGE_FRACTION * SPACING * np.cos(np.arctan2(0.3, 1.6))
    assert x_max == pytest.approx(1.6 + out + aside, abs=1e-5)


@given(st.integers(0, 10**6), st.floats(0.3, 4.0), st.floats(-np.pi, np.pi), st.floats(0.0, 0.5))
@settings(max_examples=60, deadline=None)
def test_the_area_grows_by_what_is_allowed_and_loses_nothing(seed, distance, bearing, spacing):
    rng = np.random.default_rng(seed)
    middle = distance * np.array([np.cos(bearing), np.sin(bearing)])
    hull = shapely.MultiPoint(middle + rng.uniform(-0.25, 0.25, (8, 2))).convex_hull
    grown = shapely.union_all(expected_area(MultiPolygon([hull]), spacing))
    assert grown.buffer(1e-5).contains(hull)
    assert grown.area > hull.area + 0.5 * MIN_SIDE_EDGE * hull.length
    # A mitred corner moves out twice as far as its sides.
    max_distance = min(FAR_EDGE_FRACTION * spacing, MAX_FAR_EDGE) + 2.0 * 0.0125 + 1e-5
    assert hull.buffer(1.01 * max_distance).contains(grown)


@given(st.integers(0, 10**6), st.floats(0.3, 3.0), st.floats(-np.pi, np.pi))
@settings(max_examples=30, deadline=None)
def test_an_outline_with_holes_and_notches_is_what_it_passes_moving_away(seed, distance, bearing):
    """Twin: the union of the polygon in small steps of its way, less its widening aside."""
    rng = np.random.default_rng(seed)
    at = distance * np.array([np.cos(bearing), np.sin(bearing)])
    boxes = [shapely.box(*c, *(c + w)) for c, w in rng.uniform(0.02, 0.3, (6, 2, 2))]
    shape = shapely.union_all(boxes[:4]).difference(shapely.union_all(boxes[4:]))
    part = max(polygons_of(shapely.affinity.translate(shape, *at)).geoms, key=lambda p: p.area)
    spacing = 0.05
    grown = shapely.union_all(expected_area(MultiPolygon([part]), spacing))

    def moved(by):
        return shapely.make_valid(
            shapely.transform(
                part, lambda xy: xy * (1.0 + by / np.linalg.norm(xy, axis=1, keepdims=True))
            )
        )

    ways = np.linspace(0.0, FAR_EDGE_FRACTION * spacing, 60)
    passed = shapely.union_all([moved(way) for way in ways])
    aside = 0.15 * spacing
    wide = passed.buffer(aside, join_style="mitre", mitre_limit=2.0)
    # A step is 0.3 mm; corners are mitred where steps leave teeth.
    assert grown.buffer(1e-3).contains(passed)
    assert grown.area == pytest.approx(wide.area, rel=0.02)


@given(st.integers(0, 10**6), st.floats(-np.pi, np.pi))
@settings(max_examples=30, deadline=None)
def test_the_growth_does_not_depend_on_the_bearing(seed, angle):
    rng = np.random.default_rng(seed)
    corners = np.array([2.0, 0.0]) + rng.uniform(-0.4, 0.4, (7, 2))
    c, s = np.cos(angle), np.sin(angle)
    rotated = corners @ np.array([[c, s], [-s, c]])
    areas = [
        shapely.union_all(expected_area(MultiPolygon([shapely.MultiPoint(p).convex_hull]), 0.04))
        for p in (corners, rotated)
    ]
    assert areas[1].area == pytest.approx(areas[0].area, rel=1e-3)


def test_a_floor_around_the_robot_keeps_its_hole():
    floor = shapely.Point(0.0, 0.0).buffer(2.0).difference(shapely.Point(0.0, 0.0).buffer(0.4))
    (part,) = expected_area(MultiPolygon([floor]), 0.05).geoms
    assert len(part.interiors) == 1
    assert expected_area(MultiPolygon(), 0.05).is_empty
