"""What is told of scenes that follow each other."""

from dataclasses import replace

import numpy as np

from tccm_ros.records import PreviousPose, Surface
from tccm_ros.scene.changes import Change, ChangeKind, MapChanges
from tccm_ros.scene.scene import KnownSurface, Scene
from tccm_ros.surfaces.objects.scene_objects import SceneObject

UP = np.array([0.0, 0.0, 1.0])
CORNERS = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def ring(x, y, size, z):
    return np.column_stack([CORNERS * size + (x, y), np.full(4, z)])


def surface(identity, x=0.0, y=0.0, *, size=(0.8, 1.2), z=0.7, label="table", placed=1, **more):
    boundary = ring(x, y, size, z)
    return Surface(
        identity, label, 0.9, z, UP, z, size[0] * size[1], boundary.mean(axis=0), boundary, (),
        1000, 0.002, 1, 9, (), placed_ns=placed, **more,
    )  # fmt: skip


def scene(stamp, *surfaces, objects=()):
    known = tuple(KnownSurface(s, stamp) for s in surfaces)
    return Scene(stamp, "map", 0.0, tuple(objects), None, known, stamp)


def events_of(*scenes, views=2) -> list[Change]:
    changes = MapChanges()
    return [change for each in scenes for change in changes.note(each, views)]


def kinds(*scenes):
    return [change.kind for change in events_of(*scenes)]


FLOOR = surface(0, size=(9, 9), z=0.0, label="floor")
TABLE = surface(3)
MOVED = surface(3, 1.0, placed=3)


def test_a_surface_has_appeared_once_a_later_view_agrees():
    new = surface(3, placed=2)
    assert kinds(scene(2, FLOOR, new)) == []
    assert kinds(scene(2, FLOOR, new), scene(2, FLOOR, new)) == []
    (event,) = events_of(scene(2, FLOOR, new), scene(3, FLOOR, new), scene(4, FLOOR, new))
    assert (event.kind, event.ids_after, event.stamp_ns) == (ChangeKind.APPEARED, (3,), 2)


def test_change_seen_by_one_view_is_no_event():
    assert kinds(scene(1, FLOOR), scene(2, surface(3, placed=2)), scene(3, FLOOR)) == []


def test_a_moved_surface_is_one_event_with_both_poses():
    first, *rest = events_of(scene(2, TABLE), scene(3, MOVED), scene(4, MOVED), scene(5, MOVED))
    assert first.kind == ChangeKind.APPEARED
    (event,) = rest
    assert (event.kind, event.ids_before, event.ids_after) == (ChangeKind.MOVED, (3,), (3,))
    assert np.allclose(event.T_before[:3, 3], [0.0, 0.0, 0.7])
    assert np.allclose(event.T_after[:3, 3], [1.0, 0.0, 0.7])
    assert event.last_seen_ns == 2


def test_move_is_reported_from_the_previous_pose():
    """The map has what is left at the old place with the new one, until a third view is sure."""
    both = surface(3, 0.08, size=(0.96, 1.2), placed=1)
    moved = surface(3, 0.16, placed=3)
    first, *rest = events_of(scene(2, TABLE), scene(3, both), scene(4, both), scene(5, moved))
    assert first.kind == ChangeKind.APPEARED
    (event,) = rest
    assert event.kind == ChangeKind.MOVED
    assert np.allclose(event.T_before[:3, 3], [0.0, 0.0, 0.7])
    assert np.allclose(event.T_after[:3, 3], [0.16, 0.0, 0.7])
    assert kinds(scene(2, TABLE), scene(3, both), scene(4, both)) == [ChangeKind.APPEARED]


def test_surface_carried_through_the_view_is_reported_where_it_stays():
    """Each view shows it elsewhere; only the last place is seen twice."""
    way = [scene(k, surface(3, 0.5 * k, placed=k)) for k in (3, 4, 5)]
    events = events_of(scene(2, TABLE), *way, scene(6, surface(3, 2.5, placed=5)))
    assert [e.kind for e in events] == [ChangeKind.APPEARED, ChangeKind.MOVED]
    assert np.allclose(events[1].T_after[:2, 3], [2.5, 0.0])


def test_a_corrected_map_and_more_of_a_surface_are_no_motion():
    corrected = surface(3, 0.4)
    grown = surface(3, 0.0, 0.3, size=(0.8, 1.8), placed=3)
    assert kinds(scene(2, TABLE), scene(3, corrected), scene(4, corrected)) == [1]
    assert kinds(scene(2, TABLE), scene(3, grown), scene(4, grown)) == [1]


