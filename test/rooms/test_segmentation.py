"""Rooms of plans that are known: their outlines, whatever the direction, doors and furniture."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box, contains_xy, union_all

from tccm_ros.rooms.cells import plane_cells
from tccm_ros.rooms.segmentation import find_rooms
from tccm_ros.slam.occupancy import OccupancyGrid
from tccm_sim.office import office_panels, office_rooms, office_scene

RESOLUTION = 0.05


def grid_of(areas, holes=(), margin=1.0):
    """Return a grid that is free in some areas, but not in others, and unknown elsewhere."""
    bounds = np.array([area.bounds for area in areas])
    low, high = bounds[:, :2].min(axis=0) - margin, bounds[:, 2:].max(axis=0) + margin
    width, height = np.ceil((high - low) / RESOLUTION).astype(int)
    x = low[0] + (np.arange(width) + 0.5) * RESOLUTION
    y = low[1] + (np.arange(height) + 0.5) * RESOLUTION
    cells = np.full((height, width), -1, np.int8)
    for area in areas:
        cells[contains_xy(area, *np.meshgrid(x, y))] = 0
    for hole in holes:
        cells[contains_xy(hole, *np.meshgrid(x, y))] = -1
    return OccupancyGrid(cells, RESOLUTION, low)


def moved(points, yaw, shift):
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.asarray(points) @ R.T + shift


def flat(widths, depth, door, at, yaw=0.0, shift=(0.0, 0.0), thickness=0.12):
    """Return walls and rooms of a row of rooms with a door between neighbours."""
    ends = np.concatenate([[0.0], np.cumsum(widths)])
    walls = [((0, 0), (ends[-1], 0)), ((0, depth), (ends[-1], depth)),
             ((0, 0), (0, depth)), ((ends[-1], 0), (ends[-1], depth))]  # fmt: skip
    rooms = []
    for k, x in enumerate(ends[:-1]):
        left = x + (thickness if k else 0.0)
        rooms.append(np.array([(left, 0), (ends[k + 1], 0), (ends[k + 1], depth), (left, depth)]))
        if k:
            for face in (x, left):
                for low, high in ((0.0, at - door / 2), (at + door / 2, depth)):
                    walls.append(((face, low), (face, high)))
    return [moved(wall, yaw, shift) for wall in walls], [moved(r, yaw, shift) for r in rooms]


def overlaps(true, found):
    areas = [Polygon(ring) for ring in found]
    return [
        max((t.intersection(a).area / t.union(a).area for a in areas), default=0.0)
        for t in map(Polygon, true)
    ]


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(2.4, 5.0), min_size=1, max_size=4),
    st.floats(2.8, 5.5),
    st.floats(0.7, 1.0),
    st.floats(0.0, 1.0),
    st.floats(-np.pi, np.pi),
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
)
def test_rooms_in_a_row_are_found_in_any_direction(widths, depth, door, at, yaw, shift):
    at = 0.1 + door / 2 + at * (depth - door - 0.2)
    walls, rooms = flat(widths, depth, door, at, yaw, shift)
    found = find_rooms(walls, grid_of([Polygon(room) for room in rooms]))
    assert len(found) == len(rooms)
    assert min(overlaps(rooms, found)) > 0.95
    areas = [Polygon(ring) for ring in found]
    assert [a.area for a in areas] == sorted((a.area for a in areas), reverse=True)
    for k, one in enumerate(areas):
        assert one.exterior.is_ccw
        assert all(one.intersection(other).area < 1e-6 for other in areas[:k])


def test_a_gap_that_is_wider_than_a_door_makes_one_room():
    walls, _ = flat((3.5, 3.5), 4.0, 2.8, 2.0)
    found = find_rooms(walls, grid_of([Polygon(np.array([(0, 0), (7, 0), (7, 4), (0, 4)]))]))
    assert len(found) == 1
    assert Polygon(found[0]).area == pytest.approx(28.0, rel=0.02)


def test_furniture_belongs_to_the_room_in_which_it_stands():
    walls, rooms = flat((4.0, 4.0), 4.0, 0.9, 2.0)
    cupboard = [((0.6, 2.6), (0.6, 4.0)), ((0.0, 2.6), (0.6, 2.6))]
    counter = [((5.0, 0.6), (7.0, 0.6)), ((5.0, 0.0), (5.0, 0.6)), ((7.0, 0.0), (7.0, 0.6))]
    pillar = [((2.0, 1.0), (2.6, 1.0)), ((2.6, 1.0), (2.6, 1.6)), ((2.0, 1.6), (2.6, 1.6)),
              ((2.0, 1.0), (2.0, 1.6))]  # fmt: skip
    walls += [np.array(wall) for wall in (*cupboard, *counter, *pillar)]
    hidden = [box(0.0, 2.6, 0.6, 4.0), box(5.0, 0.0, 7.0, 0.6), box(2.0, 1.0, 2.6, 1.6)]
    found = find_rooms(walls, grid_of([Polygon(room) for room in rooms], hidden))
    assert len(found) == 2
    assert min(overlaps(rooms, found)) > 0.93


def test_unseen_space_is_no_room():
    walls, rooms = flat((4.0, 4.0), 4.0, 0.9, 2.0)
    found = find_rooms(walls, grid_of([Polygon(rooms[0])]))
    assert len(found) == 1
    assert overlaps(rooms[:1], found)[0] > 0.95


def test_a_room_of_which_a_wall_was_not_seen_ends_with_the_walls_around():
    walls, rooms = flat((4.0, 4.0), 4.0, 0.9, 2.0)
    without = [wall for wall in walls if not np.all(wall[:, 0] == 8.0)]
    found = find_rooms(without, grid_of([Polygon(room) for room in rooms]))
    assert min(overlaps(rooms, found)) > 0.95


def test_the_ten_offices_and_their_corridor_are_found():
    scene, rooms = office_scene(), office_rooms()
    assert len([panel for panel in office_panels() if panel.number]) == 10
    walls = [np.array(face) for face in scene.wall_faces]
    found = find_rooms(walls, grid_of([Polygon(room.boundary) for room in rooms]))
    values = overlaps([room.boundary for room in rooms], found)
    assert len(found) == 11
    assert min(values) > 0.9


def test_without_walls_there_are_no_rooms():
    assert find_rooms([], grid_of([box(0, 0, 1, 1)])) == []
    assert find_rooms([np.array([(0.0, 0.0), (0.3, 0.0)])], grid_of([box(0, 0, 1, 1)])) == []


@pytest.mark.parametrize("seed", range(20))
def test_walls_that_nearly_coincide_cut_the_plane_as_one(seed):
    rng = np.random.default_rng(seed)
    x, y = 4.5 + rng.normal(0.0, 0.003, (12, 2)), rng.uniform(-4.0, 0.0, 12)
    ends = np.stack([y, y + rng.uniform(0.5, 4.0, 12)], axis=1)
    walls = [np.stack([*wall], axis=1) for wall in zip(x, ends, strict=True)]
    walls += [np.array([[0.0, at], [9.0, at]]) for at in (-4.5, 4.5)]
    walls += [np.array([[at, -4.5], [at, 4.5]]) for at in (0.0, 9.0)]
    cells = [cell for cell in plane_cells(walls) if cell.area > 1.0]
    inside = [cell for cell in cells if box(0.0, -4.5, 9.0, 4.5).covers(cell.buffer(-0.01))]
    assert sum(cell.area for cell in inside) == pytest.approx(81.0, abs=1.0)


def near(value, steps=(0.0, 1e-9, 1e-4, 1e-3, 0.02)):
    """Return a strategy of numbers that nearly, or exactly, coincide with one."""
    return st.sampled_from([value + sign * step for step in steps for sign in (-1, 1)])


pieces_of_one_line = st.lists(
    st.tuples(near(-1.0) | st.floats(-2, 2), near(0.0), st.floats(0.05, 1.5), near(0.0)),
    min_size=1, max_size=6,
).map(lambda rows: [np.array([(x, y), (x + long, y + dy)]) for x, y, long, dy in rows])  # fmt: skip
corner = st.tuples(near(0.0), near(1.0)) | st.tuples(st.floats(-2, 2), st.floats(-2, 2))
chains = st.lists(corner, min_size=2, max_size=7).map(
    lambda points: [np.array(pair) for pair in pairwise(points)]
)
copies = st.tuples(corner, corner, st.lists(st.tuples(*[near(0.0)] * 4), max_size=5)).map(
    lambda made: [
        np.array(made[:2]) + np.reshape(shift, (2, 2)) for shift in [(0.0,) * 4, *made[2]]
    ]
)


@settings(max_examples=150)
@given(
    st.lists(pieces_of_one_line | chains | copies, min_size=1, max_size=2),
    st.sampled_from([0.0, np.pi / 2]) | st.floats(-np.pi, np.pi),
)
def test_degenerate_walls_give_rooms_or_none_without_error(parts, yaw):
    walls = [moved(wall, yaw, (0.0, 0.0)) for part in parts for wall in part]
    rooms = [Polygon(ring) for ring in find_rooms(walls, grid_of([box(-3, -3, 3, 3)]))]
    assert all(room.is_valid for room in rooms)
    overlap = sum(room.area for room in rooms) - union_all(rooms).area
    assert overlap == pytest.approx(0.0, abs=1e-6)
    if all(np.abs(wall @ [np.sin(yaw), -np.cos(yaw)]).max() < 0.1 for wall in walls):
        assert rooms == []


def test_three_pieces_of_one_wall_enclose_nothing():
    """The legs of a table before the one wall behind it."""
    walls = [np.array([(2.6, y), (2.6, y + 0.8)]) for y in (-2.0, -0.3, 1.1)]
    assert find_rooms(walls, grid_of([box(0, -2, 2.6, 2)])) == []
