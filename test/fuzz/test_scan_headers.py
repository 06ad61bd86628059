"""Scans with headers of any kind: refused with a reason, or used with a beam within limits."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from robots import START, scan_at

from tccm_ros.config import Config
from tccm_ros.errors import MessageError
from tccm_ros.records.building import scan_record
from tccm_ros.sensors.laser_scan import (
    LIMITS_TOO_FAR,
    NO_LIMITS,
    NO_RETURNS,
    NOTHING_SEEN,
    OUT_OF_LIMITS,
    TOO_FAR,
)
from tccm_ros.sensors.registry import default_streams

STREAM = next(s for s in default_streams(Config()) if s.role == "scan")
HALF, BEAMS = 2.35619, 541
STEP = 2 * HALF / (BEAMS - 1)
NUMBERS = {
    "angle_min": -HALF, "angle_max": HALF, "angle_increment": STEP, "time_increment": 1e-5,
    "scan_time": 0.04, "range_min": 0.05, "range_max": 10.0,
}  # fmt: skip


def wall(count=BEAMS):
    """Ranges of a room, none twice: from 1 to 6 m."""
    return np.linspace(1.0, 6.0, count).astype(np.float32)


def read(ranges, **changes):
    return scan_record(START, "laser", tuple({**NUMBERS, **changes}.values()), ranges)


ANY = st.one_of(
    st.floats(-10.0, 10.0), st.floats(width=32), st.sampled_from([0.0, 1e-9, 1e9, 360.0])
)


@given(
    st.fixed_dictionaries({}, optional=dict.fromkeys(NUMBERS, ANY)),
    hnp.arrays(np.float32, st.integers(0, 600), elements=st.floats(width=32)),
)
@settings(max_examples=300, deadline=None)
def test_any_scan_is_refused_or_used_with_a_beam(changes, ranges):
    try:
        scan = read(ranges, **changes)
    except MessageError:
        return
    if STREAM.rejection_reason(scan) is None:
        low, high = scan.range_min, min(scan.range_max, Config().scan.max_range)
        assert ((scan.ranges >= low) & (scan.ranges <= high) & (scan.ranges > 0.0)).any()
        assert len(ranges) < 2 or abs(scan.angle_increment) * (len(ranges) - 1) < 4.0 * math.pi


@pytest.mark.parametrize("name", ["angle_max", "time_increment", "range_min", "range_max"])
def test_a_number_that_is_none_is_named(name):
    with pytest.raises(MessageError, match=f"scan has {name} nan, expected finite numbers"):
        read(wall(), **{name: math.nan})


CONTRADICTIONS = [
    {"angle_increment": STEP / 2},
    {"angle_increment": 0.0},
    {"angle_increment": -STEP},
    {"angle_increment": math.degrees(STEP)},
    {"angle_max": 0.0},
    {"angle_max": math.nan},
    {"angle_min": -math.degrees(HALF), "angle_max": math.degrees(HALF)},
    {"angle_min": -135.0, "angle_max": 135.0, "angle_increment": 0.5},
    {"angle_min": -math.pi, "angle_max": math.pi, "angle_increment": 0.0},
    {"angle_min": -math.pi, "angle_max": math.pi, "angle_increment": 4 * math.pi / 540},
]


@pytest.mark.parametrize("changes", CONTRADICTIONS)
def test_angles_that_contradict_each_other_are_refused(changes):
    with pytest.raises(MessageError, match="angle"):
        read(wall(), **changes)


def test_half_of_the_beams_is_refused():
    with pytest.raises(MessageError, match="scan of 270 beams"):
        read(wall(270))


@pytest.mark.parametrize(
    ("count", "changes"),
    [
        (540, {}),  # an end that is not counted
        (542, {}),
        (360, {"angle_min": 0.0, "angle_max": 2 * math.pi, "angle_increment": math.pi / 180}),
        (181, {"angle_min": 2.0, "angle_max": -2 * math.pi + 2.0 + math.pi * 1.2,
               "angle_increment": math.pi * 1.2 / 180}),  # wrapped behind the robot
        (541, {"angle_min": HALF, "angle_max": -HALF, "angle_increment": -STEP}),
        (541, {"angle_increment": round(STEP, 5)}),
        (1, {"angle_min": 0.0, "angle_max": 0.0, "angle_increment": 0.0}),
    ],
)  # fmt: skip
def test_angles_as_drivers_write_them_are_read(count, changes):
    assert len(read(wall(count), **changes).ranges) == count


@pytest.mark.parametrize(
    ("ranges", "changes", "reason"),
    [
        (wall(), {"range_max": 0.0}, NO_LIMITS),
        (wall(), {"range_min": 10.0, "range_max": 0.05}, NO_LIMITS),
        (wall(), {"range_min": 50.0, "range_max": 10_000.0}, LIMITS_TOO_FAR),
        (wall(), {"range_min": 9.0}, OUT_OF_LIMITS),
        (wall() * 1000, {"range_min": 50.0, "range_max": 10_000.0}, LIMITS_TOO_FAR),
        (wall() * 1000, {"range_max": 10_000.0}, TOO_FAR),
        (wall() * 1000, {}, TOO_FAR),
        (np.full(BEAMS, np.inf, np.float32), {}, NOTHING_SEEN),
        (np.full(BEAMS, 10.0, np.float32), {}, NOTHING_SEEN),
        (np.zeros(BEAMS, np.float32), {}, NOTHING_SEEN),
        (wall(0), {}, "empty"),
    ],
)
def test_a_scan_without_a_beam_within_limits_is_dropped_with_the_reason(ranges, changes, reason):
    assert STREAM.rejection_reason(read(ranges, **changes)) == reason


@pytest.mark.parametrize("written", [10.0, 9.99, 9.96, 10.02])
def test_a_range_beside_range_max_of_many_beams_is_nothing_seen(written):
    ranges = wall()
    ranges[100:200] = written
    scan = read(ranges)
    assert np.isposinf(scan.ranges[100:200]).all()
    np.testing.assert_array_equal(
        np.delete(scan.ranges, slice(100, 200)), np.delete(wall(), slice(100, 200))
    )
    assert scan.no_returns == 100
    assert STREAM.remark(scan) == NO_RETURNS


def test_noise_that_a_simulator_adds_to_no_returns_leaves_no_beam():
    rng = np.random.default_rng(3)
    ranges = wall()
    ranges[100:200] = np.minimum(10.0 + rng.normal(0.0, 0.02, 100), 10.0)
    assert np.isposinf(read(ranges).ranges[100:200]).all()


def test_a_wall_near_range_max_stays():
    ranges = wall()
    ranges[100:120] = np.linspace(9.91, 9.99, 20)
    scan = read(ranges)
    np.testing.assert_array_equal(scan.ranges, ranges)
    assert scan.no_returns == 0
    assert STREAM.remark(scan) is None


def test_equal_ranges_elsewhere_stay():
    np.testing.assert_array_equal(read(np.full(BEAMS, 2.0, np.float32)).ranges, np.full(BEAMS, 2.0))


def test_a_made_scan_has_no_returns_of_none():
    assert scan_at(START).no_returns == 0
