"""The clearance of a rectangle in a polygon, against shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box

from tccm_ros.tabletop.placement_kernels import box_clearance

RING = np.array([(0, 0), (1.2, 0.1), (1.3, 0.8), (0.7, 0.5), (0.1, 0.9), (0, 0)], float)
HOLE = np.array([(0.3, 0.2), (0.5, 0.2), (0.5, 0.3), (0.3, 0.3), (0.3, 0.2)], float)
SIDES = np.concatenate([np.hstack([ring[:-1], ring[1:]]) for ring in (RING, HOLE)])
ROOM = Polygon(RING, [HOLE])


@settings(max_examples=300, deadline=None)
@given(st.floats(-0.1, 1.4), st.floats(-0.1, 1.0), st.floats(0.01, 0.3), st.floats(0.01, 0.3))
def test_the_clearance_is_the_distance_of_the_outlines(x, y, half_x, half_y):
    shape = box(x - half_x, y - half_y, x + half_x, y + half_y)
    is_inside = ROOM.contains(shape)
    expected = shapely.distance(shapely.boundary(ROOM), shape.boundary) if is_inside else 0.0
    got = box_clearance(SIDES, x, y, half_x, half_y, 0.0)
    assert got == pytest.approx(expected, abs=1e-9)


def test_a_polygon_without_sides_has_no_room():
    assert box_clearance(np.zeros((0, 4)), 0.0, 0.0, 0.1, 0.1, 0.0) == 0.0
