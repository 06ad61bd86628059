"""approach_node with stand-ins of Nav2's navigator and docking server."""

import math

import numpy as np
import pytest
from approach_driver import ABORTED, CANCELED, SUCCEEDED
from approach_world import simple_flat
from geometry_msgs.msg import PoseStamped
from live_robot import Listener

from tccm_ros.approach.outcome import Reason
from tccm_ros.approach.speeds import Speeds
from tccm_ros.geometry import compose2, inverse2, planar, pose_from_quaternion
from tccm_ros.nodes.interfaces import has_interfaces

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

FAR = (-2.4, 0.3, 3.0)
"""Where the base begins: its staging pose is more than a metre away."""


@pytest.fixture
def drive_by_nav2(ros, drive):
    pytest.importorskip("nav2_msgs", reason="nav2_msgs is not installed")
    from stand_in_nav2 import StandInNav2

    servers = []

    def make(*args, **values):
        driver = drive(*args, **values)
        nav2 = StandInNav2(driver.robot.node, driver.robot.base)
        servers.append(nav2.server)
        driver.robot.nav2 = nav2
        ros.spin_until(lambda: driver.node._navigator.is_ready, what="Nav2")
        return driver

    yield make
    for server in servers:
        server.destroy()


def test_nav2_drives_near_and_the_rest_is_driven_here(drive_by_nav2):
    driver = drive_by_nav2(simple_flat(None, (0.3, -0.2, 0.5), FAR))
    status, result = driver.ask()
    assert (status, result.success) == (SUCCEEDED, True), result.message
    robot = driver.robot
    gap, yaw = robot.base.true_figures()
    assert gap == pytest.approx(0.05, abs=0.02)
    assert abs(math.degrees(yaw)) < 1.5
    assert robot.base.contacts == 0
    assert len(robot.nav2.goals) >= 1
    # Its commands never mix with Nav2's; the zero before each goal of Nav2 may be late.
    assert sum(map(len, robot.other_commands)) > 20
    assert not any(later for steps in robot.other_commands for later in steps[2:-1])
    assert all(c == Speeds() for steps in robot.other_commands for step in steps for c in step)
    assert driver.stands()


def test_without_the_name_of_its_action_nav2_is_not_asked(drive):
    pytest.importorskip("nav2_msgs", reason="nav2_msgs is not installed")
    driver = drive(simple_flat(None, (0.0, 0.0, 0.0), FAR), approach__navigator="")
    assert driver.node._navigator is None


def test_cancelling_ends_the_goal_of_nav2(drive_by_nav2):
    driver = drive_by_nav2(simple_flat(None, (0.0, 0.0, 0.0), FAR))
    goal = driver.send()
    driver.robot.drive_until(lambda: driver.robot.nav2.is_driving and driver.robot.base.speed > 0.1)
    goal.cancel_goal_async()
    status, result = driver.result(goal)
    assert (status, result.reason) == (CANCELED, Reason.CANCELLED)
    assert not driver.robot.nav2.is_driving
    assert driver.stands()


def test_nav2_without_a_way_is_a_reason(drive_by_nav2):
    driver = drive_by_nav2(simple_flat(None, (0.0, 0.0, 0.0), FAR))
    driver.robot.nav2.refusal = "no valid path found"
    status, result = driver.ask()
    assert (status, result.reason) == (ABORTED, Reason.BLOCKED)
    assert "Nav2: no valid path found" in result.message
    assert driver.stands()


def test_docking_server_gets_the_base_pose_and_nothing_moves(drive):
    driver = drive(simple_flat(None, (0.3, -0.2, 0.5), (-1.4, 0.0, 0.0)))
    ear = Listener(driver.ros, "docking_server")
    poses = []
    ear.node.create_subscription(PoseStamped, "approach/detected_dock_pose", poses.append, 10)
    driver.ros.connect(driver.node, ear.node, "/approach/detected_dock_pose")
    base = driver.robot.base
    goal = driver.send(detect_only=True)
    driver.robot.drive_until(lambda: len(poses) > 2)
    assert driver.ask()[1].reason == Reason.BUSY
    p, q = poses[-1].pose.position, poses[-1].pose.orientation
    quaternion = np.array([q.x, q.y, q.z, q.w])
    docked = planar(pose_from_quaternion(np.array([p.x, p.y, p.z]), quaternion))
    assert poses[-1].header.frame_id == "odom"
    here = base.truth
    base.truth = compose2(compose2(here, inverse2(base.odom)), docked)
    gap, yaw = base.true_figures()
    base.truth = here
    assert gap == pytest.approx(0.05, abs=0.02)
    assert abs(math.degrees(yaw)) < 1.5
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in poses]
    assert (np.diff(stamps) > 0.0).all()
    goal.cancel_goal_async()
    status, result = driver.result(goal)
    assert (status, result.reason) == (CANCELED, Reason.CANCELLED)
    assert not driver.robot.commands


def test_docking_server_gets_no_missing_surface(drive):
    flat = simple_flat(None, (0.0, 0.0, 0.0), (-1.8, 0.0, 0.0))
    flat.target = flat.target.moved(0.0, 2.5, 0.0)
    driver = drive(flat, approach__patience=4.0)
    status, result = driver.ask(detect_only=True)
    assert (status, result.reason) == (ABORTED, Reason.LOST_SURFACE)
    assert "tilt cycles have not shown the surface for 4 s" in result.message
    assert not driver.robot.commands
