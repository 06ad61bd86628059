"""Base poses in occupancy grids: every one is free, within reach and turned to the place."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from outlined_surfaces import surface
from shapely import affinity, box

from tccm_ros.scene.base_poses import FreeFloor, cells_under
from tccm_ros.slam.occupancy import OccupancyGrid

ORIGIN = np.array([-2.0, -1.0])
STEP = 0.05


def room(side: int = 80) -> np.ndarray:
    """Return a free room with walls and a table's legs."""
    cells = np.zeros((side, side), np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return cells


def distance_to_blocked(cells: np.ndarray, x: float, y: float) -> float:
    """Return the distance of a point from the nearest cell that is not free, cell by cell."""
    rows, columns = np.nonzero(cells != 0)
    low_x, low_y = ORIGIN[0] + columns * STEP, ORIGIN[1] + rows * STEP
    dx = np.maximum(np.maximum(low_x - x, x - low_x - STEP), 0.0)
    dy = np.maximum(np.maximum(low_y - y, y - low_y - STEP), 0.0)
    return float(np.hypot(dx, dy).min())


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(-2, 2),
    st.floats(-1, 3),
    st.floats(0.3, 1.2),
    st.floats(0.05, 0.4),
)
def test_every_base_pose_is_free_in_reach_and_faces_the_place(seed, x, y, reach, radius):
    cells = room()
    rng = np.random.default_rng(seed)
    blocked = rng.integers(1, 79, (40, 2))
    cells[blocked[:, 0], blocked[:, 1]] = rng.choice([100, -1], 40)
    place = np.array([x, y, 0.7])
    found = FreeFloor(OccupancyGrid(cells, STEP, ORIGIN)).base_poses(place, reach, radius, 5)
    for pose in found:
        assert math.hypot(pose.x - x, pose.y - y) <= reach
        free = distance_to_blocked(cells, pose.x, pose.y) - radius
        assert free >= pose.clearance - 1e-9
        assert pose.clearance > 0.0
        ahead = np.array([math.cos(pose.yaw), math.sin(pose.yaw)]) * pose.distance
        assert np.allclose(np.array([pose.x, pose.y]) + ahead, (x, y))
    assert [p.distance for p in found] == sorted(p.distance for p in found)


def test_a_place_in_the_open_has_as_many_as_asked():
    found = FreeFloor(OccupancyGrid(room(), STEP, ORIGIN)).base_poses(
        np.array([0.0, 1.0]), 0.8, 0.3, 4
    )
    assert len(found) == 4
    pairs = [(a, b) for k, a in enumerate(found) for b in found[k + 1 :]]
    assert all(math.hypot(a.x - b.x, a.y - b.y) >= 0.3 - 1e-9 for a, b in pairs)


def test_unknown_floor_and_space_outside_the_grid_are_not_free():
    unknown = FreeFloor(OccupancyGrid(np.full((80, 80), -1, np.int8), STEP, ORIGIN))
    assert unknown.base_poses(np.array([0.0, 1.0]), 0.8, 0.2, 3) == []
    free = FreeFloor(OccupancyGrid(np.zeros((80, 80), np.int8), STEP, ORIGIN))
    assert free.base_poses(np.array([9.0, 9.0]), 0.8, 0.2, 3) == []


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(-2, 2), st.floats(-1, 3), st.floats(0.3, 1.5))
def test_nearest_base_pose_is_in_the_nearest_cell_with_enough_space(seed, x, y, reach):
    """Cell by cell; to another cell it is less by half a diagonal than from middle to middle."""
    side, radius = 40, 0.15
    cells = np.zeros((side, side), np.int8)
    rng = np.random.default_rng(seed)
    cells[rng.integers(0, side, 25), rng.integers(0, side, 25)] = 100
    around = np.pad(cells, 1, constant_values=-1)
    blocked = np.argwhere(around != 0) - 1
    nearest = math.inf
    for row, column in np.argwhere(cells == 0):
        clearance = np.hypot(*(blocked - (row, column)).T).min() - math.sqrt(0.5)
        middle = ORIGIN + (np.array([column, row]) + 0.5) * STEP
        distance = math.hypot(middle[0] - x, middle[1] - y)
        if clearance * STEP > radius and distance <= reach:
            nearest = min(nearest, distance)
    found = FreeFloor(OccupancyGrid(cells, STEP, ORIGIN)).base_poses(
        np.array([x, y]), reach, radius, 1
    )
    assert [p.distance for p in found] == pytest.approx([nearest] if nearest < math.inf else [])


@pytest.mark.parametrize("middle", [(1.0, 0.2), (-1.2, 2.1), (-2.0, 0.5), (3.0, 9.0)])
def test_cells_under_surfaces_are_those_whose_middle_is_in_an_outline(middle):
    """Cell by cell, at any place of the grid, over its edge and outside of it."""
    outline = affinity.translate(affinity.rotate(box(-0.6, -0.3, 0.6, 0.3), 25.0), *middle)
    grid = OccupancyGrid(room(), STEP, ORIGIN)
    floor = surface(box(-9.0, -9.0, 9.0, 9.0), height=0.0, label="floor")
    found = cells_under([surface(outline), floor], grid)
    rows, columns = np.indices(grid.cells.shape) + 0.5
    inside = shapely.contains_xy(outline, ORIGIN[0] + columns * STEP, ORIGIN[1] + rows * STEP)
    assert (found != inside).sum() <= 2  # a middle on the edge, by rounding
    assert found.any() == (middle[1] < 9.0)
