"""Obstacles that left the field of view are kept; those that it shows to be gone are not."""

import numpy as np
from approach_world import CUBE_M

from tccm_ros.approach.obstacle_memory import ObstacleMemory
from tccm_ros.approach.readings import TopCycle

NOTHING = np.zeros((0, 3))
CUBES = np.array([[1.0, 0.0, 0.7], [1.05, 0.0, 0.7], [0.5, -1.0, 0.4]])


def cycle(yaw):
    """Return a tilt cycle of floor ahead, 0.6 m and more from a sensor at 1.2 m."""
    bearing, way = np.meshgrid(yaw + np.linspace(-0.8, 0.8, 81), np.linspace(0.6, 3.0, 20))
    points = np.stack([way * np.cos(bearing), way * np.sin(bearing), 0.0 * way], axis=-1)
    return TopCycle(0.0, points.reshape(-1, 3), np.array([0.0, 0.0, 1.2]))


def rows(points):
    return sorted(map(tuple, points.tolist()))


def remembered():
    made = ObstacleMemory(CUBE_M)
    made.add(CUBES, np.zeros(2))
    made.add(NOTHING, np.zeros(2))
    return made


def test_obstacles_missing_in_the_newest_message_are_kept_once():
    made = remembered()
    assert rows(made.points) == rows(CUBES)
    made.add(CUBES, np.zeros(2))
    made.add(NOTHING, np.zeros(2))
    assert rows(made.points) == rows(CUBES)


def test_obstacles_in_view_are_forgotten_unless_measured_again():
    made = remembered()
    made.forget_visible(cycle(0.0))
    assert rows(made.points) == rows(CUBES[2:])
    made.add(CUBES[:1], np.zeros(2))
    made.forget_visible(cycle(0.0))
    assert rows(made.points) == rows(CUBES[[0, 2]])


def test_obstacles_below_the_field_of_view_are_kept():
    made = ObstacleMemory(CUBE_M)
    made.add(np.array([[0.4, 0.0, 0.3]]), np.zeros(2))
    made.add(NOTHING, np.zeros(2))
    made.forget_visible(cycle(0.0))
    assert len(made.points) == 1


def test_obstacles_far_from_the_base_are_forgotten():
    made = remembered()
    made.add(NOTHING, np.array([-2.0, 0.0]))
    assert not len(made.points)
