"""Stamps, quaternions and names at random: each record is used or counted, the others go on."""

from types import SimpleNamespace

import numpy as np
import pytest
from campaign import fuzzed
from hypothesis import example, given
from hypothesis import strategies as st
from robots import MS, START, description, joints_at, odometry_at, scan_at

from tccm_ros.config import Config
from tccm_ros.errors import MessageError
from tccm_ros.records import TransformSample
from tccm_ros.records.building import stamp_ns_from_message
from tccm_ros.robot import Robot
from tccm_ros.ros.reading import transforms_from_message
from tccm_ros.sensors.registry import default_streams

PERIOD_MS, SCANS = 50, 60
JUMP_NS = 10**10

ODD_STAMPS = {
    "zero": lambda ns: 0,
    "as the one before": lambda ns: ns - PERIOD_MS * MS,
    "a bit back": lambda ns: ns - 3 * PERIOD_MS * MS,
    "far back": lambda ns: ns - JUMP_NS,
    "far ahead": lambda ns: ns + JUMP_NS,
    "of another clock": lambda ns: ns % 10**9,
    "before 1970": lambda ns: -ns,
    "the last of int32": lambda ns: 2**31 * 10**9 - 1,
}


def recording():
    """Yield (role, record, index of the scan): a robot that stands, and nods."""
    yield "robot_description", description(), -1
    for k in range(SCANS):
        ns = START + k * PERIOD_MS * MS
        for half in (0, PERIOD_MS // 2):
            yield "odom", odometry_at(ns + half * MS), -1
            yield "joint_states", joints_at(ns + half * MS, tilt=0.3 * np.sin(0.1 * k)), -1
        yield "tilt_scan", scan_at(ns), k
        yield "scan", scan_at(ns, frame="front_laser"), k


def posed_of(stamps):
    """Return the robot that got the recording with odd stamps, by role and number of the scan."""
    robot = Robot(Config(), default_streams(), expects_odometry=True)
    for role, record, k in recording():
        odd = stamps.get((role, k))
        if odd is not None:
            record = scan_at(ODD_STAMPS[odd](record.stamp_ns), frame=record.frame_id)
        robot.add(role, record)
    robot.flush()
    return robot


scans = st.tuples(st.sampled_from(["scan", "tilt_scan"]), st.integers(1, SCANS - 2))


@fuzzed
@given(st.dictionaries(scans, st.sampled_from(sorted(ODD_STAMPS)), max_size=4))
@example({("scan", k): "zero" for k in range(1, SCANS - 1)})
@example({("tilt_scan", 30): "the last of int32", ("tilt_scan", 31): "the last of int32"})
def test_scans_with_odd_stamps_are_used_or_counted_and_cost_no_others(stamps):
    robot = posed_of(stamps)
    for role in ("scan", "tilt_scan"):
        sensor = robot.sensors[role]
        odd = sum(of == role for of, _ in stamps)
        assert sensor.received == sensor.posed + sum(sensor.dropped.values()) == SCANS
        # Two in a row are a jump, which the next ones have to refute; the last waits for samples.
        assert sensor.posed >= SCANS - 2 * odd - 1, (stamps, sensor.dropped)


@pytest.mark.parametrize(("sec", "nanosec"), [(5, 0), (4, 10**9), (1, 4 * 10**9), (6, -(10**9))])
def test_nanoseconds_of_more_than_a_second_count(sec, nanosec):
    assert stamp_ns_from_message(SimpleNamespace(sec=sec, nanosec=nanosec)) == 5 * 10**9


numbers = st.one_of(
    st.floats(-2.0, 2.0), st.sampled_from([0.0, np.nan, np.inf, 1e-200, 1e200, -1e9])
)
vectors = st.tuples(*[numbers] * 7)
names = st.sampled_from(["base", "laser", "/laser", "", "läser", "a b", "//", "x" * 300])


def transform(parent, child, vector):
    x, y, z, qx, qy, qz, qw = vector
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=5, nanosec=0), frame_id=parent),
        child_frame_id=child,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=z),
            rotation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw),
        ),
    )


@fuzzed
@given(st.lists(st.tuples(names, names, vectors), max_size=6), st.booleans())
def test_any_transforms_are_used_or_counted(rows, is_static):
    message = SimpleNamespace(transforms=[transform(*row) for row in rows])
    try:
        samples = transforms_from_message(message, is_static=is_static)
    except MessageError:
        return
    robot = Robot(Config(), default_streams())
    role = "tf_static" if is_static else "tf"
    for sample in samples:
        robot.add(role, sample)
    robot.flush()
    sound = [s for s in samples if np.isfinite(s.T_parent_child).all()]
    assert sum(robot.refused.values()) >= len(samples) - len(sound)
    assert robot.frames.tf or all(s.parent == s.child or not s.child for s in sound)


def test_transform_without_rotation_leaves_the_others_of_its_message():
    sound, nothing = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0), (0.0,) * 7
    rows = [("base", "finger", nothing), ("base", "laser", sound), ("base", "toe", nothing)]
    samples = transforms_from_message(SimpleNamespace(transforms=[transform(*r) for r in rows]))
    robot = Robot(Config(), default_streams())
    for sample in samples:
        robot.add("tf", sample)
    robot.flush()
    assert set(robot.frames.tf) == {"laser"}
    assert robot.refused == {"tf: malformed": 2}
    with pytest.raises(MessageError, match="base -> finger has a quaternion"):
        transforms_from_message(SimpleNamespace(transforms=[transform(*rows[0])]))
    assert isinstance(samples[1], TransformSample)
