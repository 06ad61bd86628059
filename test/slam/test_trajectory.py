"""Views between scans: where they hang, and how well that is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.slam.front_end import TrackedPose
from tccm_ros.slam.trajectory import OdometryTrack, poses_at_stamps

TILT_MOTION_NS = 500_000_000  # ns before and after the stamp: half a tilt cycle

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
    return poses_at_stamps([stamp_ns], [scan], [], odometry, MODEL)[0].cov


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


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 200), min_size=1, max_size=150), st.integers(-10, 210))
def test_odometry_in_any_order_is_that_of_its_last_samples_in_order(stamps, asked):
    track, known = OdometryTrack(), {}
    for x, stamp in enumerate(stamps):
        track.add(stamp, spatial(np.array([float(x), 0.0, 0.0])))
        known[stamp] = float(x)
    times = sorted(known)
    assert len(track) == len(times)
    assert track.first()[0] == known[times[0]]
    found = track.at(asked)
    if times[0] <= asked <= times[-1]:
        assert found[0] == pytest.approx(np.interp(asked, times, [known[t] for t in times]))
    else:
        assert found is None


def test_odometry_in_stamp_order_is_appended_in_place():
    odometry, buffers = OdometryTrack(), []
    for t in range(4096):
        odometry.add(t, spatial(np.array([float(t), 0.0, 0.0])))
        assert odometry.at(t)[0] == t
        if not buffers or buffers[-1] is not odometry.values.base:
            buffers.append(odometry.values.base)
    assert len(buffers) < 10  # each buffer has twice the size of the last
