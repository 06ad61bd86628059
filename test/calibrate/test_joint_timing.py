"""Stamps of a tilting laser and its joint: tilting up and down agree with the right delay alone."""

import numpy as np
import pytest
from robots import START

from tccm_ros.calibrate.joint_timing import JointTimer
from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import PosedScan, Scan, TiltAngle

MIN_PAIRS = 3  # pairs of tilt cycles for a majority

WALLS = np.array([[-3.0, -2.0, 0.0], [4.0, 2.5, 2.6]])
"""Corners of a room, m."""

BEAMS, PERIOD, AMPLITUDE = 181, 4.0, 0.7
ANGLES = np.linspace(-1.5, 1.5, BEAMS)


def tilt_at(time):
    """Return the tilt at a time, rad: up and down at an even speed."""
    return AMPLITUDE * (4.0 * abs((time / PERIOD) % 1.0 - 0.5) - 1.0)


def poses_at(time, late, speed):
    """Return the base in odom, and the laser on it as the joint's stamps have it."""
    tilted = pose_from_rpy((0.0, 0.0, 1.0, 0.0, tilt_at(time - late), 0.0))
    return pose_from_rpy((speed * time, 0.0, 0.0, 0.0, 0.0, 0.1 * speed * time)), tilted


def ranges_at(time, speed):
    """Return the ranges to the room from the true pose, with noise."""
    base, laser = poses_at(time, 0.0, speed)
    T = base @ laser
    rays = np.stack([np.cos(ANGLES), np.sin(ANGLES), 0.0 * ANGLES], 1) @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        to_planes = (WALLS[:, None] - T[:3, 3]) / rays
    hit = np.where(to_planes > 1e-6, to_planes, np.inf).min(axis=(0, 2))
    return (hit + np.random.default_rng(int(1e3 * time)).normal(0.0, 0.01, BEAMS)).astype("f4")


def timer_of(late, *, speed=0.0, seconds=16.0, offset=0.0):
    """Return a timer that has the scans of a laser whose joint's stamps are late, s."""
    config = read_config(None, [f"rig.joint_time_offset={offset}"])
    timer = JointTimer(config, "tilt_scan")
    for k in range(int(seconds * 40)):
        time = 0.025 * k
        stamp_ns = START + round(time * 1e9)
        timer.add(TiltAngle("tilt_scan", stamp_ns, float(tilt_at(time - late - offset))))
        scan = Scan(
            stamp_ns, "laser", ANGLES[0], ANGLES[1] - ANGLES[0], 0.0, 0.05, 30.0,
            ranges_at(time, speed),
        )  # fmt: skip
        base, laser = poses_at(time, late + offset, speed)
        stamps = np.array([stamp_ns])
        timer.add(PosedScan(scan, stamps, base[None], laser[None], role="tilt_scan"))
    return timer


@pytest.mark.parametrize("speed", [0.0, 0.2])
@pytest.mark.parametrize("late", [0.1, 0.3, 0.52, -0.3])
def test_a_delay_is_found_whether_the_base_moves_or_not(late, speed):
    found = timer_of(late, speed=speed).estimate()
    assert found.is_significant
    assert found.time_offset == pytest.approx(-late, abs=0.015)
    assert f"rig.joint_time_offset={found.time_offset:.2f}" in found.text()


def test_the_offset_adds_to_the_configured_one():
    found = timer_of(0.3, offset=-0.1).estimate()
    assert found.is_significant
    assert found.time_offset == pytest.approx(-0.3, abs=0.015)


@pytest.mark.parametrize("speed", [0.0, 0.2])
def test_stamps_that_are_right_are_left_alone(speed):
    found = timer_of(0.0, speed=speed).estimate()
    assert not found.is_significant
    assert found.time_offset == 0.0


def test_too_few_tilt_cycles_say_nothing():
    assert timer_of(0.3, seconds=0.5 * PERIOD * MIN_PAIRS).estimate() is None
    assert JointTimer(Config(), "tilt_scan").estimate() is None
