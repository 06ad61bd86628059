"""Planar polygons are filled, holes stay empty."""

import numpy as np
import pytest

from tccm_ros.geometry import pose_from_rpy, transform
from tccm_ros.ros.polygons import triangulate

SQUARE = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
HOLE = np.array([[0.5, 0.25, 0], [0.5, 0.75, 0], [1.5, 0.75, 0], [1.5, 0.25, 0]], float)


def triangle_area(triangles):
    return 0.5 * np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
    )


@pytest.mark.parametrize("rpy", [(0, 0, 0), (np.pi, 0, 0), (1.2, -0.4, 2.0), (np.pi / 2, 0, 0)])
def test_triangles_fill_the_polygon_and_leave_the_hole(rpy):
    T = pose_from_rpy([1, 2, 3, *rpy])
    triangles = triangulate(transform(T, SQUARE), [transform(T, HOLE)], T[:3, 2])
    assert triangle_area(triangles).sum() == pytest.approx(2.0 - 0.5)
    np.testing.assert_allclose((triangles - T[:3, 3]) @ T[:3, 2], 0.0, atol=1e-12)
    x, y = ((triangles.mean(axis=1) - T[:3, 3]) @ T[:3, :3])[:, :2].T
    assert not ((x > 0.5) & (x < 1.5) & (y > 0.25) & (y < 0.75)).any()


def test_triangles_turn_counter_clockwise_seen_against_the_normal():
    for normal in ([0, 0, 1.0], [0, 0, -1.0]):
        a, b, c = np.moveaxis(triangulate(SQUARE, [], np.array(normal)), 1, 0)
        assert (np.cross(b - a, c - a) @ normal > 0).all()


@pytest.mark.parametrize(
    "ring",
    [
        np.zeros((0, 3)),
        SQUARE[:2],
        np.zeros((5, 3)),
        np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float),
    ],
)
def test_rings_that_enclose_nothing_give_no_triangles(ring):
    assert triangulate(ring, [], np.array([0, 0, 1.0])).shape == (0, 3, 3)


def test_a_ring_that_crosses_itself_is_filled_all_the_same():
    bow = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], float)
    assert triangle_area(triangulate(bow, [], np.array([0, 0, 1.0]))).sum() == pytest.approx(0.5)
