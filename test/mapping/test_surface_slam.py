"""Whether the base stood still between two stamps: it moves in x, in y or by yaw."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam

SHIFT, YAW = 0.01, 0.005  # m, rad: motions that are below the errors of odometry


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        ((0.0, 0.0, 0.0), True),
        ((0.9 * SHIFT, 0.0, 0.9 * YAW), True),
        ((2.0 * SHIFT, 0.0, 0.0), False),
        ((0.0, -2.0 * SHIFT, 0.0), False),
        ((0.8 * SHIFT, 0.8 * SHIFT, 0.0), False),
        ((0.0, 0.0, -2.0 * YAW), False),
        (None, False),
    ],
)
def test_a_base_that_moves_is_not_stationary(motion, expected, monkeypatch):
    slam = SurfaceSlam(Config())
    known = None if motion is None else np.array(motion)
    monkeypatch.setattr(slam.wall_slam, "motion_between", lambda first_ns, last_ns: known)
    assert slam._is_stationary(1, 2) is expected
