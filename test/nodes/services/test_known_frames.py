"""Poses of frames against the closed form of a small robot."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.nodes.services.known_frames import KnownFrames
from tccm_ros.records import JointSample, Odometry, RobotDescription, TransformSample
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams

URDF = """<robot name="r">
  <link name="base_link"/><link name="torso"/><link name="head"/>
  <joint name="lift" type="prismatic"><parent link="base_link"/><child link="torso"/>
    <origin xyz="0.1 0 0.5"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="pan" type="revolute"><parent link="torso"/><child link="head"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
</robot>"""

X, Y, YAW, LIFT, PAN = 2.0, -1.0, 0.5, 0.2, 0.3


def pose(x, y, z, yaw):
    """Return T float64 (4, 4) of a turn about z and a translation."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def known(*records):
    """Return the frames of a robot that has heard some records, each with its role."""
    config = Config()
    robot = Robot(config, default_streams(config), expects_odometry=True)
    for role, record in records:
        robot.add(role, record)
    robot.flush()
    return KnownFrames(SimpleNamespace(robot=robot, lock=threading.RLock()), config)


def model():
    return "robot_description", RobotDescription(URDF)


def odometry(stamp_ns=1_000, x=X):
    return "odom", Odometry(stamp_ns, "odom", "base_link", pose(x, Y, 0.0, YAW))


def joints(stamp_ns=1_000):
    return "joint_states", JointSample(stamp_ns, ("lift", "pan"), np.array([LIFT, PAN]))


def island():
    return "tf_static", TransformSample(0, "island", "shore", np.eye(4), is_static=True)


def test_a_link_is_where_odometry_and_joints_put_it():
    frames = known(model(), odometry(), odometry(2_000), joints(), joints(2_000))
    assert frames.base == "base_link"
    base = pose(X, Y, 0.0, YAW)
    assert np.allclose(frames.T_odom_frame("base_link"), base, atol=1e-12)
    torso = base @ pose(0.1, 0.0, 0.5 + LIFT, 0.0)
    assert np.allclose(frames.T_odom_frame("torso"), torso, atol=1e-12)
    assert np.allclose(frames.T_odom_frame("head"), torso @ pose(0, 0, 0.4, PAN), atol=1e-12)


def test_the_newest_odometry_counts():
    frames = known(model(), odometry(1_000_000_000, 0.0), odometry(2_000_000_000, 7.0))
    assert frames.T_odom_frame("base_link")[0, 3] == pytest.approx(7.0)


def test_the_odometry_frame_is_itself_and_a_leading_slash_is_ignored():
    frames = known(model(), odometry())
    assert np.array_equal(frames.T_odom_frame("odom"), np.eye(4))
    assert np.array_equal(frames.T_odom_frame("/odom"), np.eye(4))
    assert np.allclose(frames.T_odom_frame("/base_link"), frames.T_odom_frame("base_link"))


@pytest.mark.parametrize(
    ("records", "frame", "said"),
    [
        ((), "base_link", "nothing is known of the robot yet"),
        ((model(), odometry()), "tors", "no frame 'tors'.*torso"),
        ((model(), odometry(), island()), "shore", "no way from 'base_link' to 'shore'"),
        ((model(), odometry()), "torso", "nothing was heard of a joint"),
    ],
)
def test_unknown_frames_are_reported(records, frame, said):
    with pytest.raises(FrameError, match=said):
        known(*records).T_odom_frame(frame)
