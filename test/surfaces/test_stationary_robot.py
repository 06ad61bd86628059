"""A stationary robot keeps one current view, and memory does not grow."""

from dataclasses import replace

import numpy as np
import pytest
import shapely.affinity
from room import EYE, Board, Room, Screen
from surface_maps import TABLE, above_floor, poses_at

from tccm_ros.config import Config
from tccm_ros.mapping.saved_map import pack_views, unpack_views
from tccm_ros.records import SurfaceCloud
from tccm_ros.surfaces.surface_map import SurfaceMap

LATE_VIEWS = 8  # newest views among which a late one may arrive

HOUR = 360
"""Cycles of ten seconds."""


def size(surface_map):
    return sum(array.nbytes for array in pack_views(surface_map.views).values())


def add_views(surface_map, views, is_stationary=lambda a, b: True):
    for view in views:
        surface_map.add_view(view)
        surface_map.forget(is_stationary)


def built(surface_map):
    return surface_map.build(poses_at(np.stack([np.eye(4)] * len(surface_map.views))))


def tilt_cycles(room, count, start=0):
    """Return noisy views of a stationary robot: three different ones, repeated."""
    kinds = []
    for seed in range(3):
        one = SurfaceMap(Config())
        for record in room.look((0.0, 0.0, 0.0), 0, rows=40, columns=80, noise=0.006, seed=seed):
            one.add(record)
        kinds += one.views
    return [
        replace(kinds[k % len(kinds)], stamp_ns=10 * k + 10) for k in range(start, start + count)
    ]


def test_memory_does_not_grow_over_an_hour_of_a_stationary_robot():
    surface_map = SurfaceMap(Config())
    add_views(surface_map, tilt_cycles(Room([TABLE]), 40))
    early = size(surface_map)
    add_views(surface_map, tilt_cycles(Room([TABLE]), HOUR - 40, start=40))
    assert len(surface_map.views) == LATE_VIEWS + 1
    assert size(surface_map) <= 1.05 * early
    (table,) = above_floor(built(surface_map))
    assert table.first_seen_ns == 10
    assert table.last_seen_ns == 10 * HOUR
    assert [v.stamp_ns for v in table.views] == [10 * HOUR]


def test_ids_are_those_of_the_first_view():
    room = Room([TABLE, Board(1.2, 1.4, 0.6, 0.6, 0.5)])
    first, long = SurfaceMap(Config()), SurfaceMap(Config())
    add_views(first, tilt_cycles(room, 1))
    add_views(long, tilt_cycles(room, 30))
    assert [s.id for s in above_floor(built(long))] == [s.id for s in above_floor(built(first))]
    loaded = SurfaceMap(Config())
    for view in unpack_views(pack_views(long.views)):
        loaded.add_view(view)
    for a, b in zip(built(long).surfaces, built(loaded).surfaces):
        assert (a.id, a.first_seen_ns, a.last_seen_ns) == (b.id, b.first_seen_ns, b.last_seen_ns)


def test_views_that_arrive_late_change_nothing():
    room = Room([TABLE])
    looks = tilt_cycles(room, 30)
    in_order, late = SurfaceMap(Config()), SurfaceMap(Config())
    add_views(in_order, looks)
    order = np.arange(30)
    order[[10, 14]] = order[[14, 10]]
    add_views(late, [looks[k] for k in order])
    for name, array in pack_views(in_order.views).items():
        np.testing.assert_array_equal(array, pack_views(late.views)[name])


def test_the_last_view_of_an_occluded_surface_is_kept():
    """A person hides the stool from the tenth tilt cycle on: the view that shows it stays."""
    stool = Board(1.2, 1.0, 0.4, 0.4, 0.5)
    surface_map = SurfaceMap(Config())
    add_views(surface_map, tilt_cycles(Room([TABLE, stool]), 10))
    hidden = Room([TABLE, stool], [Screen(0.35, 0.6, 0.7, 0.15, 1.9)])
    add_views(surface_map, tilt_cycles(hidden, 30, start=10))
    assert {round(s.height, 1) for s in above_floor(built(surface_map))} == {0.5, 0.7}
    assert len(surface_map.views) <= LATE_VIEWS + 3


def test_a_robot_that_moves_keeps_its_views():
    surface_map = SurfaceMap(Config())
    add_views(surface_map, tilt_cycles(Room([TABLE]), 20), is_stationary=lambda a, b: False)
    assert len(surface_map.views) == 20


@pytest.mark.parametrize("gone", [True, False])
def test_a_table_that_was_carried_away_is_gone(gone):
    surface_map = SurfaceMap(Config())
    add_views(surface_map, tilt_cycles(Room([TABLE]), 12))
    add_views(surface_map, tilt_cycles(Room([] if gone else [TABLE]), 20, start=12))
    assert len(above_floor(built(surface_map))) == (0 if gone else 1)


def test_single_scan_lines_are_no_surface_and_keep_no_view():
    lines = [
        replace(view, patches=(*view.patches, *line_view(0.9 + 0.01 * (k % 3)).patches))
        for k, view in enumerate(tilt_cycles(Room([TABLE]), 40))
    ]
    surface_map = SurfaceMap(Config())
    add_views(surface_map, lines)
    assert len(surface_map.views) == LATE_VIEWS + 1
    (table,) = above_floor(built(surface_map))
    assert table.height == pytest.approx(TABLE.z, abs=0.005)


def line_view(x):
    """Return a view of a single scan line, 1.2 m high."""
    y = np.linspace(-0.4, 0.4, 60)
    rng = np.random.default_rng(1)
    points = np.stack([x + rng.normal(0.0, 0.002, 60), y, np.full(60, 1.2)], axis=1)
    eye = EYE.astype(np.float32)
    cloud = SurfaceCloud(10, "base", points.astype(np.float32), np.zeros(60, np.uint32), eye)
    one = SurfaceMap(Config())
    one.add(cloud)
    return one.views[0]


def test_the_lines_of_several_views_make_a_surface():
    """Three lines of three views at distances of 4 cm are a ledge 8 cm deep."""
    surface_map = SurfaceMap(Config())
    for k, x in enumerate((0.90, 0.94, 0.98)):
        surface_map.add_view(replace(line_view(x), stamp_ns=10 + k))
    places = np.stack([np.eye(4)] * 3)
    places[:, 0, 3] = [0.0, 0.3, 0.6]  # different places: none replaces another
    for view, x in zip(list(surface_map.views), places[:, 0, 3]):
        patch = view.patches[0]
        moved = replace(
            patch,
            points=patch.points - np.float32([x, 0.0, 0.0]),
            mean=patch.mean - [x, 0.0, 0.0],
            outline=shapely.affinity.translate(patch.outline, -x),
        )
        surface_map.add_view(replace(view, patches=(moved,)))
    (ledge,) = surface_map.build(poses_at(places)).surfaces
    assert ledge.area == pytest.approx(0.08 * 0.8, abs=0.03)
    assert ledge.height == pytest.approx(1.2, abs=1e-6)
