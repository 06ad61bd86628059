"""Whether level scans made of a camera's images tell how the robot moves."""

from pathlib import Path

import numpy as np
import plan
import pytest

from tccm_ros.calibrate.level_geometry import determines_pose, level_scans_help
from tccm_ros.config import Config

FRONT = np.array([[[2.0, -9.0], [2.0, 9.0]]])
BAGS = Path(__file__).resolve().parents[2] / "bags"


def arc(walls, seed=0):
    """Return a level scan of 60 deg to 3 m."""
    run = plan.drive(walls, np.zeros((1, 3)), seed=seed, beams=361, mount=(0, 0, 0))
    is_cut = np.abs(np.linspace(-90.0, 90.0, 361)) > 30.0
    scan = run.scans[0].scan
    scan.ranges[is_cut | (scan.ranges > 3.0)] = np.nan
    return run.scans[0]


@pytest.mark.parametrize(
    ("walls", "expected"),
    [
        (FRONT, False),
        (np.add(FRONT, [5.0, 0.0]), False),
        (np.concatenate([FRONT, [[[1.2, -0.6], [1.6, 0.0]]]]), True),
        (np.concatenate([FRONT, [[[0.5, 0.6], [2.0, 0.6]]]]), True),
    ],
    ids=["a front", "nothing in range", "a panel askew", "a corner"],
)
def test_single_front_leaves_the_motion_along_it_open(walls, expected):
    assert determines_pose(arc(walls), Config()) is expected


def test_level_geometry_is_estimated_from_images_of_a_kitchen():
    assert level_scans_help(BAGS / "rgbd_kitchen", "depth")
