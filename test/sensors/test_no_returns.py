"""A range that fills arcs about the laser is a driver's "no return", wherever it is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import MS, START, description, joints_at, odometry_at, scan_at

from tccm_ros.config import Config
from tccm_ros.robot import Robot
from tccm_ros.sensors.no_returns import NoReturns, arc_range
from tccm_ros.sensors.registry import default_streams

BEAMS, STEP = 541, np.radians(0.5)


def scan_of(ranges, range_max=100.0):
    one = scan_at(START)
    ranges = np.array(ranges, np.float32)
    ranges.flags.writeable = False
    return replace(
        one, ranges=ranges, range_min=0.05, range_max=range_max, angle_min=-2.35619,
        angle_increment=float(STEP),
    )  # fmt: skip


def room(distance, resolution=0.001):
    """Ranges of a square room of 2 x distance, rounded as a driver does."""
    angles = -2.35619 + STEP * np.arange(BEAMS)
    nearest = np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    return np.round(distance / nearest / resolution) * resolution


@pytest.mark.parametrize("range_max", [100.0, np.inf])
@pytest.mark.parametrize("written", [30.0, 8.0, 4.095])
def test_beams_without_a_return_are_no_measurements(written, range_max):
    clean = NoReturns()
    ranges = room(2.0)
    ranges[100:180] = written
    ranges[300] = written  # a gap of one beam
    cleaned, remark = clean(scan_of(ranges, range_max))
    none = ranges == written
    assert np.isnan(cleaned.ranges[none]).all()
    np.testing.assert_array_equal(cleaned.ranges[~none], ranges[~none].astype(np.float32))
    assert f"ranges of {written:g} m" in remark


def test_a_learned_range_is_none_in_later_scans_where_few_beams_have_it():
    clean = NoReturns()
    ranges = room(2.0)
    clean(scan_of(np.where(np.arange(BEAMS) < 80, 30.0, ranges)))
    ranges[200] = 30.0
    cleaned, remark = clean(scan_of(ranges))
    assert np.flatnonzero(np.isnan(cleaned.ranges)).tolist() == [200]
    assert remark is not None


@given(st.floats(0.3, 30.0), st.sampled_from([1e-6, 0.001, 0.01, 0.05]))
def test_walls_stay_however_their_ranges_are_rounded(distance, resolution):
    scan = scan_of(room(distance, resolution))
    assert arc_range(scan) is None
    assert NoReturns()(scan) == (scan, None)


@pytest.mark.parametrize("value", [0.0, np.inf, np.nan, 0.01, 200.0])
def test_values_that_are_no_ranges_anyway_are_not_learned(value):
    ranges = room(2.0)
    ranges[100:300] = value
    assert arc_range(scan_of(ranges)) is None


def test_a_robot_drops_them_and_says_so():
    robot = Robot(Config(), default_streams(), expects_odometry=True)
    robot.add("robot_description", description())
    posed = []
    for k in range(10):
        ns = START + 50 * MS * k
        for half in (0, 25 * MS):
            robot.add("odom", odometry_at(ns + half))
            robot.add("joint_states", joints_at(ns + half, tilt=0.1))
        ranges = room(2.0)
        ranges[50:200] = 30.0
        scan = replace(scan_of(ranges), stamp_ns=ns, frame_id=scan_at(START).frame_id)
        posed += [e for e in robot.add("tilt_scan", scan) if hasattr(e, "scan")]
    assert posed
    assert all(np.isnan(event.scan.ranges[50:200]).all() for event in posed)
    (remark,) = robot.remarks
    assert remark.startswith("tilt_scan: ranges of 30 m fill arcs")
