"""The surface map of simulated rooms: merging, ids, and tables that are moved."""

from dataclasses import replace

import numpy as np
import pytest
from room import Board, Room, Screen
from surface_maps import TABLE, above_floor, build, overlap

from tccm_ros.config import Config
from tccm_ros.scene.changes import ChangeKind, changes
from tccm_ros.scene.scene import KnownSurface, Scene
from tccm_ros.surfaces.surface_map import SurfaceMap, ViewPoses


def test_a_table_seen_from_three_positions_is_one_surface():
    room = Room([TABLE])
    looks = [(room, (0, 0, 0), 10), (room, (1.5, -2.2, 1.57), 20), (room, (3.2, 0.3, 3.14), 30)]
    mapped = build(looks)
    (table,) = above_floor(mapped)
    assert overlap(table, TABLE) >= 0.85
    assert table.height == pytest.approx(0.74, abs=1e-3)
    assert [v.stamp_ns for v in table.views] == [10, 20, 30]
    assert [v.keyframe for v in table.views] == [0, 1, 2]
    assert (table.first_seen_ns, table.last_seen_ns) == (10, 30)
    assert mapped.floor_z == pytest.approx(0.0, abs=1e-6)
    assert set(np.unique(mapped.surface_id)) == {s.id for s in mapped.surfaces}


def test_the_map_does_not_depend_on_the_order_of_arrival():
    room = Room([TABLE, Board(1.2, 1.9, 0.6, 0.6, 0.5)])
    looks = [(room, (0, 0, 0), 10), (room, (0, 1.0, 0), 20), (room, (0, 2.0, 0.2), 30)]
    first, second = build(looks), build(looks, order=[5, 2, 0, 4, 1, 3])
    assert [s.id for s in first.surfaces] == [s.id for s in second.surfaces]
    for a, b in zip(first.surfaces, second.surfaces):
        np.testing.assert_array_equal(a.boundary, b.boundary)
        assert (a.height, a.points, a.merged_ids) == (b.height, b.points, b.merged_ids)
        assert [v.points for v in a.views] == [v.points for v in b.views]
    np.testing.assert_array_equal(first.points, second.points)


def test_a_step_of_five_centimetres_is_its_own_surface():
    counter, stove = Board(1.4, 0.0, 0.6, 2.0, 0.90), Board(1.4, 0.4, 0.5, 0.5, 0.95)
    room = Room([counter, stove])
    mapped = build([(room, (0, 0, 0), 10), (room, (0.3, 0.6, -0.1), 20)])
    heights = sorted(round(s.height, 3) for s in above_floor(mapped))
    assert heights == [0.90, 0.95]
    step = max(above_floor(mapped), key=lambda s: s.height)
    assert step.label == "step"


def test_touching_surfaces_of_other_heights_are_separate():
    """A hob 4 cm above a counter: nearer than the merge distance, and yet another surface."""
    assert Config().surfaces.merge_distance > 0.04
    room = Room([Board(1.4, 0.0, 0.6, 2.0, 0.90), Board(1.4, 0.4, 0.5, 0.5, 0.94)])
    mapped = build([(room, (0, 0, 0), 10), (room, (0.3, 0.6, -0.1), 20)])
    assert sorted(round(s.height, 2) for s in above_floor(mapped)) == [0.90, 0.94]


def test_ids_stay_while_loop_closures_merge_and_split_surfaces():
    room = Room([TABLE])
    looks = [(room, (0, 0, 0), 10), (room, (3.2, 0.3, 3.14), 20)]
    separate = build(looks, poses=[(0, 0, 0), (6.2, 0.3, 3.14)])
    together = build(looks)
    first = min(s.id for s in above_floor(separate))
    assert len(above_floor(separate)) == 2
    assert [s.id for s in above_floor(together)] == [first]
    other = max(s.id for s in above_floor(separate))
    assert above_floor(together)[0].merged_ids == (other,)
    (merged,) = (s for s in together.surfaces if s.id == first)
    assert other in merged.merged_ids
    assert other not in {m for s in separate.surfaces for m in s.merged_ids}
    again = build(looks, poses=[(0, 0, 0), (6.2, 0.3, 3.14)])
    assert [s.id for s in again.surfaces] == [s.id for s in separate.surfaces]


def test_a_surface_that_joins_two_has_the_merged_id_of_the_other():
    long_board = Board(1.4, 0.0, 0.6, 2.6, 0.74)
    left = Room([long_board], [Screen(0.4, -2.0, 0.4, 0.1, 2.0)])
    right = Room([long_board], [Screen(0.4, -0.4, 0.4, 2.0, 2.0)])
    looks = [(left, (0, 0, 0), 10), (right, (0, -0.3, 0), 20)]
    separate = [s.id for s in above_floor(build(looks))]
    assert len(separate) == 2
    (joined,) = above_floor(build([*looks, (Room([long_board]), (0, 0.3, 0), 30)]))
    assert joined.id == separate[0]
    assert separate[1] in joined.merged_ids


def test_a_surface_that_replaces_two_pieces_has_both_ids():
    """A pole hides part of a table; without it, from the same pose, the table is in one piece."""
    pole = Screen(1.0, -0.2, 1.0, 0.2, 2.0)
    board = Board(1.5, 0.0, 0.6, 2.2, 0.74)
    wide = Board(1.5, 0.0, 0.6, 0.6, 0.74)
    left, right = replace(board, y=-0.8, depth=0.6), replace(board, y=0.8, depth=0.6)
    separate = above_floor(build([(Room([left, right], [pole]), (0, 0, 0), 10)]))
    assert len(separate) == 2
    looks = [(Room([left, right], [pole]), (0, 0, 0), 10), (Room([board, wide]), (0, 0, 0), 20)]
    (table,) = above_floor(build(looks))
    assert [table.id] + [n for n in table.merged_ids if n == separate[1].id] == [
        s.id for s in separate
    ]


