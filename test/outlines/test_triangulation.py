"""Triangles fill exactly what the rings enclose."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from tccm_ros.geometry import pose_from_rpy, transform
from tccm_ros.outlines.triangulation import fill_outline, fill_rings

UP = np.array([0.0, 0.0, 1.0])
SQUARE = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
HOLE = np.array([[0.5, 0.25, 0], [0.5, 0.75, 0], [1.5, 0.75, 0], [1.5, 0.25, 0]], float)


def filled(rings):
    """Triangles (T, 3, 2) of rings (N, 2)."""
    corners, triangles = fill_rings(rings)
    return corners[triangles]


def areas(triangles):
    (ax, ay), (bx, by) = (
        (triangles[:, 1] - triangles[:, 0]).T,
        (triangles[:, 2] - triangles[:, 0]).T,
    )
    return 0.5 * (ax * by - ay * bx)


def star(rng, n, low, high, centre):
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return ring * rng.uniform(low, high, (n, 1)) + centre


def assert_fills(triangles, polygon):
    """Assert that triangles are counter-clockwise, do not overlap and fill the polygon."""
    assert (areas(triangles) > 0.0).all()
    assert areas(triangles).sum() == pytest.approx(polygon.area)
    together = shapely.union_all([Polygon(t) for t in triangles])
    assert together.symmetric_difference(polygon).area < 1e-6


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(6, 60), st.integers(0, 4), st.booleans())
def test_triangles_have_the_polygon_s_area_and_do_not_overlap(seed, n, holes, is_reversed):
    rng = np.random.default_rng(seed)
    shell = star(rng, n, 2.0, 3.0, (0.0, 0.0))
    centres = [(-0.8, -0.8), (0.8, -0.8), (-0.8, 0.8), (0.8, 0.8)][:holes]
    rings = [shell, *(star(rng, 7, 0.1, 0.5, centre) for centre in centres)]
    polygon = Polygon(shell, rings[1:])
    if not polygon.is_valid:
        return
    rings = [ring[::-1].copy() if is_reversed else ring for ring in rings]
    triangles = filled(rings)
    assert_fills(triangles, polygon)
    assert len(triangles) <= sum(map(len, rings)) - 2 + 2 * holes


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 12), st.booleans())
def test_rings_that_cross_are_filled(seed, n, with_hole):
    """Any corners in any order, some of them twice: as outlines that cross themselves have."""
    rng = np.random.default_rng(seed)
    shell = np.round(rng.uniform(0.0, 4.0, (n, 2)))
    rings = [shell, rng.uniform(0.0, 4.0, (3, 2))] if with_hole else [shell]
    enclosed = [
        part
        for part in shapely.get_parts(shapely.make_valid(Polygon(shell, rings[1:])))
        if isinstance(part, Polygon)
    ]
    assert_fills(filled(rings), shapely.union_all(enclosed))


def test_collinear_corners_give_no_triangle():
    ring = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [0.0, 1.0]])
    assert areas(filled([ring])).sum() == pytest.approx(2.0)


def test_an_l_with_a_hole_in_each_leg_is_filled():
    shell = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], float)
    square = np.array([[0.4, 0.4], [0.4, 0.6], [0.6, 0.6], [0.6, 0.4]])
    rings = [shell, square + np.array([2.0, 0.0]), square + np.array([0.0, 2.0])]
    assert_fills(filled(rings), Polygon(shell, rings[1:]))


# --- outlines in space -------------------------------------------------------------------------


def triangle_areas(mesh):
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


@pytest.mark.parametrize("rpy", [(0, 0, 0), (np.pi, 0, 0), (1.2, -0.4, 2.0), (np.pi / 2, 0, 0)])
def test_an_outline_is_filled_in_its_plane_and_its_hole_is_left(rpy):
    T = pose_from_rpy([1, 2, 3, *rpy])
    mesh = fill_outline(transform(T, SQUARE), [transform(T, HOLE)], T[:3, 2])
    assert mesh.rings == (4, 4)
    np.testing.assert_array_equal(mesh.points, transform(T, np.concatenate([SQUARE, HOLE])))
    assert triangle_areas(mesh).sum() == pytest.approx(2.0 - 0.5)
    middles = mesh.points[mesh.triangles].mean(axis=1)
    x, y = ((middles - T[:3, 3]) @ T[:3, :3])[:, :2].T
    assert not ((x > 0.5) & (x < 1.5) & (y > 0.25) & (y < 0.75)).any()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.5, 2.0), min_size=3, max_size=24), st.integers(0, 4))
def test_triangles_cover_a_sloping_outline_and_leave_its_hole(radii, tilt):
    bearings = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    outline = np.stack([np.cos(bearings), np.sin(bearings)], axis=1) * np.array(radii)[:, None]
    slope = 0.1 * tilt
    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(1.0, slope)
    rings = (outline, outline[::-1] * 0.4)
    boundary, hole = (np.column_stack([r, 0.7 + slope * r[:, 0]]) for r in rings)
    mesh = fill_outline(boundary, [hole], normal)
    plan = Polygon(outline).area * (1 - 0.4**2)
    assert triangle_areas(mesh).sum() == pytest.approx(plan * np.hypot(1.0, slope), rel=1e-9)


@pytest.mark.parametrize("normal", [UP, -UP])
def test_triangles_are_counter_clockwise_seen_against_the_normal(normal):
    mesh = fill_outline(SQUARE, [], normal)
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    assert (np.cross(b - a, c - a) @ normal > 0).all()


@pytest.mark.parametrize(
    ("ring", "points"),
    [
        (np.zeros((0, 3)), 0),
        (SQUARE[:2], 0),
        (np.zeros((5, 3)), 5),
        (np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float), 3),
    ],
)
def test_rings_that_enclose_nothing_give_no_triangles(ring, points):
    mesh = fill_outline(ring, [], UP)
    assert mesh.triangles.shape == (0, 3)
    assert len(mesh.points) == points


def test_ring_that_crosses_itself_gets_corners_at_the_crossings():
    bow = np.array([[0, 0, 1], [1, 1, 1], [1, 0, 1], [0, 1, 1]], float)
    mesh = fill_outline(bow, [], UP)
    assert triangle_areas(mesh).sum() == pytest.approx(0.5)
    np.testing.assert_array_equal(mesh.points[:4], bow)
    assert np.allclose(mesh.points[4:, 2], 1.0)
