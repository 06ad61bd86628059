"""Rooms have the names of the signs on their doors, and surfaces the rooms that they stand in."""

from dataclasses import replace

import numpy as np
import pytest
from outlined_surfaces import surface
from shapely import box

from tccm_ros.records import Sign
from tccm_ros.rooms.naming import named_rooms, placed_surfaces


def rectangle(x, y):
    return np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])], float)


CORRIDOR = rectangle((0, 12), (-1, 1))
NORTH = rectangle((0, 4), (1.12, 5))
EAST = rectangle((4.12, 8), (1.12, 5))
SOUTH = rectangle((0, 4), (-5, -1.3))
ROOMS = [CORRIDOR, NORTH, EAST, SOUTH]


def plate(number, x, side, *, sign_id=0, confidence=0.9, text=None):
    """Return a sign on the corridor's wall: side 1.0 is the north wall."""
    position = np.array([x, side * 1.0, 1.5])
    normal = np.array([0.0, -side, 0.0])
    covariance = 1e-4 * np.eye(3)
    return Sign(sign_id, text or number, number, confidence, position, normal, covariance, None, ())


def table(x, y, label="table", number=1):
    """Return a table of 1 m by 0.6 m."""
    return surface(box(x - 0.5, y - 0.3, x + 0.5, y + 0.3), label=label, number=number)


def names(rooms):
    return [room.name for room in rooms]


def test_the_room_behind_the_wall_has_the_name_not_the_one_before_it():
    rooms = named_rooms(ROOMS, [plate("205", 1.0, 1.0), plate("206", 2.0, -1.0, sign_id=1)])
    assert names(rooms) == ["", "205", "", "206"]
    assert [room.signs for room in rooms] == [(), (0,), (), (1,)]
    assert rooms[1].area == pytest.approx(4 * 3.88)


def test_a_sign_that_is_seen_from_the_other_side_names_the_other_room():
    sign = plate("205", 1.0, 1.0)
    inside = replace(sign, position=np.array([1.0, 1.12, 1.5]), normal=np.array([0.0, 1.0, 0.0]))
    assert names(named_rooms(ROOMS, [inside])) == ["205", "", "", ""]


def test_more_confident_of_two_signs_names_the_room():
    signs = [plate("20S", 1.0, 1.0, sign_id=3, confidence=0.5), plate("205", 2.0, 1.0, sign_id=7)]
    room = named_rooms(ROOMS, signs)[1]
    assert (room.name, room.signs) == ("205", (3, 7))


def test_a_sign_with_no_room_behind_names_nothing():
    assert names(named_rooms(ROOMS, [plate("299", 11.0, 1.0)])) == [""] * 4


def test_a_table_is_in_its_room_and_near_the_sign_of_the_room():
    signs = [plate("205", 1.0, 1.0, text="205 Archive"), plate("207", 5.0, 1.0, sign_id=1)]
    rooms = named_rooms(ROOMS, signs)
    inside, outside, none = placed_surfaces(
        [table(2.0, 4.5), table(6.0, 3.0, number=2), table(30.0, 3.0, number=3)], rooms, signs
    )
    assert (inside.room, inside.near) == ("205", ("205 Archive",))
    assert (outside.room, outside.near) == ("207", ("207",))
    assert (none.room, none.near) == ("", ())


def test_a_table_in_the_corridor_is_near_the_signs_that_hang_there():
    signs = [plate("205", 1.0, 1.0), plate("206", 3.0, -1.0, sign_id=1),
             plate("207", 11.0, 1.0, sign_id=2)]  # fmt: skip
    rooms = named_rooms(ROOMS, signs)
    (found,) = placed_surfaces([table(3.0, -0.6)], rooms, signs)
    assert found.room == ""
    assert found.near == ("206", "205")  # the nearest first; 207 is far away


def test_a_table_in_a_doorway_is_in_the_room_with_the_largest_part_of_it():
    signs = [plate("205", 1.0, 1.0)]
    (found,) = placed_surfaces([table(2.0, 1.30)], named_rooms(ROOMS, signs), signs)
    assert found.room == "205"


def test_the_floor_is_in_no_room():
    signs = [plate("205", 1.0, 1.0)]
    (floor,) = placed_surfaces([table(2.0, 3.0, "floor")], named_rooms(ROOMS, signs), signs)
    assert (floor.room, floor.near) == ("", ())
