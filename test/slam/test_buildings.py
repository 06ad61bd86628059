"""Whole runs in buildings that are hard to map: no wrong loop, and the way back is found.

Stand-ins for logs that are not here. Short versions; `bench/slam_buildings.py` has the long ones.
"""

import buildings
import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import between2
from tccm_ros.slam.wall_slam import WallSlam


def solve(building, robot, *, seed=0, walls=True):
    run = buildings.drive(building, robot, seed=seed)
    config = Config()
    config.walls.enabled = walls
    slam = WallSlam(config)
    for scan in run.scans:
        slam.add_scan(scan)
    return run, slam.solve()


@pytest.mark.parametrize("alike", [True, False])
def test_offices_that_look_the_same_are_not_confused(alike):
    """Four rooms on a side, all alike: 1 cm of noise and a drift of 4 mrad/m leave 5 cm at most."""
    run, solution = solve(buildings.offices(4, alike=alike), buildings.ROBOTS["slipping"])
    accepted, wrong = buildings.loops_of(run, solution)
    assert accepted >= 10
    assert wrong == 0
    assert plan.errors(run.truth, solution.poses)[0] < 0.05


@pytest.mark.parametrize("robot", ["slipping", "seldom", "crowded"])
def test_a_court_with_the_same_doors_on_all_sides_is_mapped(robot):
    """Odometry ends metres away; along a corridor only door niches of 15 cm hold the robot."""
    run, solution = solve(buildings.court(36.0, 16.0), buildings.ROBOTS[robot])
    accepted, wrong = buildings.loops_of(run, solution)
    assert accepted >= 10
    assert wrong == 0
    odometry = np.stack([plan.planar(s.T_odom_base[0]) for s in run.scans])
    error = plan.errors(run.truth, solution.poses)[0]
    assert error < 0.25
    assert error < 0.1 * plan.errors(run.truth, odometry)[0]


@pytest.mark.parametrize("seed", [0, 1])
def test_people_who_walk_along_with_the_robot_do_not_disturb_the_map(seed):
    """Six of them ahead hide much of the building, and are always where they were a scan before."""
    building = buildings.offices(5, alike=False)
    run, solution = solve(building, buildings.ROBOTS["accompanied"], seed=seed)
    accepted, wrong = buildings.loops_of(run, solution)
    assert accepted >= 5
    assert wrong == 0
    assert plan.errors(run.truth, solution.poses)[0] < 0.25


def test_people_who_walk_along_a_corridor_do_not_shorten_the_path():
    """Walls on both sides look the same everywhere: standing still would explain all but niches."""
    run, solution = solve(buildings.block(20.0), buildings.ROBOTS["accompanied"])
    accepted, wrong = buildings.loops_of(run, solution)
    assert accepted >= 5
    assert wrong == 0
    assert plan.errors(run.truth, solution.poses)[0] < 0.1


def test_similar_rooms_along_a_corridor_are_not_confused():
    run, solution = solve(buildings.rooms(4, spread=0.05), buildings.ROBOTS["fine"])
    accepted, wrong = buildings.loops_of(run, solution)
    assert accepted >= 10
    assert wrong == 0
    assert plan.errors(run.truth, solution.poses)[0] < 0.05


def test_wrong_odometry_scale_is_corrected_in_corridors():
    """10 % too short: where walls ahead show it, it is learnt, and the corridors are as long."""
    run, solution = solve(buildings.court(50.0, 20.0), buildings.ROBOTS["coarse"])
    assert buildings.loops_of(run, solution)[1] == 0
    assert plan.errors(run.truth, solution.poses)[0] < 0.15


@pytest.mark.parametrize("seed", [0, 2])
def test_plain_corridors_are_mapped_in_spite_of_noise(seed):
    """Ranges are off by 2.5 cm, and a niche of 10 cm each 6 to 10 m is all that tells the place."""
    building = buildings.plain_block(30.0, seed=seed)
    run, solution = solve(building, buildings.ROBOTS["noisy"], seed=seed)
    accepted, wrong = buildings.loops_of(run, solution)
    assert accepted >= 20
    assert wrong == 0
    assert plan.errors(run.truth, solution.poses)[0] < 0.1


def test_wall_landmarks_do_not_increase_the_error_behind_glass():
    building = buildings.block(20.0, glass=0.6)
    run, solution = solve(building, buildings.ROBOTS["crowded"])
    _, without = solve(building, buildings.ROBOTS["crowded"], walls=False)
    assert buildings.loops_of(run, solution)[1] == 0
    error = plan.errors(run.truth, solution.poses)[0]
    # 3 mm: what either leaves by chance.
    assert error <= 1.05 * plan.errors(run.truth, without.poses)[0] + 0.003
    assert error < 0.1


def test_loops_of_counts_a_wrong_loop_closure():
    """`loops_of`, on which the tests above rest, counts a loop closure that is half a metre off."""
    run, solution = solve(buildings.offices(2), buildings.ROBOTS["good"])
    loop = next(x for x in solution.loops if x.accepted)
    loop.delta[:] = between2(np.array([0.6, 0.0, 0.0]), loop.delta)
    assert buildings.loops_of(run, solution)[1] == 1
