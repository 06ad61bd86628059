"""Outlines at the scale of the point spacing; those of scan lines are widened."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon

from tccm_ros.records import SensorKind
from tccm_ros.surfaces.polygons import polygon_rings
from tccm_ros.surfaces.views.outline import covered_area, expected_area, horizontal_outline

MIN_SIDE_EDGE = 0.004  # m: half the distance of beams of 0.5 deg at 1 m

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
    outline, spacing = horizontal_outline(scan_lines(L_SHAPE, gap, noise), 0.05, SensorKind.LASER)
    assert len(outline.geoms) == 1
    assert iou(outline, L_SHAPE) >= min_iou
    assert spacing == pytest.approx(max(gap, 0.025), rel=0.5)


def test_a_hole_in_a_table_is_a_hole_in_its_outline():
    table = shapely.box(0, 0, 1.6, 1.0).difference(shapely.box(0.6, 0.3, 1.0, 0.7))
    outline, _ = horizontal_outline(scan_lines(table, 0.02, 0.003), 0.05, SensorKind.LASER)
    assert len(outline.geoms[0].interiors) == 1
    assert iou(outline, table) >= 0.9


def test_two_boards_with_a_gap_are_two_parts():
    parts = shapely.union_all([shapely.box(0, 0, 0.8, 1.0), shapely.box(1.1, 0, 1.9, 1.0)])
    outline, _ = horizontal_outline(scan_lines(parts, 0.03, 0.002), 0.05, SensorKind.LASER)
    assert len(outline.geoms) == 2


@pytest.mark.parametrize(
    "points", [np.zeros((0, 2)), np.zeros((1, 2)), np.c_[np.arange(50) * 0.05, np.zeros(50)]]
)
def test_points_without_area_have_no_outline(points):
    outline, _ = horizontal_outline(points, 0.05, SensorKind.LASER)
    assert outline.area == 0.0


def test_rings_begin_at_their_smallest_vertex():
    square = shapely.Polygon(
        [(1, 1), (1, 0), (0, 0), (0, 1)], [[(0.2, 0.2), (0.4, 0.2), (0.4, 0.4), (0.2, 0.4)]]
    )
    boundary, holes = polygon_rings(square)
    assert boundary.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert shapely.LinearRing(holes[0]).is_ccw is False
    assert holes[0][0].tolist() == [0.2, 0.2]


def test_images_end_at_their_points_and_scan_lines_further_out():
    points = scan_lines(shapely.box(0.2, 0.2, 1.4, 1.0), 0.05, 0.0)
    covered, spacing = covered_area(points, 0.05)
    for sensor in (SensorKind.LASER, SensorKind.POINT_CLOUD):
        outline, _ = horizontal_outline(points, 0.05, sensor)
        out = np.abs(np.subtract(outline.bounds, covered.bounds))
        assert out == pytest.approx(0.15 * spacing, abs=1e-6)
    outline, _ = horizontal_outline(points, 0.05, SensorKind.DEPTH_IMAGE)
    assert outline.equals(covered)


@given(st.integers(0, 10**6), st.floats(0.0, 0.5))
@settings(max_examples=60, deadline=None)
def test_area_grows_within_the_limit_and_loses_nothing(seed, spacing):
    rng = np.random.default_rng(seed)
    hull = shapely.MultiPoint(rng.uniform(-0.25, 0.25, (8, 2))).convex_hull
    grown = shapely.union_all(expected_area(MultiPolygon([hull]), spacing))
    assert grown.buffer(1e-5).contains(hull)
    assert grown.area > hull.area + 0.5 * MIN_SIDE_EDGE * hull.length
    # A mitred corner is cut off at twice the distance of its sides: its ends are on their lines.
    assert hull.buffer(1.01 * (np.sqrt(5.0) * 0.0125 + 1e-5)).contains(grown)


def test_a_floor_around_the_robot_keeps_its_hole():
    floor = shapely.Point(0.0, 0.0).buffer(2.0).difference(shapely.Point(0.0, 0.0).buffer(0.4))
    (part,) = expected_area(MultiPolygon([floor]), 0.05).geoms
    assert len(part.interiors) == 1
    assert expected_area(MultiPolygon(), 0.05).is_empty
