"""Furniture that is moved, carried away or hidden, over several views and saved maps."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from room import Board, Room, Screen
from surface_maps import above_floor, overlap, poses_at

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.mapping.saved_map import pack_views, unpack_views
from tccm_ros.surfaces.surface_map import SurfaceMap

TABLE = Board(1.6, -0.9, 0.8, 0.9, 0.74)
STOOL = Board(1.3, 0.9, 0.4, 0.4, 0.46)
PERSON = Screen(0.7, -0.9, 0.9, -0.2, 1.8)
"""Hides the table."""

PLACES = [(0, 0, 0), (-0.4, 0.2, 0.0), (0.1, -0.5, 0.2), (-0.2, 0.6, -0.2), (0, 0, 0), (0.3, 0, 0)]


@cache
def view_of(boards, screens, k):
    """Return the view of a room from one of the places, which depends on no other view."""
    surface_map = SurfaceMap(Config())
    for record in Room(boards, screens).look(PLACES[k], 10 * k + 10):
        surface_map.add(record)
    (view,) = surface_map.views
    return view


def look_at(rooms, *, saved_after=None):
    """Map a room that changes, from several poses; save and load after a view if asked."""
    surface_map = SurfaceMap(Config())
    for k, room in enumerate(rooms):
        surface_map.add_view(view_of(tuple(room.boards), tuple(room.screens), k))
        if k == saved_after:
            packed = pack_views(surface_map.views)
            surface_map = SurfaceMap(Config())
            for view in unpack_views(packed):
                surface_map.add_view(view)
    count = len(rooms)
    where = spatial(np.array(PLACES[:count], float))
    return {round(s.height, 2): s for s in above_floor(surface_map.build(poses_at(where)))}


BOTH = Room([TABLE, STOOL])
HIDDEN = Room([TABLE, STOOL], [PERSON])
MOVED = Room([replace(TABLE, y=TABLE.y - 1.1), STOOL])
NO_TABLE, NO_STOOL = Room([STOOL]), Room([TABLE])

SAVES = [None, 0, 1, 2]


@cache
def look_at_both():
    """Return the surfaces of the room before it changes."""
    return look_at([BOTH])


@pytest.mark.parametrize("saved_after", SAVES)
def test_a_table_that_a_person_hides_keeps_its_id(saved_after):
    before = look_at_both()
    after = look_at([BOTH, HIDDEN, HIDDEN, BOTH], saved_after=saved_after)
    meanwhile = look_at([BOTH, HIDDEN, HIDDEN], saved_after=saved_after)
    for height, board in ((0.74, TABLE), (0.46, STOOL)):
        assert meanwhile[height].id == after[height].id == before[height].id
        assert overlap(after[height], board) > 0.8
        assert (after[height].first_seen_ns, after[height].last_seen_ns) == (10, 40)
    assert len(after) == len(meanwhile) == 2


def test_a_hidden_table_was_last_seen_before():
    hidden = Screen(0.6, -2.4, 0.9, 0.0, 1.8)
    found = look_at([BOTH, Room([TABLE, STOOL], [hidden]), Room([TABLE, STOOL], [hidden])])
    assert (found[0.74].first_seen_ns, found[0.46].first_seen_ns) == (10, 10)
    assert found[0.46].last_seen_ns == 30
    assert found[0.74].last_seen_ns < 30


@pytest.mark.parametrize("saved_after", SAVES)
def test_a_table_that_was_carried_away_is_gone_and_stays_gone(saved_after):
    for rooms in ([BOTH, NO_TABLE], [BOTH, BOTH, NO_TABLE], [BOTH, NO_TABLE, NO_TABLE]):
        found = look_at(rooms, saved_after=saved_after)
        assert set(found) == {0.46}
        assert found[0.46].id == look_at_both()[0.46].id


@pytest.mark.parametrize("saved_after", SAVES)
def test_a_table_that_was_hidden_and_then_carried_away_is_gone(saved_after):
    assert set(look_at([BOTH, HIDDEN, NO_TABLE], saved_after=saved_after)) == {0.46}


@pytest.mark.parametrize("saved_after", SAVES)
def test_a_table_that_comes_back_is_recognised(saved_after):
    found = look_at([BOTH, NO_TABLE, BOTH], saved_after=saved_after)
    (before,) = (s for s in look_at_both().values() if round(s.height, 2) == 0.74)
    assert found[0.74].id == before.id
    assert (found[0.74].first_seen_ns, found[0.74].placed_ns) == (10, 30)
    assert overlap(found[0.74], TABLE) > 0.75


@pytest.mark.parametrize("saved_after", SAVES)
def test_a_table_of_another_size_is_a_new_surface(saved_after):
    other = Room([replace(TABLE, depth=1.3), STOOL])
    found = look_at([BOTH, NO_TABLE, other], saved_after=saved_after)
    assert found[0.74].first_seen_ns == 30
    assert found[0.74].id not in {s.id for s in look_at_both().values()}


@pytest.mark.parametrize("saved_after", SAVES)
def test_a_table_that_was_moved_keeps_its_id_and_says_where_it_stood(saved_after):
    moved = MOVED.boards[0]
    found = look_at([BOTH, MOVED, MOVED], saved_after=saved_after)
    assert len(found) == 2
    assert found[0.74].id == look_at_both()[0.74].id
    assert overlap(found[0.74], moved) > 0.7
    assert (found[0.74].first_seen_ns, found[0.74].last_seen_ns) == (10, 30)
    assert found[0.74].placed_ns == 20
    before = found[0.74].previous_pose
    assert before.last_seen_ns == 10
    middle = shapely.Polygon(before.boundary[:, :2]).centroid
    assert np.abs([middle.x - TABLE.x, middle.y - TABLE.y]).max() < 0.1
    assert (found[0.46].first_seen_ns, found[0.46].placed_ns, found[0.46].previous_pose) == (
        10,
        10,
        None,
    )
    back = look_at([BOTH, MOVED, BOTH, BOTH], saved_after=saved_after)
    assert overlap(back[0.74], TABLE) > 0.75
    assert back[0.74].id == found[0.74].id
    assert back[0.74].previous_pose.last_seen_ns == 20
    assert len(back) == 2


@pytest.mark.parametrize("saved_after", [None, 1])
@pytest.mark.parametrize("step", [(0.2, 0.0), (-0.2, 0.02), (0.0, 0.15), (0.02, -0.15), (0.2, 0.2)])
def test_a_table_that_was_moved_a_little_leaves_no_rim(saved_after, step):
    moved = replace(TABLE, x=TABLE.x + step[0], y=TABLE.y + step[1])
    found = look_at([BOTH, Room([moved, STOOL]), Room([moved, STOOL])], saved_after=saved_after)
    assert set(found) == {0.74, 0.46}
    assert overlap(found[0.74], moved) > 0.9
    assert found[0.74].id == look_at_both()[0.74].id
    assert (found[0.74].first_seen_ns, found[0.74].placed_ns) == (10, 20)
    assert found[0.46].placed_ns == 10


@pytest.mark.parametrize("saved_after", [None, 1])
@pytest.mark.parametrize("step", [-0.06, -0.05, -0.04, -0.03, 0.04])
def test_a_table_that_was_lowered_or_raised_leaves_no_ghost(saved_after, step):
    other = Room([replace(TABLE, z=TABLE.z + step), STOOL])
    found = look_at([BOTH, other, other], saved_after=saved_after)
    assert set(found) == {round(TABLE.z + step, 2), 0.46}
    table = found[round(TABLE.z + step, 2)]
    assert table.id == look_at_both()[0.74].id
    assert table.placed_ns == 20


@pytest.mark.parametrize("saved_after", SAVES)
def test_a_stool_is_gone_while_a_person_hides_the_table(saved_after):
    found = look_at([BOTH, Room([TABLE], [PERSON])], saved_after=saved_after)
    assert set(found) == {0.74}
    assert found[0.74].id == look_at_both()[0.74].id