def test_a_surface_is_gone_once_the_next_view_agrees():
    assert kinds(scene(2, TABLE), scene(3, FLOOR)) == [1]
    assert kinds(scene(2, TABLE), scene(3), scene(3)) == [1]
    assert kinds(scene(2, TABLE), scene(3), scene(4), scene(5)) == [1, ChangeKind.GONE]
    assert kinds(scene(2, TABLE), scene(3), scene(4, TABLE), scene(5), scene(5, TABLE)) == [1]


def test_two_views_in_one_solution_agree():
    both = scene(4)._replace(previous_view_ns=3)
    assert kinds(scene(2, TABLE), both) == [1, ChangeKind.GONE]
    assert kinds(scene(2, TABLE), both._replace(previous_view_ns=2)) == [1]


def test_a_surface_that_was_gone_and_is_elsewhere_has_moved():
    previous = PreviousPose(TABLE.boundary, UP, 0.7, 2)
    there = replace(surface(3, 4.0, placed=8), previous_pose=previous)
    events = events_of(scene(2, TABLE), scene(3), scene(4), scene(8, there), scene(9, there))
    assert [e.kind for e in events] == [1, ChangeKind.GONE, ChangeKind.MOVED]
    assert np.allclose(events[2].T_before[:2, 3], [0.0, 0.0])
    assert events[2].ids_before == events[2].ids_after == (3,)
    back = replace(surface(3, 0.0, placed=8), previous_pose=previous)
    events = events_of(scene(2, TABLE), scene(3), scene(4), scene(8, back), scene(9, back))
    assert [e.kind for e in events] == [1, ChangeKind.GONE, ChangeKind.APPEARED]


def test_a_surface_that_is_recognised_after_it_was_seen_is_one_event():
    new = surface(7, 4.0, placed=3)
    same = replace(surface(3, 4.0, placed=3), merged_ids=(7,))
    events = events_of(
        scene(2, TABLE), scene(3, TABLE, new), scene(4, TABLE, new), scene(5, same), scene(6, same)
    )
    assert [e.kind for e in events] == [1, 1, ChangeKind.MOVED]
    assert (events[2].ids_before, events[2].ids_after) == ((3, 7), (3,))


def test_surfaces_merge_and_split():
    left, right = surface(3, placed=1), surface(5, 2.0, placed=1)
    whole = replace(surface(3, 1.0, size=(2.8, 1.2)), merged_ids=(5,))
    events = events_of(scene(2, left, right), scene(3, whole), scene(4, left, right))
    assert [e.kind for e in events] == [1, 1, ChangeKind.MERGED, ChangeKind.SPLIT]
    assert (events[2].ids_before, events[2].ids_after) == ((3, 5), (3,))
    assert (events[3].ids_before, events[3].ids_after) == ((3,), (3, 5))


def cup(identity, on, views, z=0.8):
    return SceneObject(
        identity, on, np.array([0.0, 0.0, z]), np.array([0.1, 0.1, 0.2]), 0.0, views=views
    )


def test_object_appears_after_agreeing_views_and_disappears_when_gone():
    scenes = [
        scene(2, FLOOR, TABLE),
        *(scene(k, FLOOR, TABLE, objects=[cup(9, 3, k - 2)]) for k in (3, 4, 5)),
    ]
    events = events_of(*scenes, scene(6, FLOOR, TABLE))
    assert [e.kind for e in events] == [1, ChangeKind.OBJECT_APPEARED, ChangeKind.OBJECT_LEFT]
    assert [e.object_id for e in events] == [-1, 9, 9]
    assert events[1].ids_after == events[2].ids_before == (3,)


def test_legs_and_tops_of_objects_are_no_events():
    leg, box = cup(9, 0, 5, z=0.1), cup(10, 3, 5)
    top = surface(4, size=(0.1, 0.1), z=0.9, label="other")
    events = events_of(*(scene(k, FLOOR, TABLE, top, objects=[leg, box]) for k in (2, 3, 4)))
    assert [(e.kind, e.object_id) for e in events] == [
        (ChangeKind.APPEARED, -1),
        (ChangeKind.OBJECT_APPEARED, 10),
    ]


def test_the_first_scene_of_a_loaded_map_is_no_change():
    changes = MapChanges(is_map_loaded=True)
    assert changes.note(scene(2, TABLE), 2) == []
    assert changes.note(scene(3, TABLE), 2) == []
    assert changes.note(scene(4, MOVED), 2)[0].kind == ChangeKind.MOVED
