"""Scans with the heading of a gyroscope: no worse with it, and better where only it tells."""

from dataclasses import replace

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import between2, planar
from tccm_ros.records import Imu, PosedScan
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.wall_slam import WallSlam
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.motion import OdometryErrors
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

NOTHING = np.zeros((0, 2, 2))
SIGMA = 0.002
"""Noise of a heading, rad, and 1 mrad/s of a bias that is not known."""
BIAS = 0.001
SLIPPING = OdometryErrors(scale=1.01, yaw_scale=0.9, drift=0.05)


def with_headings(run, chosen=lambda k: True):
    """Return the scans of a run with a heading that is off by noise and bias; None where not."""
    random = np.random.default_rng(1)
    yaw = np.unwrap(run.truth[:, 2])
    noise = SIGMA * random.normal(size=len(yaw)) + 0.1 * BIAS * np.arange(len(yaw))
    return [
        replace(posed, heading=float(h) if chosen(k) else None)
        for k, (posed, h) in enumerate(zip(run.scans, yaw + noise))
    ]


def yaw_errors(run, scans):
    front, yaw = FrontEnd(Config()), []
    for posed in scans:
        front.add(make_level_scan(posed, Config()))
        yaw.append(front.pose[2])
    return np.abs(np.angle(np.exp(1j * (np.array(yaw) - run.truth[:, 2]))))


SQUARE = plan.route([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0)])


def test_heading_without_returns_is_that_of_the_gyroscope():
    run = plan.drive(NOTHING, SQUARE, drift=0.03)
    by_wheels = yaw_errors(run, run.scans)
    by_gyro = yaw_errors(run, with_headings(run))
    assert by_wheels[-1] > 0.3
    # Three sigmas of two headings, and 1 mrad/s over the drive.
    assert by_gyro.max() < 3.0 * 1.5 * SIGMA + 0.1 * BIAS * len(run.scans)


def test_a_gap_is_bridged_by_the_wheels():
    run = plan.drive(NOTHING, SQUARE, drift=0.0, noise=(0.0, 0.0))
    assert yaw_errors(run, with_headings(run, lambda k: not 60 < k < 80)).max() < 0.05


def test_a_robot_that_stands_is_not_turned_by_the_noise_of_a_gyroscope():
    run = plan.drive(NOTHING, np.zeros((100, 3)))
    assert yaw_errors(run, with_headings(run)).max() == 0.0


def mapped(world, *, imu):
    """Return the rms errors (m, rad) of a world's poses, its wheels slipping in turns."""
    options = Options(imu=True, tilt=False, self_hits=False)
    built = build_world(world, options)
    simulation = Simulation(replace(built, rig=replace(built.rig, errors=SLIPPING)), 3, options)
    robot, slam = Robot(Config(), default_streams(), expects_odometry=True), WallSlam(Config())
    roles = {topic: role for role, topic in vars(simulation.rig.topics).items()}
    stamps = []
    for message in simulation.run():
        role = roles.get(message.topic, message.topic.removeprefix("/"))
        for record in message.records:
            if isinstance(record, Imu) and not imu:
                continue
            for event in robot.add(role, record):
                if isinstance(event, PosedScan) and event.role == "scan":
                    assert imu or event.heading is None
                    slam.add_scan(event)
                    stamps.append(event.stamp_ns)
    solution = slam.solve()
    assert set(solution.stamps_ns) <= set(stamps)
    # In the lift, until its door opens on another floor.
    times = (solution.stamps_ns - EPOCH_NS) * 1e-9
    true = np.array([planar(T) for T in simulation.true_poses(times)])
    error = between2(between2(true[0], true), solution.poses)
    return np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))), np.sqrt(np.mean(error[:, 2] ** 2))


@pytest.mark.parametrize("world", ["turning", "round_hall", "lift"])
def test_a_drive_with_an_imu_is_not_worse_than_without(world):
    with_imu, without = mapped(world, imu=True), mapped(world, imu=False)
    # A millimetre and a millirad: noise of ranges, which both have in common, through other steps.
    assert with_imu[0] < without[0] + 0.001
    assert with_imu[1] < without[1] + 0.001
