"""The heading by a gyroscope against closed forms: a base that stands, turns, and is turned."""

import numpy as np
import pytest
from robots import MS, START, joint, odometry_at, robot, scan_at

from tccm_ros.config import Config
from tccm_ros.records import Imu, RobotDescription
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams

BIAS, SIGMA = np.array([0.01, -0.01, 0.02]), 0.002
STAND_S, AMPLITUDE, OMEGA = 4.0, 0.8, 1.5
FLAT, ROLLED = "0 0 0", f"{np.pi} 0 0"


def yaw_at(t):
    """Stand, then swing: a sine from rest."""
    moving = np.maximum(t - STAND_S, 0.0)
    return AMPLITUDE * (1.0 - np.cos(OMEGA * moving)) / OMEGA


def rate_at(t):
    return np.where(t > STAND_S, AMPLITUDE * np.sin(OMEGA * (t - STAND_S)), 0.0)


def records(rpy=FLAT, *, seconds=10.0, imu=True, slip=1.0, seed=0, silent=(99.0, 99.0)):
    """Return (role, record) by stamp: wheels turn `slip` times as far as the base."""
    random = np.random.default_rng(seed)
    axis = -1.0 if rpy == ROLLED else 1.0
    text = robot([joint("a", "fixed", "base", "laser"),
                  joint("b", "fixed", "base", "imu_link", rpy=rpy)])  # fmt: skip
    found = [(0, "robot_description", RobotDescription(text))]
    for ms in range(0, round(seconds * 1e3), 10):
        stamp, t = START + ms * MS, ms * 1e-3
        if ms % 20 == 0:
            found.append((stamp, "odom", odometry_at(stamp, (0, 0, 0, 0, 0, slip * yaw_at(t)))))
        if imu and not silent[0] < t < silent[1]:
            rates = BIAS + [0.0, 0.0, axis * rate_at(t)] + SIGMA * random.normal(size=3)
            found.append((stamp, "imu", Imu(stamp, "imu_link", rates)))
        if ms % 100 == 50:
            found.append((stamp, "scan", scan_at(stamp)))
    return found


def headings(found):
    """Return the times (N,) of the scans, s, and their headings, nan for None."""
    one = Robot(Config(), default_streams(), expects_odometry=True)
    events = [e for _, role, record in found for e in one.add(role, record)] + one.flush()
    posed = [e for e in events if getattr(e, "role", "") == "scan" and hasattr(e, "heading")]
    times = np.array([(p.stamp_ns - START) * 1e-9 for p in posed])
    assert sum(role == "scan" for _, role, _ in found) == len(posed)
    return times, np.array([np.nan if p.heading is None else p.heading for p in posed]), one


@pytest.mark.parametrize("rpy", [FLAT, ROLLED])
def test_heading_is_the_integral_of_the_unbiased_rate(rpy):
    """0.6 s of noise of 2 mrad/s at 100 Hz, and a bias known to 2 mrad/s over root 300, for 6 s."""
    times, found, _ = headings(records(rpy))
    known = np.isfinite(found)
    # Confirmed by the wheels once they have turned by 0.3 rad.
    assert yaw_at(STAND_S + 0.75) == pytest.approx(0.3, abs=0.01)
    assert known[times > STAND_S + 0.9].all()
    assert not known[times < STAND_S + 0.7].any()
    turned = yaw_at(times[known])
    assert np.abs(found[known] - found[known][0] - (turned - turned[0])).max() < 0.004


def test_heading_without_bias_correction_drifts():
    times, _, one = headings(records())
    assert one.gyro.bias == pytest.approx(BIAS[2], abs=0.0005)
    assert np.abs(BIAS[2] * (times[-1] - STAND_S)) > 0.1


def test_no_heading_before_the_bias_is_known():
    """A robot that drives from the start has no heading until it has stood for 1.5 s."""
    begin = START + 4200 * MS
    driving = [record for record in records(seconds=12.0) if record[0] == 0 or record[0] > begin]
    times, found, one = headings(driving)
    assert np.isnan(found).all()
    assert one.gyro.bias == 0.0
    assert len(times) > 50


@pytest.mark.parametrize("factor", [-1.0, 57.3, 0.0])
def test_a_gyroscope_that_contradicts_the_wheels_is_not_used(factor):
    """Upside down though its frame says otherwise, in degrees, or with a dead axis."""
    found = [(s, role, Imu(s, "imu_link", factor * r.angular_velocity) if role == "imu" else r)
             for s, role, r in records()]  # fmt: skip
    assert np.isnan(headings(found)[1]).all()


def test_a_base_that_is_turned_while_its_wheels_stand_teaches_no_bias():
    *_, one = headings(records(slip=0.0, seconds=7.0))
    turned = np.abs(rate_at(np.arange(STAND_S, 7.0, 0.01))).mean()
    assert turned > 0.4
    # Only where the swing begins, below what may be a bias, some of it is taken for one.
    assert one.gyro.bias == pytest.approx(BIAS[2], abs=0.003)


def test_missing_samples_give_no_heading_and_lose_no_scan():
    times, found, _ = headings(records(silent=(6.0, 7.0)))
    assert np.isfinite(found[(times > 5.5) & (times < 6.0)]).all()
    assert np.isnan(found[(times > 6.0) & (times < 7.0)]).all()
    assert np.isfinite(found[times > 7.2]).all()
    after = times > 7.2
    turned = found[after] - found[after][0]
    expected = yaw_at(times[after]) - yaw_at(times[after][0])
    assert np.abs(turned - expected).max() < 0.004


def test_without_an_imu_scans_have_no_heading():
    _, found, _ = headings(records(imu=False))
    assert np.isnan(found).all()


def test_the_order_of_arrival_does_not_matter():
    """Samples that come 60 ms late are waited for."""
    prompt = records()
    late = sorted(prompt, key=lambda r: r[0] + 60 * MS * (r[1] == "imu"))
    np.testing.assert_array_equal(headings(prompt)[1], headings(late)[1])


def test_imu_in_an_unconnected_frame_is_unused():
    found = records()
    moved = [(s, role, Imu(s, "elsewhere", r.angular_velocity) if role == "imu" else r)
             for s, role, r in found]  # fmt: skip
    assert np.isnan(headings(moved)[1]).all()


def waits(found):
    """Return how long each scan waited, ns of what came in after it."""
    one = Robot(Config(), default_streams(), expects_odometry=True)
    waited = []
    for stamp, role, record in found:
        posed = [e for e in one.add(role, record) if hasattr(e, "heading")]
        waited += [stamp - e.stamp_ns for e in posed if e.role == "scan"]
    return waited + [0 for e in one.flush() if hasattr(e, "heading")]


@pytest.mark.parametrize("offset_s", [-30.0, -0.9, 0.9, 30.0])
def test_an_imu_with_a_clock_of_its_own_loses_no_scan(offset_s):
    """Where it is far off it delays none; where it is near it may be late, as a joint may."""
    off = round(offset_s * 1e9)
    moved = [(s, role, Imu(s + off, "imu_link", r.angular_velocity) if role == "imu" else r)
             for s, role, r in records(seconds=6.0)]  # fmt: skip
    without, waited = waits(records(seconds=6.0, imu=False)), waits(moved)
    assert len(waited) == len(without) == 60
    max_delay = 1e9 * Config().sync_timeout if abs(offset_s) < 1.0 else 0.0
    assert max(np.array(waited) - without) <= max_delay
