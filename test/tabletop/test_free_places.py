"""Objects on a table seen in one tilt cycle, and the free places beside them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_rig import EYE, box, part_map, room, scan, table
from shapely import Point, Polygon, union_all
from shapely import box as rectangle
from shapely.affinity import rotate

from tccm_ros.config import Config
from tccm_ros.planes import find_planes
from tccm_ros.planes.tracking import PlaneTracker
from tccm_ros.tabletop import free_places
from tccm_ros.tabletop.free_places import where_fits
from tccm_ros.tabletop.objects import ObjectTracker, find_objects

CONFIG = Config()
SMALL = box("small", (0.75, 0.2, 0.7), (0.87, 0.32, 0.82), 0.3, (0.81, 0.26))
LARGE = box("large", (0.8, -0.35, 0.7), (0.95, -0.15, 0.95))


def look(patches, seed=0, sigma=0.002):
    points, _ = scan(patches, sigma, seed)
    cuboids = part_map(points)
    fits = find_planes(cuboids, CONFIG, EYE)
    planes = PlaneTracker(CONFIG).update(fits)
    return planes, find_objects(cuboids, fits, planes, CONFIG)


def test_boxes_on_a_table_are_objects_of_their_size():
    planes, objects = look(room() + table() + SMALL + LARGE)
    tops = {p.id for p in planes if abs(p.offset - 0.7) < 0.01}
    standing = [o for o in objects if o.plane in tops]
    assert len(standing) == 2
    small, large = sorted(standing, key=lambda o: o.size[2])
    assert small.size[2] == pytest.approx(0.12, abs=0.01)
    assert large.size[2] == pytest.approx(0.25, abs=0.01)
    # Only the front and the top are seen, in lines at distances of 3 to 5 cm.
    np.testing.assert_allclose(small.center[:2], (0.81, 0.26), atol=0.035)
    np.testing.assert_allclose(large.center[:2], (0.875, -0.25), atol=0.035)
    assert large.size[0] == pytest.approx(0.20, abs=0.04)
    for item in standing:
        assert -np.pi / 2 < item.yaw <= np.pi / 2
        assert Polygon(item.footprint).is_valid
        assert Polygon(item.footprint).exterior.is_ccw
        assert item.points >= CONFIG.objects.min_points


def test_an_empty_table_has_no_objects():
    assert look(room() + table())[1] == []


def test_a_box_in_the_air_does_not_stand_on_the_table():
    lamp = box("lamp", (0.8, -0.1, 1.15), (0.95, 0.1, 1.25))
    assert look(room() + table() + lamp)[1] == []


def test_objects_keep_their_ids_and_new_objects_get_new_ids():
    tracker = ObjectTracker(CONFIG)
    first = tracker.update(look(room() + table() + LARGE)[1])
    second = tracker.update(look(room() + table() + LARGE + SMALL, 1)[1])
    third = tracker.update(look(room() + table() + SMALL, 2)[1])
    assert [o.id for o in first] == [0]
    assert sorted(o.id for o in second) == [0, 1]
    assert [o.id for o in third] == [1]


def covers(rings, point):
    return any(Polygon(r).buffer(1e-9).contains(Point(point)) for r in rings)


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.05, 0.5), st.floats(0.05, 0.5), st.floats(-1.5, 1.5), st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)  # fmt: skip
def test_region_is_exactly_the_area_that_the_rectangle_can_cover(w, d, yaw, x, y):
    shape = rectangle(0, 0, 1, 1).difference(rectangle(0.5, 0.4, 1.2, 1.2))
    rings = where_fits(shape, (w, d), yaw)
    for a, b in ((w, d), (d, w)):
        placed = rotate(
            rectangle(x - a / 2, y - b / 2, x + a / 2, y + b / 2), yaw, use_radians=True
        )
        if shape.contains(placed):
            # What fits is in the region, whole.
            region = union_all([Polygon(r) for r in rings])
            assert placed.difference(region.buffer(1e-6)).area < 1e-9
    for ring in rings:
        assert Polygon(ring).difference(shape.buffer(1e-9)).area < 1e-9


def test_a_too_large_object_fits_nowhere_and_a_fitting_one_covers_all_room():
    assert where_fits(rectangle(0, 0, 0.3, 0.3), (0.31, 0.1), 0.0) == []
    rings = where_fits(rectangle(0, 0, 0.4, 0.4), (0.2, 0.3), 0.0)
    assert sum(Polygon(r).area for r in rings) == pytest.approx(0.16, abs=1e-9)


def test_a_region_around_an_obstacle_is_cut_into_rings_without_holes():
    shape = rectangle(0, 0, 1, 1).difference(rectangle(0.4, 0.4, 0.6, 0.6))
    rings = where_fits(shape, (0.2, 0.2), 0.0)
    assert sum(Polygon(r).area for r in rings) == pytest.approx(0.96, abs=1e-6)
    assert not covers(rings, (0.5, 0.5))


def test_a_hole_that_rounding_left_is_filled(monkeypatch):
    """A cut through such a hole leaves it as it is, and another cut as well."""
    speck = [
        (0.20362097526073542, -2.977208593903158),
        (0.20362097526073544, -2.977208593903158),
        (0.2036209752607354, -2.9772085939031574),
    ]
    hole = rectangle(0.5, -3.2, 0.7, -3.0).exterior
    room = Polygon(rectangle(-1.0, -4.0, 1.0, -2.0).exterior, [speck, hole])
    monkeypatch.setattr(free_places, "_opening", lambda room, *_: room)
    rings = where_fits(room, (0.1, 0.1), 0.0)
    assert sum(Polygon(ring).area for ring in rings) == pytest.approx(4.0 - 0.04)
