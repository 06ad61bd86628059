"""The data of a tilt cycle: where base and laser were in its middle, and how fast the base was."""

from dataclasses import replace

import numpy as np
import pytest
from tccm_rig import config, laser_pose, make_scan, part_of, posed

from tccm_ros.cuboids.cycle_builder import TiltCycleData
from tccm_ros.cuboids.cycle_records import CycleScan
from tccm_ros.cuboids.tilt_cycle import CycleEnd, Span
from tccm_ros.geometry import pose_from_rpy

SPEED, RATE = 0.5, -0.4
"""Of the base, m/s along x and rad/s about z."""

TILT_STEP = 0.05
"""Of the laser between successive scans, rad."""

ALL_BEAMS = np.ones(4, np.bool_)


def pose_after(seconds):
    return pose_from_rpy(np.array([SPEED * seconds, 0.0, 0.0, 0.0, 0.0, RATE * seconds]))


def cycle_of(seconds, start_s, end_s):
    """Return a cycle of scans at some times, of beams between two times."""
    records = []
    for k, t in enumerate(seconds):
        scan = posed(make_scan(round(t * 1e9), np.ones(4)), TILT_STEP * k, pose_after(t))
        records.append(CycleScan(scan, ALL_BEAMS, 0, len(ALL_BEAMS)))
    part = replace(
        part_of([], 0, config()), start_ns=round(start_s * 1e9), end_ns=round(end_s * 1e9)
    )
    span = Span(part.start_ns, part.end_ns + 1, 0, next(iter(CycleEnd)))
    return TiltCycleData(span, part, records)


@pytest.mark.parametrize("end_s", [0.3, 0.6, 1.0])
def test_pose_of_the_base_is_interpolated_to_the_middle_of_the_cycle(end_s):
    cycle = cycle_of([0.0, 0.2, 0.4, 0.6], 0.0, end_s)
    assert cycle.T_odom_base() == pytest.approx(pose_after(end_s / 2), abs=1e-6)


@pytest.mark.parametrize(("start_s", "end_s", "at_s"), [(0.0, 0.2, 0.3), (0.8, 1.0, 0.7)])
def test_pose_of_the_base_outside_the_samples_is_the_nearest_sample(start_s, end_s, at_s):
    cycle = cycle_of([0.3, 0.5, 0.7], start_s, end_s)
    assert cycle.T_odom_base() == pytest.approx(pose_after(at_s), abs=1e-9)


def test_the_laser_s_pose_is_that_of_the_base_and_of_its_own_joint():
    cycle = cycle_of([0.0, 0.2, 0.4], 0.0, 0.8)
    expected = pose_after(0.4) @ laser_pose(2 * TILT_STEP)
    assert cycle.T_odom_sensor() == pytest.approx(expected, abs=1e-9)


def test_one_record_has_its_own_pose_and_none_the_identity():
    assert cycle_of([0.3], 0.0, 1.0).T_odom_base() == pytest.approx(pose_after(0.3))
    empty = cycle_of([], 0.0, 1.0)
    for T in (empty.T_odom_base(), empty.T_odom_sensor()):
        np.testing.assert_array_equal(T, np.eye(4))


def test_speeds_of_the_base_are_those_of_its_motion():
    """A chord of the turn is as long as the step along x, as poses are placed here."""
    cycle = cycle_of(np.arange(0.0, 1.0, 0.05), 0.0, 1.0)
    assert cycle.base_speeds() == pytest.approx((SPEED, -RATE), rel=1e-6)
    assert cycle_of([0.0, 0.1], 0.0, 0.1).base_speeds() == pytest.approx((SPEED, -RATE), rel=1e-6)
    assert cycle_of([0.0], 0.0, 0.1).base_speeds() == (0.0, 0.0)


def test_the_angle_between_scan_lines_is_the_laser_s_step():
    """The chord of the step, which is 1e-4 shorter than its arc."""
    cycle = cycle_of([0.0, 0.2, 0.4, 0.6], 0.0, 0.6)
    assert cycle.angle_step() == pytest.approx(TILT_STEP, rel=1e-3)
    assert cycle_of([0.0], 0.0, 0.1).angle_step() == 0.0
