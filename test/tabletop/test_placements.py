"""Placements on surfaces of known shape: exact clearances, nothing in the way, best first."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely import Polygon, box
from shapely.affinity import rotate

from tccm_ros.tabletop.placements import (
    Overhang,
    Placement,
    PlacementRequest,
    PlacementSurface,
    find_placements,
)

TOLERANCE_M = 2e-3  # m, of a clearance: the accuracy of an outline

UP = np.array([0.0, 0.0, 1.0])
MUG = PlacementRequest(0.1, 0.1, 0.12)


def table(room: shapely.Geometry, identity: int = 1, height: float = 0.7, overhangs=()):
    return PlacementSurface(identity, room, UP, height, (), overhangs)


def footprint(placement, request) -> Polygon:
    half_x, half_y = 0.5 * request.size_x, 0.5 * request.size_y
    x, y = placement.position[:2]
    unrotated = box(x - half_x, y - half_y, x + half_x, y + half_y)
    return rotate(unrotated, placement.yaw, use_radians=True)


def test_a_mug_goes_to_the_middle_of_an_empty_table():
    best = find_placements([table(box(0, 0, 1.2, 0.8))], MUG)[0]
    assert best.surface == 1
    assert best.position[1] == pytest.approx(0.4, abs=1e-3)
    assert best.position[2] == 0.7
    assert best.clearance == pytest.approx(0.4 - 0.05, abs=1e-3)
    assert best.free_height == math.inf


def test_a_long_object_is_turned_so_that_it_fits():
    request = PlacementRequest(0.1, 0.7, 0.1)
    best = find_placements([table(box(0, 0, 1.2, 0.3))], request)[0]
    assert abs(math.sin(best.yaw)) == pytest.approx(1.0, abs=1e-6)
    assert best.clearance == pytest.approx(0.1, abs=1e-3)


def test_object_that_does_not_fit_has_no_placement():
    assert find_placements([table(box(0, 0, 0.6, 0.13))], MUG) == []
    assert find_placements([table(Polygon())], MUG) == []


def test_the_roomiest_surface_comes_first():
    small, large = table(box(0, 0, 0.3, 0.3), 1), table(box(5, 0, 6, 1), 2)
    found = find_placements([small, large], PlacementRequest(0.1, 0.1, 0.1, max_count=2))
    assert found[0].surface == 2
    assert found[0].clearance > found[1].clearance


def test_a_board_above_keeps_tall_objects_out():
    board = Overhang(box(0, 0.4, 1.2, 0.8), 0.2)
    surface = table(box(0, 0, 1.2, 0.8), overhangs=[board])
    low = find_placements([surface], PlacementRequest(0.1, 0.1, 0.15))[0]
    assert low.free_height == 0.2
    tall = find_placements([surface], PlacementRequest(0.1, 0.1, 0.19))
    assert all(p.position[1] + 0.05 <= 0.4 - 0.02 + 1e-6 for p in tall)
    assert all(p.free_height == math.inf for p in tall)


def test_a_tilted_surface_is_met_where_it_is():
    normal = np.array([0.1, 0.0, 1.0]) / math.hypot(0.1, 1.0)
    surface = PlacementSurface(3, box(0, 0, 1, 1), normal, 0.5)
    position = find_placements([surface], MUG)[0].position
    assert position @ normal == pytest.approx(0.5, abs=1e-12)


def test_only_placements_within_reach_are_found():
    request = PlacementRequest(0.1, 0.1, 0.1, max_count=0, reach_from=(-0.3, 0.4), reach=0.6)
    found = find_placements([table(box(0, 0, 1.2, 0.8))], request)
    assert len(found) >= 2
    for placement in found:
        assert math.hypot(placement.position[0] + 0.3, placement.position[1] - 0.4) <= 0.6 + 1e-6
    away = PlacementRequest(0.1, 0.1, 0.1, reach_from=(-3.0, 0.4), reach=0.6)
    assert find_placements([table(box(0, 0, 1.2, 0.8))], away) == []


def millimetres(low: int, high: int) -> st.SearchStrategy[float]:
    return st.integers(low, high).map(lambda value: value / 1000)


def best_of_grid(room, request, yaw) -> float:
    """Return the most clearance among positions of a grid, for two yaws, by shapely."""
    best = 0.0
    low_x, low_y, high_x, high_y = room.bounds
    for x in np.linspace(low_x, high_x, 7):
        for y in np.linspace(low_y, high_y, 7):
            for angle in (yaw, yaw + math.pi / 2):
                shape = footprint(Placement(1, np.array([x, y, 0]), angle, 0, 0), request)
                if room.contains(shape):
                    best = max(best, shapely.distance(shapely.boundary(room), shape.boundary))
    return best


sizes = millimetres(50, 400)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            millimetres(0, 1000), millimetres(0, 700), millimetres(30, 300), millimetres(30, 300)
        ),
        max_size=5,
    ),
    sizes,
    sizes,
    millimetres(0, 80),
    millimetres(-3000, 3000),
)
@example([(0.0, 0.0, 0.229, 0.252)], 0.05, 0.05, 0.0, 0.0)
def test_every_placement_keeps_the_clearance_it_says(obstacles, size_x, size_y, clearance, yaw):
    occupied = [box(x, y, x + w, y + d) for x, y, w, d in obstacles]
    room = rotate(box(0, 0, 1.2, 0.8).difference(shapely.union_all(occupied)), yaw, (0, 0), True)
    request = PlacementRequest(size_x, size_y, 0.1, clearance, max_count=6)
    found = find_placements([table(room)], request)
    placed = []
    for placement in found:
        shape = footprint(placement, request)
        free = room.difference(shapely.union_all(placed))
        assert shape.difference(free.buffer(1e-6)).area < 1e-6
        distance = shapely.distance(shapely.boundary(free), shapely.boundary(shape))
        assert distance == pytest.approx(placement.clearance, abs=1e-6)
        assert placement.clearance >= clearance
        placed.append(shape)
    # Each is the best that was left: nothing of a fine grid beats it by more than the tolerance.
    clearances = [p.clearance for p in found]
    assert np.all(np.diff(clearances) <= TOLERANCE_M + 1e-9)
    if found:
        assert best_of_grid(room, request, found[0].yaw) <= clearances[0] + TOLERANCE_M + 1e-6


def test_an_answer_does_not_look_at_every_surface(monkeypatch):
    # The work grows with the placements asked for, not with the surfaces there are.
    surfaces = [table(box(2 * k, 0, 2 * k + 0.5, 0.5), k) for k in range(50)]
    surfaces.append(table(box(-2, 0, -1, 1), 99))
    looked = []
    original = PlacementSurface.yaw.func
    monkeypatch.setattr(
        PlacementSurface.yaw, "func", lambda self: looked.append(self.id) or original(self)
    )
    find_placements(surfaces, PlacementRequest(0.1, 0.1, 0.1, max_count=1))
    assert looked == [99]
