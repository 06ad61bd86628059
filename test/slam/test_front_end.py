"""A robot that stands before plain walls that go on beyond the laser's range."""

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.level_scan import make_level_scan

FRONT = np.array([[[1.0, -60.0], [1.0, 60.0]]])
STANDING = np.zeros((80, 3))


@pytest.mark.parametrize("sigma", [0.005, 0.010])
@pytest.mark.parametrize("distance", [0.4, 1.0, 3.0])
def test_a_robot_that_stands_before_a_front_from_the_start_stays(distance, sigma):
    run = plan.drive(FRONT * [distance, 1.0], STANDING, sigma=sigma, beams=361, mount=(0, 0, 0))
    front, poses = FrontEnd(Config()), []
    for posed in run.scans:
        front.add(make_level_scan(posed, Config()))
        poses.append(front.pose)
    assert np.hypot(*np.transpose(poses)[:2]).max() < 0.010
    assert np.abs(np.transpose(poses)[2]).max() < np.radians(0.2)
