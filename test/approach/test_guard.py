"""Obstacles near the base: their extent, and the motion that they leave."""

import numpy as np
import pytest
from approach_world import ROBOT
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.approach.floor import Floor
from tccm_ros.approach.guard import Obstacles
from tccm_ros.approach.senses import Senses
from tccm_ros.approach.speeds import Speeds
from tccm_ros.slam.occupancy import OccupancyGrid

CUBE_M = 0.05
inside = st.floats(-0.5 * CUBE_M, 0.5 * CUBE_M)


def obstacles_of(*middles):
    """Return the obstacles of occupied cubes at middles (2,), for a base at the origin."""
    cuboids = np.array([[*middle, 0.4] for middle in middles])
    senses = Senses(0.0, np.zeros(3), 0.0, np.zeros(3), cuboids=cuboids, cube_m=CUBE_M)
    return Obstacles.of(senses, None, ROBOT.margin, 0.05, ROBOT.height)


@given(
    st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), inside, inside,
    st.sampled_from([(0.25, 0.0), (-0.25, 0.0), (0.0, 0.6), (0.0, -0.6)]),
)  # fmt: skip
def test_the_base_keeps_its_margin_from_every_point_of_a_cube(x, y, dx, dy, wanted):
    """A motion towards any point of the cube that is within the margin is stopped."""
    point = np.array([[x + dx, y + dy]])
    guarded = obstacles_of((x, y)).guard(
        Speeds(*wanted), np.zeros(3), ROBOT.footprint, ROBOT.limits
    )
    margins = np.array([ROBOT.margin])
    if ROBOT.footprint.distance(np.array([[x, y]]))[0] < 0.0:
        return  # the base is on it
    if wanted[0]:
        is_stopped = ROBOT.footprint.free_way(point, margins, np.sign(wanted[0])) < 1e-9
    else:
        is_stopped = abs(ROBOT.footprint.free_rotation(point, margins, wanted[1])) < 1e-9
    if is_stopped:
        assert guarded.speeds == Speeds()


@pytest.mark.parametrize("corner", [(-1, -1), (-1, 1), (1, -1), (1, 1)])
def test_the_floor_under_every_corner_of_a_cube_is_taken(corner):
    grid = OccupancyGrid(np.zeros((60, 60), np.int8), 0.05, np.array([-1.5, -1.5]))
    for middle in np.random.default_rng(0).uniform(-1.0, 1.0, (50, 2)):
        floor = Floor(grid, [], seen=obstacles_of(middle).others(ROBOT.margin))
        assert not floor.is_free((middle + 0.499 * CUBE_M * np.array(corner))[None])
