"""When the beams of a level laser were measured: a robot that yaws to and fro in a known room."""

from dataclasses import replace

import numpy as np
import plan
import pytest
from robots import START, description, joints_at, odometry_at, scan_at

from tccm_ros.calibrate.beam_timing import BeamTimer
from tccm_ros.config.reader import read_config
from tccm_ros.records import Odometry, PosedScan, Scan
from tccm_ros.records.building import scan_record
from tccm_ros.robot import Robot
from tccm_ros.sensors.laser_scan import beam_stamps, timed_scan
from tccm_ros.sensors.registry import default_streams

ROOM = np.concatenate([plan.box(-3.0, -2.0, 4.0, 3.0), plan.box(1.5, 1.0, 2.0, 2.0)])
BEAMS, ROTATION = 360, 0.12
STEP = ROTATION / BEAMS


def pose_at(time):
    """Return the planar pose at a time (s): it drives on slowly, and yaws to and fro."""
    return np.array([0.05 * time, 0.0, 0.9 * np.sin(1.3 * time)])


def ranges_of(start, order):
    """Return the ranges of beams that are measured one after the other, in an order."""
    angles = -np.pi + np.arange(BEAMS) * 2.0 * np.pi / BEAMS
    ranges = np.zeros(BEAMS)
    for place, beam in enumerate(order):
        x, y, yaw = pose_at(start + place * STEP)
        ranges[beam] = plan.cast(ROOM, np.array([x, y, yaw]), angles[beam : beam + 1])[0]
    return ranges + np.random.default_rng(int(1e3 * start)).normal(0.0, 0.008, BEAMS)


def timer_of(driver, settings=()):
    """Return a timer that has the scans of a driver: "right", "reversed" or "late"."""
    config = read_config(None, list(settings))
    timer = BeamTimer(config)
    order = np.arange(BEAMS)[::-1] if driver == "reversed" else np.arange(BEAMS)
    late = {"right": 0.0, "reversed": ROTATION, "late": 0.09}[driver]
    for time in np.arange(0.0, 13.0, 0.02):
        timer.add(Odometry(START + round(time * 1e9), "odom", "base", plan.matrix(pose_at(time))))
    for start in np.arange(1.0, 12.0, 0.2):
        ranges = ranges_of(start, order).astype(np.float32)
        stamp = START + round((start + late) * 1e9)
        scan = Scan(stamp, "laser", -np.pi, 2.0 * np.pi / BEAMS, STEP, 0.05, 30.0, ranges)
        scan = timed_scan(scan, config)
        T = np.eye(4)[None]
        timer.add(PosedScan(scan, np.array([scan.stamp_ns]), T, T))
    return timer


def test_times_that_are_right_are_left_alone():
    found = timer_of("right").estimate()
    assert not found.is_significant
    assert found.best == found.configured
    assert found.configured.step_error[0] < 0.006


@pytest.mark.parametrize(
    ("driver", "reverse", "offset"), [("reversed", True, -ROTATION), ("late", False, -0.09)]
)
def test_a_driver_that_is_wrong_is_found(driver, reverse, offset):
    found = timer_of(driver).estimate()
    assert found.is_significant
    assert found.best.reverse is reverse
    # Delays are tried in eighths of a rotation.
    assert found.best.time_offset == pytest.approx(offset, abs=ROTATION / 8)
    assert found.best.step_error[1] < 0.4 * found.configured.step_error[1]
    assert f"scan.reverse={str(reverse).lower()}" in found.text()


def test_proposed_timing_is_right_when_configured():
    settings = ("scan.reverse=true", f"scan.time_offset={-ROTATION}")
    found = timer_of("reversed", settings).estimate()
    assert not found.is_significant


def test_too_few_scans_give_no_estimate():
    assert BeamTimer(read_config(None, [])).estimate() is None


def test_beams_of_a_reversed_scan_were_measured_from_the_last_to_the_first():
    config = read_config(None, ["scan.reverse=true", "scan.time_offset=-0.05"])
    ranges = np.ones(5, np.float32)
    scan = Scan(10**9, "laser", 0.0, 0.1, 0.01, 0.05, 30.0, ranges)
    expected = [10**9 - 50_000_000 + (4 - i) * 10_000_000 for i in range(5)]
    assert beam_stamps(timed_scan(scan, config)).tolist() == expected


@pytest.mark.parametrize(("role", "expected"), [("scan", 150), ("tilt_scan", 200)])
def test_the_intake_corrects_the_level_laser_alone(role, expected):
    config = read_config(None, ["scan.time_offset=-0.05"])
    intake = Robot(config, default_streams())
    intake.add("robot_description", description())
    for tenth in range(8):
        intake.add("odom", odometry_at(START + tenth * 100_000_000))
        intake.add("joint_states", joints_at(START + tenth * 100_000_000, tilt=0.0))
    frame = "front_laser" if role == "scan" else "laser"
    events = [*intake.add(role, scan_at(START + 200_000_000, frame)), *intake.flush()]
    stamps = [(e.scan.stamp_ns - START) / 1e6 for e in events if isinstance(e, PosedScan)]
    assert stamps == [expected]


def test_a_negative_time_increment_is_read():
    numbers = (0.0, 1.0, 0.1, -0.01, 0.0, 0.05, 30.0)
    scan = scan_record(10**9, "laser", numbers, np.ones(11, np.float32))
    assert scan.time_increment == -0.01
    assert scan.end_ns == 10**9 - 100_000_000
    assert replace(scan).time_increment == -0.01
