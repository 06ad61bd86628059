"""Views between scans: where they hang, and how well that is known."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.slam.front_end import TrackedPose
from tccm_ros.slam.trajectory import TILT_MOTION_NS, OdometryTrack, poses_at_stamps

SECOND = 1_000_000_000
MODEL = Config().odometry


def covariance_of_a_view(speed, stamp_ns=5 * SECOND):
    """Return the covariance of a view at the very stamp of a scan, of a base at even speed."""
    odometry = OdometryTrack()
    for t in range(0, 10 * SECOND, SECOND // 50):
        odometry.add(t, spatial(np.array([speed * t / SECOND, 0.0, 0.0])))
    scan = TrackedPose(
        stamp_ns, 0, np.array([speed * stamp_ns / SECOND, 0.0, 0.0]), np.zeros((3, 3))
    )
    return poses_at_stamps([stamp_ns], [scan], [], odometry, MODEL)[2][0]


@pytest.mark.parametrize("speed", [0.05, 0.3, 1.0])
def test_the_covariance_of_a_view_grows_with_the_speed_of_the_base(speed):
    more = covariance_of_a_view(speed) - covariance_of_a_view(0.0)
    way = speed * TILT_MOTION_NS / SECOND
    assert more[0, 0] == pytest.approx(2 * (MODEL.sigma_per_m * way) ** 2, rel=1e-6)
    assert more[1, 1] == pytest.approx(more[0, 0])
    assert more[2, 2] == pytest.approx(2 * (MODEL.sigma_rad_per_m * way) ** 2, rel=1e-6)


def test_the_covariance_of_the_last_view_has_the_motion_before_it():
    middle, end = (
        covariance_of_a_view(0.3, t)[0, 0] for t in (5 * SECOND, 10 * SECOND - 20_000_000)
    )
    still = covariance_of_a_view(0.0)[0, 0]
    assert end - still == pytest.approx((middle - still) / 2)