def scene(mapped) -> Scene:
    known = [KnownSurface(s, s.views[-1].stamp_ns) for s in mapped.surfaces]
    return Scene(0, "map", mapped.floor_z, (), None, tuple(known))


def test_every_id_of_one_solution_is_found_in_another():
    """Whatever the poses of the views, an id of one map is an id or a merged id of another."""
    room = Room([TABLE, Board(1.3, 1.6, 0.7, 0.6, 0.74)])
    looks = [(room, (0, 0, 0), 10), (room, (0.2, 0.9, 0.1), 20), (room, (3.2, 0.3, 3.14), 30)]
    rng = np.random.default_rng(4)
    truth = np.array([pose for _, pose, _ in looks])
    solutions = [
        build(looks, list(truth + rng.uniform(-s, s, (3, 3)) * [1, 1, 0.1]), sees_through=False)
        for s in (0.0, 0.2, 0.5, 2.0)
    ]
    assert len({len(m.surfaces) for m in solutions}) > 1, "something merges or splits"
    for one in solutions:
        for other in solutions:
            names = [name for s in other.surfaces for name in (s.id, *s.merged_ids)]
            assert len(names) == len(set(names)), "an id belongs to one surface"
            events = changes(scene(one), scene(other), 1)
            assert {c.kind for c in events} <= {ChangeKind.MERGED, ChangeKind.SPLIT}
            ids, other_ids = ({s.id for s in above_floor(m)} for m in (one, other))
            assert ids - other_ids <= {k for c in events for k in c.ids_before}
            assert other_ids - ids <= {k for c in events for k in c.ids_after}


def test_a_table_that_was_moved_is_moved_in_the_map():
    before, after = Board(1.6, 0.9, 0.8, 0.9, 0.74), Board(1.6, -0.9, 0.8, 0.9, 0.74)
    looks = [(Room([before]), (0, 0, 0), 10), (Room([after]), (-0.4, 0.2, 0), 20)]
    (table,) = above_floor(build(looks))
    assert overlap(table, after) >= 0.8
    assert (table.first_seen_ns, table.placed_ns) == (10, 20)


def test_a_table_that_was_moved_a_little_leaves_no_strip():
    before, after = Board(1.6, 0.0, 0.8, 0.9, 0.74), Board(1.6, 0.5, 0.8, 0.9, 0.74)
    looks = [(Room([before]), (0, 0, 0), 10), (Room([after]), (-0.4, 0.2, 0), 20)]
    (table,) = above_floor(build(looks))
    assert overlap(table, after) >= 0.8


def test_a_table_that_was_carried_away_is_gone():
    looks = [(Room([TABLE]), (0, 0, 0), 10), (Room([]), (-0.4, 0.2, 0), 20)]
    assert above_floor(build(looks)) == []


def test_a_narrow_ledge_that_was_carried_away_is_gone():
    ledge = Board(1.4, 0.0, 0.12, 1.2, 0.8)
    looks = [(Room([ledge]), (0, 0, 0), 10), (Room([]), (-0.4, 0.2, 0), 20)]
    assert above_floor(build(looks)) == []


@pytest.mark.parametrize("pose", [(0, 0, 0), (0.02, 0.01, 0.01), (-0.5, 0.1, 0.0)])
def test_a_table_that_a_person_hides_stays(pose):
    person = Screen(0.6, -0.4, 0.6, 0.4, 1.8)
    looks = [(Room([TABLE]), (0, 0, 0), 10), (Room([TABLE], [person]), pose, 20)]
    (table,) = above_floor(build(looks))
    assert overlap(table, TABLE) >= 0.8
    assert table.first_seen_ns == 10


def test_a_stationary_robot_keeps_one_view():
    room = Room([TABLE])
    looks = [(room, (0.0, 0.001 * k, 0.0), 10 * k + 10) for k in range(6)]
    mapped = build(looks)
    (table,) = above_floor(mapped)
    assert [v.stamp_ns for v in table.views] == [60]
    assert (table.first_seen_ns, table.last_seen_ns) == (10, 60)
    assert table.id == above_floor(build(looks[:1]))[0].id


def test_surfaces_that_are_too_low_are_not_kept():
    room = Room([Board(1.2, 0.0, 0.8, 0.8, 0.12), TABLE])
    assert [round(s.height, 2) for s in above_floor(build([(room, (0, 0, 0), 10)]))] == [0.74]


def test_labels_depend_on_heights_above_the_floor():
    low = Room([Board(1.4, 0.0, 0.8, 0.8, 0.2)], floor=Board(0.0, 0.0, 12.0, 12.0, -0.3))
    mapped = build([(low, (0, 0, 0), 10)])
    assert mapped.floor_z == pytest.approx(-0.3, abs=1e-6)
    (table,) = above_floor(mapped)
    assert table.height == pytest.approx(0.2, abs=1e-6)
    assert table.label == "table"


def test_without_a_floor_its_height_is_none():
    room = Room([TABLE], floor=Board(0.0, 0.0, 0.01, 0.01, -9.0))
    mapped = build([(room, (0, 0, 0), 10)])
    assert mapped.floor_z is None
    assert len(above_floor(mapped)) == 1


def test_without_views_there_are_no_surfaces():
    mapped = SurfaceMap(Config()).build(
        ViewPoses(np.zeros((0, 4, 4)), np.zeros((0, 3, 3)), np.zeros(0, np.int64))
    )
    assert mapped.surfaces == ()
    assert mapped.floor_z is None
