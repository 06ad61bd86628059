import numpy as np
import pytest
import shapely

from tccm_ros.surfaces.outline import horizontal_outline
from tccm_ros.surfaces.polygons import polygon_rings

L_SHAPE = shapely.Polygon([(0, 0), (2, 0), (2, 0.6), (0.6, 0.6), (0.6, 2), (0, 2)])


def sweep_lines(polygon, gap, noise, seed=0):
    """Points on lines of constant x, `gap` apart, as a sweep leaves them."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.01, 2.0, gap)
    points = np.stack(np.meshgrid(x, np.linspace(0.0, 2.0, 300)), axis=-1).reshape(-1, 2)
    inside = shapely.contains_xy(polygon, points[:, 0], points[:, 1])
    points = points[inside]
    return points + np.c_[rng.normal(0, noise, len(points)), np.zeros(len(points))]


def iou(a, b):
    return a.intersection(b).area / a.union(b).area


@pytest.mark.parametrize(
    ("gap", "noise", "least"),
    [(0.02, 0.004, 0.93), (0.1, 0.006, 0.85), (0.2, 0.006, 0.75), (0.3, 0.01, 0.7)],
)
def test_an_l_stays_an_l_at_any_spacing(gap, noise, least):
    outline, spacing = horizontal_outline(sweep_lines(L_SHAPE, gap, noise), 0.05)
    assert len(outline.geoms) == 1
    assert iou(outline, L_SHAPE) >= least
    assert spacing == pytest.approx(max(gap, 0.025), rel=0.5)


def test_holes_stay_holes():
    table = shapely.box(0, 0, 1.6, 1.0).difference(shapely.box(0.6, 0.3, 1.0, 0.7))
    outline, _ = horizontal_outline(sweep_lines(table, 0.02, 0.003), 0.05)
    assert len(outline.geoms[0].interiors) == 1
    assert iou(outline, table) >= 0.9


def test_parts_stay_apart():
    parts = shapely.union_all([shapely.box(0, 0, 0.8, 1.0), shapely.box(1.1, 0, 1.9, 1.0)])
    outline, _ = horizontal_outline(sweep_lines(parts, 0.03, 0.002), 0.05)
    assert len(outline.geoms) == 2


@pytest.mark.parametrize(
    "points", [np.zeros((0, 2)), np.zeros((1, 2)), np.c_[np.arange(50) * 0.05, np.zeros(50)]]
)
def test_points_without_area_have_no_outline(points):
    outline, _ = horizontal_outline(points, 0.05)
    assert outline.area == 0.0


def test_rings_are_canonical():
    square = shapely.Polygon(
        [(1, 1), (1, 0), (0, 0), (0, 1)], [[(0.2, 0.2), (0.4, 0.2), (0.4, 0.4), (0.2, 0.4)]]
    )
    boundary, holes = polygon_rings(square)
    assert boundary.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert shapely.LinearRing(holes[0]).is_ccw is False
    assert holes[0][0].tolist() == [0.2, 0.2]
