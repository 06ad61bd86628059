"""Obstacles near the base: their extent, and the motion that they leave."""

import numpy as np
import pytest
from approach_world import ROBOT
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon

from tccm_ros.approach.floor import Floor
from tccm_ros.approach.guard import Obstacles
from tccm_ros.approach.readings import Readings
from tccm_ros.approach.speeds import Speeds
from tccm_ros.geometry import inverse2, transform2
from tccm_ros.slam.occupancy import OccupancyGrid

CUBE_M = 0.05
inside = st.floats(-0.5 * CUBE_M, 0.5 * CUBE_M)


def obstacles_of(*middles):
    """Return the obstacles of occupied cubes at middles (2,), for a base at the origin."""
    cuboids = np.array([[*middle, 0.4] for middle in middles])
    readings = Readings(0.0, np.zeros(3), 0.0, np.zeros(3), obstacle_points=cuboids, cube_m=CUBE_M)
    return Obstacles.of(readings, None, ROBOT.margin, 0.05, ROBOT.height)


@given(
    st.floats(-0.35, 0.35), st.floats(-0.35, 0.35), inside, inside,
    st.sampled_from([(0.25, 0.0), (-0.25, 0.0), (0.0, 0.6), (0.0, -0.6)]),
)  # fmt: skip
def test_a_motion_towards_a_cube_with_a_point_within_the_margin_is_stopped(x, y, dx, dy, wanted):
    """Towards: 5 cm or 0.05 rad of it bring the middle of the cube nearer by more than 1 mm."""
    middle = np.array([[x, y]])
    before = ROBOT.footprint.distance(middle)[0]
    motion = np.array([0.05 * np.sign(wanted[0]), 0.0, 0.05 * np.sign(wanted[1])])
    after = ROBOT.footprint.distance(transform2(inverse2(motion), middle))[0]
    body = Polygon(ROBOT.footprint.corners)
    is_within = body.distance(Point(x + dx, y + dy)) < ROBOT.margin
    guarded = obstacles_of((x, y)).guard(
        Speeds(*wanted), np.zeros(3), ROBOT.footprint, ROBOT.limits
    )
    is_on_it = before < 0.0
    is_towards = after < before - 1e-3
    assert is_on_it or not (is_within and is_towards) or guarded.speeds == Speeds()


@pytest.mark.parametrize("corner", [(-1, -1), (-1, 1), (1, -1), (1, 1)])
def test_the_floor_under_every_corner_of_a_cube_is_taken(corner):
    grid = OccupancyGrid(np.zeros((60, 60), np.int8), 0.05, np.array([-1.5, -1.5]))
    for middle in np.random.default_rng(0).uniform(-1.0, 1.0, (50, 2)):
        floor = Floor(grid, [], seen=obstacles_of(middle).others(ROBOT.margin))
        assert not floor.is_free((middle + 0.499 * CUBE_M * np.array(corner))[None])
