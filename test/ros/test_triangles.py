"""Triangles fill exactly what the rings enclose."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from tccm_ros.ros.triangles import clip_ears


def filled(rings):
    """Triangles (T, 3, 2) of rings (N, 2)."""
    xy = np.concatenate(rings)
    return xy[clip_ears(xy, np.cumsum([len(ring) for ring in rings]))]


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


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(6, 60), st.integers(0, 4), st.booleans())
def test_triangles_have_the_polygon_s_area_and_do_not_overlap(seed, n, holes, turned):
    rng = np.random.default_rng(seed)
    shell = star(rng, n, 2.0, 3.0, (0.0, 0.0))
    centres = [(-0.8, -0.8), (0.8, -0.8), (-0.8, 0.8), (0.8, 0.8)][:holes]
    rings = [shell, *(star(rng, 7, 0.1, 0.5, centre) for centre in centres)]
    polygon = Polygon(shell, rings[1:])
    if not polygon.is_valid:
        return
    rings = [ring[::-1].copy() if turned else ring for ring in rings]
    triangles = filled(rings)
    assert (areas(triangles) > 0.0).all()
    assert areas(triangles).sum() == pytest.approx(polygon.area)
    together = shapely.union_all([Polygon(t) for t in triangles])
    assert together.symmetric_difference(polygon).area < 1e-6
    assert len(triangles) <= sum(map(len, rings)) - 2 + 2 * holes


def test_corners_in_a_line_need_no_triangle():
    ring = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [0.0, 1.0]])
    assert areas(filled([ring])).sum() == pytest.approx(2.0)


def test_an_l_with_a_hole_in_each_leg():
    shell = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], float)
    square = np.array([[0.4, 0.4], [0.4, 0.6], [0.6, 0.6], [0.6, 0.4]])
    rings = [shell, square + np.array([2.0, 0.0]), square + np.array([0.0, 2.0])]
    assert areas(filled(rings)).sum() == pytest.approx(7.0 - 0.08)


def test_a_bow_tie_is_not_filled():
    ring = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    assert len(filled([ring])) == 0 or areas(filled([ring])).sum() <= 0.5
