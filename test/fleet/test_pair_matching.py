"""Furniture tells two floors with the same walls from each other."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from tccm_ros.config import Config
from tccm_ros.fleet.map_inputs import SurfaceFootprint
from tccm_ros.fleet.pair_matching import (
    compare_furniture,
    compare_signs,
)
from tccm_ros.geometry import inverse2, transform2
from tccm_ros.results.models import SignEntry
from tccm_ros.slam import map_matching

FLOOR = SurfaceFootprint(0, shapely.box(-4, -3, 4, 3), 0.0, True)
TABLE = SurfaceFootprint(1, shapely.box(0, 0, 1.4, 0.8), 0.74, False)
DESK = SurfaceFootprint(2, shapely.box(-2, 1, -1, 1.6), 0.72, False)
ROOM = (FLOOR, TABLE, DESK)
AREA = TABLE.polygon.area + DESK.polygon.area


def seen_from(T, surfaces):
    """The surfaces in a frame at T."""
    inverse = inverse2(np.array(T, float))
    return [
        SurfaceFootprint(
            s.id, shapely.transform(s.polygon, lambda xy: transform2(inverse, xy)), s.height,
            s.is_floor,
        )
        for s in surfaces
    ]  # fmt: skip


@pytest.mark.parametrize("T", [(0, 0, 0), (3.0, -2.0, 1.2), (-1.0, 0.5, -2.8)])
def test_the_same_room_agrees_wherever_its_frame_is(T):
    area, agreement = compare_furniture(ROOM, seen_from(T, ROOM), np.array(T, float))
    assert area == pytest.approx(2 * AREA)
    assert agreement == pytest.approx(1.0)


def test_a_table_that_was_moved_away_is_counted_by_the_one_map_that_has_it():
    area, agreement = compare_furniture(ROOM, (FLOOR, DESK), np.zeros(3))
    assert area == pytest.approx(AREA + DESK.polygon.area)
    assert agreement == pytest.approx(2 * DESK.polygon.area / area)


def test_tables_of_another_height_do_not_agree():
    other = (
        FLOOR,
        *(SurfaceFootprint(s.id, s.polygon, s.height + 0.1, False) for s in (TABLE, DESK)),
    )
    assert compare_furniture(ROOM, other, np.zeros(3))[1] == 0.0


def test_space_unseen_by_the_other_map_is_not_compared():
    far = SurfaceFootprint(0, shapely.box(10, 10, 14, 14), 0.0, True)
    assert compare_furniture(ROOM, (far,), np.zeros(3)) == (0.0, 0.0)


def moved_signs(T, signs):
    inverse = inverse2(np.array(T, float))
    return [
        replace(
            s, position=np.array([*transform2(inverse, s.position[None, :2])[0], s.position[2]])
        )
        for s in signs
    ]


SIGNS = tuple(
    SignEntry(
        k, f"10{k}", f"10{k}", 1.0, np.array([2.0 * k, 3.0, 1.5]), np.array([0.0, -1.0, 0.0]),
        np.eye(3), None, (),
    )
    for k in range(4)
)  # fmt: skip


@pytest.mark.parametrize("T", [(0, 0, 0), (3.0, -2.0, 1.2)])
def test_signs_of_one_floor_read_the_same(T):
    assert compare_signs(SIGNS, moved_signs(T, SIGNS), np.array(T, float)) == (4, 0)


def test_signs_of_another_floor_read_otherwise():
    other = [replace(s, number=s.number.replace("1", "2", 1)) for s in SIGNS]
    assert compare_signs(SIGNS, other, np.zeros(3)) == (0, 4)


def test_signs_of_one_map_alone_are_ignored():
    assert compare_signs(SIGNS[:2], SIGNS[2:], np.zeros(3)) == (0, 0)
    assert compare_signs(SIGNS, (), np.zeros(3)) == (0, 0)
    above = [replace(s, position=s.position + np.array([0, 0, 3.0])) for s in SIGNS]
    assert compare_signs(SIGNS, above, np.zeros(3)) == (0, 0)


@dataclass
class Keyframe:
    id: int
    session: int


@dataclass
class Anchored:
    keyframe: int


@dataclass
class View:
    measurement: SimpleNamespace
    anchored: Anchored
    sign: int


def walls_with_signs(keyframes, views):
    """Walls with nothing but keyframes, and views (stamp, keyframe, sign) of signs."""
    return SimpleNamespace(
        keyframes=[Keyframe(k, 0) for k in range(keyframes)],
        lines=[SimpleNamespace(phi=())] * keyframes, poses=np.zeros((keyframes, 3)), loops=(),
        sign_views=[View(SimpleNamespace(stamp_ns=t), Anchored(k), s) for t, k, s in views],
        unjoined={},
    )  # fmt: skip


def test_signs_of_both_maps_are_given_to_the_search(monkeypatch):
    given = []

    class Search:
        accepted = ()

        def __init__(self, config, chain, *, begins_trajectories):
            assert not begins_trajectories

        def load(self, poses, loops, observations, sign_views, unjoined):
            given.append([(v.anchored.keyframe, v.sign) for v in sign_views])

        def add(self, k, observations, sign_views):
            given.append([(v.measurement.stamp_ns, v.anchored.keyframe) for v in sign_views])
            assert all(v.sign == -1 for v in sign_views), "ids of signs are those of one map"

    monkeypatch.setattr(map_matching, "LoopCloser", Search)
    monkeypatch.setattr(map_matching, "KeyframeChain", lambda: SimpleNamespace(add=lambda *_: None))
    one = walls_with_signs(2, [(5, 1, 3)])
    other = walls_with_signs(3, [(9, 2, 0), (7, 2, 1), (1, 0, 0)])
    assert map_matching.match_walls(one, other, Config()) == []
    assert given == [[(1, 3)], [(1, 2)], [], [(7, 4), (9, 4)]]
