"""Roll and pitch by an IMU against closed forms: a base that stands askew after a drive."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import MS, START, joint, robot, scan_at
from scipy.spatial.transform import Rotation

from tccm_ros.config import Config
from tccm_ros.geometry import pose_from_roll_pitch, pose_from_rpy
from tccm_ros.records import Imu, Odometry, RobotDescription, RollPitch
from tccm_ros.robot import Robot
from tccm_ros.robot.roll_pitch import significant
from tccm_ros.sensors.registry import default_streams

G = np.array([0.0, 0.0, 9.81])
DEG = np.pi / 180.0
RATE_BIAS, FORCE_BIAS = np.array([0.01, -0.01, 0.02]), np.array([0.2, -0.3, 0.1])
STAND_S, DRIVE_S, SPEED = 3.0, 4.0, 0.5
"""It stands, drives, and stands again; its speed is that of a sine."""
SECONDS = 2 * STAND_S + DRIVE_S
ARM = np.array([0.2, 0.1, 0.3])
"""Where the IMU is in the base, m."""
ROTATED = "0.5 -0.4 2.0"


def acceleration_at(t):
    """Return the acceleration (m/s2) ahead."""
    w, since = 2.0 * np.pi / DRIVE_S, np.clip(t - STAND_S, 0.0, DRIVE_S)
    return SPEED * w * np.sin(w * since) * (STAND_S < t < STAND_S + DRIVE_S)


def tilt_at(t, tilt):
    """Return roll and pitch (2,), and their rates: they come when the drive has ended, in 0.4 s."""
    since = (t - STAND_S - DRIVE_S - 0.1) / 0.4
    return np.clip(since, 0.0, 1.0) * np.array(tilt), (0.0 < since < 1.0) * np.array(tilt) / 0.4


def imu_at(stamp, t, tilt, R_base_imu, random, turned=0.0):
    """Return what an IMU measures that is fixed to the base at `ARM`, with bias and noise."""
    (roll, pitch), (roll_rate, pitch_rate) = tilt_at(t, tilt)
    yaw_rate = turned / DRIVE_S * (STAND_S < t < STAND_S + DRIVE_S)
    R = Rotation.from_euler("xyz", [roll, pitch, 0.0]).as_matrix()
    # While it turns, on a circle: towards its middle, and the IMU about the base.
    speed = SPEED * (1.0 - np.cos(2.0 * np.pi / DRIVE_S * np.clip(t - STAND_S, 0.0, DRIVE_S)))
    force = R.T @ G + [acceleration_at(t), speed * yaw_rate, 0.0] - yaw_rate**2 * ARM * [1, 1, 0]
    rates = np.array([roll_rate, pitch_rate, yaw_rate]) + RATE_BIAS
    return Imu(
        stamp,
        "imu_link",
        R_base_imu.T @ (rates + 0.002 * random.normal(size=3)),
        R_base_imu.T @ (force + FORCE_BIAS + 0.05 * random.normal(size=3)),
    )


def records(tilt=(0.0, 0.0), *, rpy="0 0 0", period_ms=10, change=lambda r, t: r, turned=0.0):
    """Return (role, record) by stamp; `change` gives another IMU record, or None."""
    random = np.random.default_rng(0)
    R_base_imu = Rotation.from_euler("xyz", [float(v) for v in rpy.split()]).as_matrix()
    text = robot([joint("a", "fixed", "base", "laser"),
                  joint("b", "fixed", "base", "imu_link", "0.2 0.1 0.3", rpy)])  # fmt: skip
    found = [(0, "robot_description", RobotDescription(text))]
    for us in range(0, round(SECONDS * 1e6), round(period_ms * 1e3)):
        stamp, t = START + us * 1000, us * 1e-6
        record = change(imu_at(stamp, t, tilt, R_base_imu, random, turned), t)
        if record is not None:
            found.append((stamp, "imu", record))
    for ms in range(0, round(SECONDS * 1e3), 20):
        stamp, t = START + ms * MS, ms * 1e-3
        found.append((stamp, "odom", odometry_at(stamp, t, turned)))
        if ms % 100 == 60:
            found.append((stamp, "scan", scan_at(stamp, time_increment=0.01)))
    return sorted(found, key=lambda item: item[0])


@lru_cache
def arc(turned):
    """Return x, y and yaw of an arc every ms of the drive, float64 (N, 3)."""
    since = np.arange(0.0005, DRIVE_S, 0.001)
    speed = SPEED * (1.0 - np.cos(2.0 * np.pi / DRIVE_S * since))
    yaw = turned / DRIVE_S * since
    steps = 0.001 * np.column_stack(
        [speed * np.cos(yaw), speed * np.sin(yaw), np.full(len(yaw), turned / DRIVE_S)]
    )
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def odometry_at(stamp, t, turned):
    x, y, yaw = arc(turned)[round(1e3 * np.clip(t - STAND_S, 0.0, DRIVE_S))]
    return Odometry(stamp, "odom", "base", pose_from_rpy((x, y, 0.0, 0.0, 0.0, yaw)))


def posed(found):
    """Return the times (N,) of the scans, s, and T_odom_base (N, 4, 4) at their stamps."""
    one = Robot(Config(), default_streams(), expects_odometry=True)
    events = [e for _, role, record in found for e in one.add(role, record)] + one.flush()
    scans = [e for e in events if getattr(e, "role", "") == "scan" and hasattr(e, "heading")]
    assert len(scans) == sum(role == "scan" for _, role, _ in found)
    times = np.array([(p.stamp_ns - START) * 1e-9 for p in scans])
    one.roll_pitch = [e for e in events if isinstance(e, RollPitch)]
    return times, np.array([p.T_odom_base[0] for p in scans]), one


def without_imu(found):
    return [item for item in found if item[1] != "imu"]


AT_END = slice(-10, None)
"""The scans of the last second, when gravity has been averaged."""


@pytest.mark.parametrize("rpy", ["0 0 0", ROTATED, f"{np.pi} 0 0"])
@pytest.mark.parametrize("period_ms", [10, 2.5])
def test_the_left_side_goes_up_with_roll_and_the_front_down_with_pitch(rpy, period_ms):
    """A beam of 3 m to the left, 52 mm off without, is within 4.5 mm: the sigma that is told."""
    roll = records((DEG, 0.0), rpy=rpy, period_ms=period_ms)
    left, ahead = np.array([0.0, 3.0, 0.0, 1.0]), np.array([3.0, 0.0, 0.0, 1.0])
    _, T, _ = posed(roll)
    assert (T[AT_END] @ left)[:, 2] == pytest.approx(3.0 * np.sin(DEG), abs=0.0045)
    assert (T[AT_END] @ ahead)[:, 2] == pytest.approx(0.0, abs=0.0045)
    assert (posed(without_imu(roll))[1] @ left)[:, 2] == pytest.approx(0.0)
    _, T, _ = posed(records((0.0, DEG), rpy=rpy, period_ms=period_ms))
    assert (T[AT_END] @ ahead)[:, 2] == pytest.approx(-3.0 * np.sin(DEG), abs=0.0045)
    assert (T[AT_END] @ left)[:, 2] == pytest.approx(0.0, abs=0.0045)


def test_tilt_of_a_stationary_base_is_followed_by_the_gyroscope():
    """Half of it after 0.2 s, when gravity has not been averaged."""
    now = next(
        t for t in np.arange(STAND_S, SECONDS, 0.001) if tilt_at(t, (DEG, 0.0))[0][0] > 0.5 * DEG
    )
    times, T, _ = posed(records((DEG, 0.0)))
    after = np.argmin(np.abs(times - now))
    roll = np.arctan2(T[:, 2, 1], T[:, 2, 2])
    assert roll[after] == pytest.approx(tilt_at(times[after], (DEG, 0.0))[0][0], abs=0.003)
    assert np.abs(roll[times < STAND_S + DRIVE_S]).max() == 0.0


@pytest.mark.parametrize("turned", [0.0, 3.0])
def test_a_base_that_does_not_tilt_has_the_poses_without_an_imu(turned):
    """Byte for byte: an accelerometer 2 deg off, an IMU away from the middle, and its noise."""
    found = records(turned=turned)
    np.testing.assert_array_equal(posed(found)[1], posed(without_imu(found))[1])


def test_the_usual_roll_and_pitch_are_those_of_the_drives():
    """Whether it goes straight or in a turn; a first stop that was askew does not count."""
    for turned in (0.0, 3.0):
        one = posed(records(turned=turned))[2]
        assert one.roll_pitch[0].usual is None
        expected = FORCE_BIAS[1] / G[2], -FORCE_BIAS[0] / G[2]
        assert one.roll_pitch[-1].usual == pytest.approx(expected, abs=0.001)
        assert one.roll_pitch[-1].sigma < 0.002


def test_no_roll_and_pitch_between_a_large_yaw_and_a_stop():
    one = posed(records((DEG, 0.0), turned=3.0))[2]
    times = np.array([(e.stamp_ns - START) * 1e-9 for e in one.roll_pitch])
    assert not np.any((times > STAND_S + 2.0) & (times < STAND_S + DRIVE_S + 0.5))
    assert np.any(times > STAND_S + DRIVE_S + 1.5)


def scaled(factor):
    return lambda r, t: Imu(r.stamp_ns, r.frame_id, r.angular_velocity, factor * r.acceleration)


def test_accelerations_in_g_give_the_same_roll_and_pitch():
    _, in_g, one = posed(records((DEG, 0.0), change=scaled(1.0 / 9.81)))
    np.testing.assert_allclose(in_g, posed(records((DEG, 0.0)))[1], atol=1e-6)
    assert not one.refused


@pytest.mark.parametrize("factor", [0.0, -1.0, 3.3])
def test_an_acceleration_that_is_not_gravity_is_refused_and_counted(factor):
    """Of a driver that takes gravity out, one upside down though its frame says otherwise, feet."""
    found = records((DEG, 0.0), change=scaled(factor))
    _, T, one = posed(found)
    np.testing.assert_array_equal(T, posed(without_imu(found))[1])
    assert one.refused["imu: imu: acceleration is not gravity"] > 100


def test_gyroscope_alone_gives_no_roll_and_pitch():
    found = records((DEG, 0.0), change=lambda r, t: Imu(r.stamp_ns, r.frame_id, r.angular_velocity))
    _, T, one = posed(found)
    np.testing.assert_array_equal(T, posed(without_imu(found))[1])
    assert not one.roll_pitch
    assert not one.refused


def test_no_roll_and_pitch_between_a_gap_and_the_next_stop():
    """A gap in the drive takes the usual values away; after one at the stop it is averaged anew."""
    gap = records((DEG, 0.0), change=lambda r, t: None if 4.0 < t < 5.0 else r)
    np.testing.assert_array_equal(posed(gap)[1], posed(without_imu(gap))[1])
    begin = STAND_S + DRIVE_S + 0.7
    gap = records((DEG, 0.0), change=lambda r, t: None if begin < t < begin + 0.5 else r)
    times, T, _ = posed(gap)
    roll = np.arctan2(T[:, 2, 1], T[:, 2, 2])
    assert not roll[(times > begin + 0.3) & (times < begin + 0.9)].any()
    assert roll[times > begin + 1.8] == pytest.approx(DEG, abs=0.003)


def test_imu_in_an_unconnected_frame_is_unused():
    found = records((DEG, 0.0), change=lambda r, t: Imu(
        r.stamp_ns, "elsewhere", r.angular_velocity, r.acceleration))  # fmt: skip
    np.testing.assert_array_equal(posed(found)[1], posed(without_imu(found))[1])


def test_roll_and_pitch_of_odometry_are_used():
    found = [
        (s, role, Odometry(s, "odom", "base", r.T_odom_base @ pose_from_roll_pitch((0.01, 0.02))))
        if role == "odom" else (s, role, r) for s, role, r in records((DEG, 0.0))
    ]  # fmt: skip
    _, T, one = posed(found)
    np.testing.assert_array_equal(T, posed(without_imu(found))[1])
    assert not one.roll_pitch


@pytest.mark.parametrize("late_ms", [7, 60, 200])
def test_the_order_of_arrival_does_not_matter(late_ms):
    prompt = records((DEG, 0.5 * DEG))
    late = sorted(prompt, key=lambda item: item[0] + late_ms * MS * (item[1] == "imu"))
    np.testing.assert_array_equal(posed(late)[1], posed(prompt)[1])
    late = sorted(prompt, key=lambda item: item[0] + late_ms * MS * (item[1] == "odom"))
    np.testing.assert_array_equal(posed(late)[1], posed(prompt)[1])


@pytest.mark.parametrize("offset_s", [-30.0, 30.0])
def test_imu_with_another_clock_is_unused(offset_s):
    off = round(offset_s * 1e9)
    moved = [(s, role, Imu(s + off, "imu_link", r.angular_velocity, r.acceleration)
              if role == "imu" else r) for s, role, r in records()]  # fmt: skip
    np.testing.assert_array_equal(posed(moved)[1], posed(without_imu(moved))[1])


angles = st.floats(-0.2, 0.2)


@given(angles, angles, st.floats(1e-4, 0.02))
def test_roll_and_pitch_are_zero_within_noise_and_unbiased_beyond(roll, pitch, sigma):
    value = np.array([roll, pitch])
    angle, kept = np.hypot(roll, pitch), significant(value, sigma)
    if angle <= 2.5 * sigma:
        assert not kept.any()
    elif angle >= 4.0 * sigma:
        np.testing.assert_allclose(kept, value, rtol=1e-12)
    else:
        assert np.hypot(*kept) <= angle
        assert kept @ value >= 0.0
    # Continuous: a step of 1 % of sigma changes it by no more than the steepest slope.
    other = value * (1.0 + 0.01 * sigma / max(angle, 0.01 * sigma))
    step = np.linalg.norm(significant(other, sigma) - kept)
    assert step <= 0.01 * sigma * 4.0 / (4.0 - 2.5) + 1e-12
