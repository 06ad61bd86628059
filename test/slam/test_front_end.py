"""Where geometry says little, odometry rules: plain walls that go on beyond the laser's range."""

from dataclasses import replace

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import between2, planar
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.odometry_model import odometry_covariance

FRONT = np.array([[[1.0, -60.0], [1.0, 60.0]]])
CORRIDOR = np.array([[[-60.0, 1.0], [90.0, 1.0]], [[-60.0, -1.0], [90.0, -1.0]]])
STANDING = np.zeros((80, 3))
NICHES = np.concatenate([CORRIDOR, *(plan.box(x, 0.7, x + 0.4, 1.0) for x in (2, 5, 9))])


def follow(run):
    """Return the front end after a run, and its poses (N, 3)."""
    front, poses = FrontEnd(Config()), []
    for posed in run.scans:
        front.add(make_level_scan(posed, Config()))
        poses.append(front.pose)
    return front, np.array(poses)


@pytest.mark.parametrize("sigma", [0.005, 0.010])
@pytest.mark.parametrize("distance", [0.4, 1.0, 3.0])
def test_a_robot_that_stands_before_a_front_from_the_start_stays(distance, sigma):
    run = plan.drive(FRONT * [distance, 1.0], STANDING, sigma=sigma, beams=361, mount=(0, 0, 0))
    _, poses = follow(run)
    assert np.hypot(*poses.T[:2]).max() < 0.010
    assert np.abs(poses[:, 2]).max() < np.radians(0.2)


@pytest.mark.parametrize("seed", range(6))
def test_a_robot_that_stands_before_a_pole_keeps_its_heading(seed):
    """A pole hardly shows the heading: what noise adds to it must not add up from scan to scan."""
    angles = np.linspace(0.0, 2.0 * np.pi, 13)
    ring = np.column_stack([2.5 + 0.15 * np.cos(angles), 0.8 + 0.15 * np.sin(angles)])
    pole = np.stack([ring[:-1], ring[1:]], axis=1)
    run = plan.drive(pole, np.zeros((200, 3)), seed=seed, beams=361, mount=(0, 0, 0))
    _, poses = follow(run)
    assert np.hypot(*poses.T[:2]).max() < 0.010
    assert np.abs(poses[:, 2]).max() < np.radians(0.2)


def test_without_odometry_a_motion_that_nothing_observes_decays():
    """The robot was driving, and matching saw it, before it came to where nothing tells."""
    approach = np.column_stack([np.linspace(0.0, 3.0, 31), np.zeros((31, 2))])
    run = plan.drive(NICHES, approach, beams=361, odometry=False)
    front = FrontEnd(Config())
    for posed in run.scans:
        front.add(make_level_scan(posed, Config()))
    seen = front.pose
    plain = plan.drive(CORRIDOR, STANDING[:30], beams=361, odometry=False)
    for k, posed in enumerate(plain.scans):
        scan = replace(posed.scan, stamp_ns=run.scans[-1].scan.stamp_ns + (k + 1) * 10**8)
        front.add(make_level_scan(replace(posed, record=scan), Config()))
    # At 1 m/s, a motion that decays in 0.5 s goes on for 0.5 m, one that does not for 3 m.
    assert between2(seen, front.pose)[0] < 0.8


@pytest.mark.parametrize("seed", range(3))
def test_along_a_plain_corridor_the_motion_is_that_of_odometry(seed):
    poses = np.column_stack([np.arange(0.0, 25.0, 0.1), np.zeros((250, 2))])
    run = plan.drive(CORRIDOR, poses, seed=seed, beams=361, scale=1.01, drift=0.0)
    front, found = follow(run)
    odometry = planar(run.scans[-1].T_odom_base[0])
    assert abs(found[-1, 0] - odometry[0]) < 0.05
    assert abs(found[-1, 1]) < 0.03
    # Nothing shows the scale there, and the covariance is odometry's.
    assert front._scale.value == pytest.approx(1.0, abs=0.002)
    last = [t for t in front.tracked if t.pose[0] > 0.2][-1]
    by_odometry = odometry_covariance(last.pose, Config().odometry)
    assert last.cov[0, 0] == pytest.approx(by_odometry[0, 0], rel=0.1)
    assert last.cov[1, 1] < 0.2 * by_odometry[1, 1]
