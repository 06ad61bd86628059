"""Objects between solutions: those of the next one, at the live poses of the newer views."""

from itertools import permutations

import numpy as np
import pytest
from table_views import AHEAD, FIRST, SECOND, S, parts

from tccm_ros.config import Config
from tccm_ros.geometry import compose2, inverse2, spatial
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import Odometry
from tccm_ros.scene.live_objects import LiveObjects
from tccm_ros.scene.session_changes import scene_of


class Robot:
    """The processor that solves, and the objects between its solutions."""

    def __init__(self):
        self.slam, self.live = SurfaceSlam(Config()), LiveObjects(Config())

    def look(self, stamp_ns, pose, *cups, order=(0, 1, 2), live_pose=None):
        self.slam.add(Odometry(stamp_ns, "odom", "base", spatial(pose)))
        self.live.add_pose(stamp_ns, pose if live_pose is None else live_pose)
        view = parts(stamp_ns, pose, *cups)
        for k in order:
            self.slam.add(view[k])
        return [self.live.add(view[k]) for k in order]

    def solve(self):
        return scene_of(self.slam.solve(), "map")


def assert_same_objects(objects, expected):
    assert [(o.id, o.surface) for o in objects] == [(o.id, o.surface) for o in expected]
    for item, other in zip(objects, expected):
        np.testing.assert_allclose(item.center, other.center, atol=1e-3)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_objects_of_a_newer_view_are_those_of_the_next_solution(order):
    robot = Robot()
    robot.look(10 * S, np.zeros(3), FIRST)
    assert robot.live.scene() is None
    solution = robot.solve()
    assert robot.live.take(solution).objects is solution.objects
    assert robot.look(20 * S, AHEAD, FIRST, SECOND, order=order) == [False, False, True]
    scene, expected = robot.live.scene(), robot.solve()
    assert scene.stamp_ns == 20 * S
    assert scene.surfaces == solution.surfaces
    (cup,) = solution.objects
    assert [o.id for o in expected.objects] == [cup.id, cup.id + 2]
    assert_same_objects(scene.objects, expected.objects)
    np.testing.assert_allclose(scene.objects[1].center, [*SECOND, 0.8], atol=0.02)


def test_a_view_that_ends_during_a_solution_is_added_to_it():
    robot = Robot()
    robot.look(10 * S, np.zeros(3), FIRST)
    first = robot.solve()
    robot.look(20 * S, AHEAD, FIRST, SECOND)
    second = robot.solve()
    robot.live.take(first)
    robot.look(30 * S, AHEAD, FIRST, SECOND)
    shown = robot.live.take(second)
    assert shown.stamp_ns == second.stamp_ns
    assert [(o.id, o.views) for o in shown.objects] == [(0, 3), (2, 2)]
    assert_same_objects(shown.objects, robot.solve().objects)


def test_a_view_without_all_parts_waits_for_the_next_solution():
    robot = Robot()
    robot.look(10 * S, np.zeros(3), FIRST)
    solution = robot.live.take(robot.solve())
    robot.live.add_pose(20 * S, AHEAD)
    cloud, _, boxes = parts(20 * S, AHEAD, SECOND)
    assert not robot.live.add(cloud)
    assert not robot.live.add(boxes)
    assert robot.live.scene().objects is solution.objects
    assert not robot.live.add(parts(10 * S, AHEAD)[1]), "the solution has that view"


def test_a_correction_of_the_live_pose_moves_newer_views():
    robot, T = Robot(), np.array([0.1, -0.1, 0.2])
    robot.look(10 * S, np.zeros(3), FIRST)
    solution = robot.live.take(robot.solve())
    wrong = compose2(inverse2(T), AHEAD)
    robot.look(20 * S, AHEAD, FIRST, live_pose=wrong)
    assert np.linalg.norm(robot.live.scene().objects[-1].center[:2] - FIRST) > 0.1
    robot.live.add_pose(22 * S, wrong)
    robot.live.correct(T)
    robot.live.take(solution)
    for part in parts(21 * S, AHEAD, FIRST, SECOND):
        robot.live.add(part)
    for item, place in zip(robot.live.scene().objects, (FIRST, SECOND), strict=True):
        np.testing.assert_allclose(item.center, [*place, 0.8], atol=0.02)


def test_a_correction_places_objects_that_were_shown_before_it():
    robot, T = Robot(), np.array([0.1, -0.1, 0.2])
    robot.look(10 * S, np.zeros(3), FIRST)
    robot.live.take(robot.solve())
    robot.look(20 * S, AHEAD, FIRST, SECOND, live_pose=compose2(inverse2(T), AHEAD))
    wrong = [item.center[:2] for item in robot.live.scene().objects]
    assert np.linalg.norm(wrong[-1] - SECOND) > 0.1
    robot.live.correct(T)
    for item, place in zip(robot.live.scene().objects, (FIRST, SECOND), strict=True):
        np.testing.assert_allclose(item.center, [*place, 0.8], atol=0.02)


def test_views_that_are_dropped_leave_the_objects_of_the_solution():
    robot = Robot()
    robot.look(10 * S, np.zeros(3), FIRST)
    solution = robot.live.take(robot.solve())
    robot.look(20 * S, AHEAD, FIRST, SECOND)
    assert len(robot.live.scene().objects) == 2
    robot.live.drop_views()
    assert robot.live.scene().objects is solution.objects
    assert not any(map(robot.live.add, parts(30 * S, AHEAD, SECOND))), "no pose is known"
    assert robot.live.take(robot.solve()).objects, "the next solution has the view"


def test_an_older_view_that_becomes_whole_is_not_shown_again():
    robot = Robot()
    robot.look(10 * S, np.zeros(3), FIRST)
    robot.live.take(robot.solve())
    *before, last = parts(20 * S, AHEAD, FIRST, SECOND)
    robot.live.add_pose(20 * S, AHEAD)
    assert not any(map(robot.live.add, before))
    assert robot.look(30 * S, AHEAD, FIRST, SECOND)[-1]
    shown = robot.live.scene()
    assert not robot.live.add(last)
    assert_same_objects(robot.live.scene().objects, shown.objects)


def test_another_map_begins_without_objects():
    robot = Robot()
    robot.look(10 * S, np.zeros(3), FIRST)
    robot.live.take(robot.solve())
    robot.live.forget()
    assert not any(map(robot.live.add, parts(20 * S, AHEAD, FIRST))), "no pose is known"
    assert robot.live.scene() is None
