"""Questions about a map of known surfaces: which of them, and where there is room."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tccm_ros.racks.insertions import AccessState
from tccm_ros.records import Hypothesis, Surface
from tccm_ros.scene.queries import ObjectFilter, SurfaceFilter, SurfaceQueries
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.tabletop.placements import ApproachDirection, PlacementRequest

UP = np.array([0.0, 0.0, 1.0])
MUG = PlacementRequest(0.1, 0.1, 0.12)


def surface(identity, label, x, y, size, z, merged_ids=()) -> Surface:
    half = 0.5 * np.array(size)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + (x, y)
    boundary = np.column_stack([corners, np.full(4, z)])
    middle = np.array([x, y, z])
    return Surface(
        identity, label, 0.9, z, UP, z, size[0] * size[1], middle, boundary, (), 1000, 0.002,
        0, 0, (), merged_ids,
    )  # fmt: skip


FLOOR = surface(0, "floor", 0, 0, (10, 10), 0.1)
TABLE = surface(1, "table", 2, 0, (1.2, 0.8), 0.8, merged_ids=(7,))
COUNTER = replace(
    surface(2, "counter", -3, 0, (2, 0.6), 1.0), room="205", near=("205 Archive", "206", "12-034B")
)
SHELF = surface(3, "shelf", -3, 0, (2, 0.6), 1.3)
BOX = SceneObject(
    5, 1, np.array([2.0, 0.0, 0.9]), np.array([0.4, 0.4, 0.2]), 0.0,
    label=Hypothesis("cereal box", 0.7),
)  # fmt: skip


@pytest.fixture
def queries() -> SurfaceQueries:
    return SurfaceQueries([FLOOR, TABLE, COUNTER, SHELF], [BOX], 0.1)


def ids(surfaces) -> list[int]:
    return [s.id for s in surfaces]


def test_without_conditions_all_but_the_floor_are_found(queries):
    assert ids(queries.find_surfaces(SurfaceFilter())) == [1, 2, 3]
    assert ids(queries.find_surfaces(SurfaceFilter(labels=frozenset({"floor"})))) == [0]


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        (SurfaceFilter(labels=frozenset({"table", "shelf"})), [1, 3]),
        (SurfaceFilter(ids=frozenset({7})), [1]),
        (SurfaceFilter(ids=frozenset({0})), [0]),
        (SurfaceFilter(min_confidence=0.95), []),
        (SurfaceFilter(max_height=0.75), [1]),
        (SurfaceFilter(min_height=0.85, max_height=1.0), [2]),
        (SurfaceFilter(min_area=1.0), [2, 3]),
        (SurfaceFilter(words=("TAB",)), [1]),
        (SurfaceFilter(words=("205", "counter")), [2]),
        (SurfaceFilter(words=("archive",)), [2]),
        (SurfaceFilter(words=("205", "table")), []),
        (SurfaceFilter(near_sign="ARCH"), [2]),
        (SurfaceFilter(near_sign="207"), []),
        (SurfaceFilter(near_sign="034b"), [2]),
        (SurfaceFilter(near_sign="12 034B"), [2]),
        (SurfaceFilter(near_sign="205 034B"), []),
        (SurfaceFilter(words=("12-034B", "counter")), [2]),
        (SurfaceFilter(words=("12/034", "counter")), [2]),
        (SurfaceFilter(words=("Cereal",)), [1]),
        (SurfaceFilter(words=("box", "table")), [1]),
        (SurfaceFilter(words=("cereal", "shelf")), []),
        (SurfaceFilter(near=(-3.0, 0.0)), [2, 3, 1]),
        (SurfaceFilter(near=(0.5, 0.0)), [1, 2, 3]),
        (SurfaceFilter(near=(0.5, 0.0), max_distance=1.0), [1]),
    ],
)
def test_each_condition_keeps_the_surfaces_that_meet_it(queries, wanted, expected):
    assert ids(queries.find_surfaces(wanted)) == expected


def test_the_distance_is_that_of_the_outline(queries):
    assert ids(queries.find_surfaces(SurfaceFilter(near=(0.5, 0.0), max_distance=0.89))) == []


def test_objects_on_a_surface_are_listed_and_are_obstacles(queries):
    table = SurfaceFilter(ids=frozenset({1}))
    found = queries.find_placements(table, replace(MUG, max_count=0))
    assert found
    for placement in found:
        x, y, z = placement.position
        gap = max(abs(x - 2.0) - 0.2 - 0.05, abs(y) - 0.2 - 0.05)
        assert gap >= 0.02 - 1e-6
        assert z == pytest.approx(0.8)
    assert queries.objects_on(queries.find_surfaces(table)) == [BOX]


def test_space_under_a_shelf_has_its_height(queries):
    found = queries.find_placements(SurfaceFilter(ids=frozenset({2})), MUG)
    assert found[0].free_height == pytest.approx(0.3)
    tall = replace(MUG, height=0.29)
    assert queries.find_placements(SurfaceFilter(ids=frozenset({2})), tall) == []
    top = queries.find_placements(SurfaceFilter(ids=frozenset({3})), tall)
    assert top[0].free_height == math.inf


def test_an_empty_map_answers_with_nothing():
    queries = SurfaceQueries([], [], None)
    assert queries.find_surfaces(SurfaceFilter(near=(0.0, 0.0))) == []
    assert queries.find_placements(SurfaceFilter(), MUG) == []


MUG_2 = SceneObject(6, 2, np.array([-3.0, 0.0, 1.05]), np.array([0.1, 0.08, 0.1]), 0.0)


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        (ObjectFilter(), [5, 6]),
        (ObjectFilter(labels=frozenset({"cereal box"})), [5]),
        (ObjectFilter(surfaces=frozenset({2})), [6]),
        (ObjectFilter(min_size=0.15), [5]),
        (ObjectFilter(max_size=0.15), [6]),
        (ObjectFilter(near=(-3.0, 0.0)), [6, 5]),
        (ObjectFilter(near=(-3.0, 0.0), max_distance=1.0), [6]),
    ],
)
def test_objects_meet_all_conditions(wanted, expected):
    queries = SurfaceQueries([FLOOR, TABLE, COUNTER, SHELF], [BOX, MUG_2], 0.1)
    assert [found.item.id for found in queries.find_objects(wanted)] == expected


def test_object_below_a_board_is_free_from_above_for_a_small_hand():
    queries = SurfaceQueries([FLOOR, TABLE, COUNTER, SHELF], [BOX, MUG_2], 0.1)
    for hand, state, surface in ((0.15, AccessState.FREE, None), (0.25, AccessState.BLOCKED, 3)):
        box, mug = queries.find_objects(ObjectFilter(hand_height=hand))
        assert (box.above.state, box.front.state) == (AccessState.FREE, AccessState.UNKNOWN)
        assert (mug.above.state, mug.above.surface) == (state, surface)


def test_hand_from_above_needs_its_height_over_the_object():
    queries = SurfaceQueries([FLOOR, TABLE, COUNTER, SHELF], [], 0.1)
    below = SurfaceFilter(ids=frozenset({2}))
    assert queries.find_placements(below, MUG)
    from_above = replace(MUG, approach=ApproachDirection.ABOVE, hand_height=0.1)
    assert queries.find_placements(below, from_above)
    assert not queries.find_placements(below, replace(from_above, hand_height=0.2))


def test_nothing_goes_through_a_front_where_there_is_no_compartment():
    queries = SurfaceQueries([FLOOR, TABLE, COUNTER, SHELF], [], 0.1)
    assert not queries.find_placements(
        SurfaceFilter(), replace(MUG, approach=ApproachDirection.FRONT)
    )
