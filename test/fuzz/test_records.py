"""Any message is a record or a MessageError; any record is used or counted, by both processors."""

import math
from types import SimpleNamespace

import numpy as np
from campaign import fuzzed
from fed import fed_slam, fed_tccm
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.errors import MessageError, TccmError
from tccm_ros.records import JointSample, Odometry, Scan, TransformSample
from tccm_ros.ros.reading import joint_sample_from_message, odometry_from_message
from tccm_ros.sensors.laser_scan import scan_from_message

START_NS = 1_700_000_000_000_000_000

floats = st.one_of(
    st.floats(width=32), st.sampled_from([0.0, -0.0, 1e-30, 1e30, math.inf, -math.inf, math.nan])
)
mostly_sane = st.one_of(st.floats(-3.0, 3.0), floats)
ranges = st.lists(st.one_of(st.floats(0.125, 20.0, width=32), floats), max_size=60)
stamps = st.one_of(
    st.integers(START_NS, START_NS + 5_000_000_000),
    st.integers(0, 2**31 * 1_000_000_000 - 1),
)
frames = st.sampled_from(["laser", "base", "odom", "", "/laser", "other"])
names = st.lists(st.sampled_from(["tilt", "wheel", "", "tilt"]), max_size=3)


def header(stamp_ns: int, frame: str) -> SimpleNamespace:
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=frame)


@st.composite
def scan_messages(draw):
    numbers = (
        "angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min",
        "range_max",
    )  # fmt: skip
    fields = {name: draw(mostly_sane) for name in numbers}
    values = np.array(draw(ranges), np.float32)
    return SimpleNamespace(header=header(draw(stamps), draw(frames)), ranges=values, **fields)


@st.composite
def joint_messages(draw):
    positions = np.array(draw(st.lists(mostly_sane, max_size=3)), np.float64)
    return SimpleNamespace(header=header(draw(stamps), ""), name=draw(names), position=positions)


@st.composite
def odometry_messages(draw):
    x, y, z, qx, qy, qz, qw = (draw(mostly_sane) for _ in range(7))
    pose = SimpleNamespace(
        position=SimpleNamespace(x=x, y=y, z=z),
        orientation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw),
    )
    return SimpleNamespace(
        header=header(draw(stamps), draw(frames)),
        child_frame_id=draw(frames),
        pose=SimpleNamespace(pose=pose),
    )


def converted(convert, message):
    try:
        return convert(message)
    except MessageError:
        return None


@fuzzed
@given(scan_messages())
def test_any_scan_message_is_read_whole_or_refused(message):
    scan = converted(scan_from_message, message)
    assert scan is None or len(scan.ranges) == len(message.ranges)


@fuzzed
@given(joint_messages())
def test_any_joint_message_gives_finite_positions_or_is_refused(message):
    sample = converted(joint_sample_from_message, message)
    assert sample is None or np.isfinite(sample.positions).all()


@fuzzed
@given(odometry_messages())
def test_any_odometry_message_gives_a_finite_pose_or_is_refused(message):
    record = converted(odometry_from_message, message)
    assert record is None or np.isfinite(record.T_odom_base).all()


messages = st.one_of(
    scan_messages().map(lambda m: converted(scan_from_message, m)),
    joint_messages().map(lambda m: converted(joint_sample_from_message, m)),
    odometry_messages().map(lambda m: converted(odometry_from_message, m)),
)


def rig() -> Config:
    config = Config()
    config.rig.kinematics = "rig"
    config.rig.tilt_laser = (0.0, 0.0, 1.2, 0.0, 0.0, 0.0)
    config.rig.level_laser = (0.0, 0.0, 0.3, 0.0, 0.0, 0.0)
    config.frames.tilt_joint = "tilt"
    return config


def believable(record) -> bool:
    """Whether a record is finite in size: a map of a room of 1e30 m is another matter."""
    if isinstance(record, Odometry):
        return bool(np.abs(record.T_odom_base[:3, 3]).max() < 1e3)
    return record is not None


@st.composite
def sequences(draw):
    """Draw a sound recording with odd records put into it anywhere."""
    records: list = []
    for k in range(draw(st.integers(5, 40))):
        now = START_NS + k * 50_000_000
        values = np.full(draw(st.integers(1, 40)), draw(st.floats(0.3, 10.0)), np.float32)
        records += [
            Odometry(now, "odom", "base", np.eye(4)),
            JointSample(now, ("tilt",), np.array([0.5 + 0.4 * math.sin(k)])),
            Scan(now, "laser", -0.5, 0.02, draw(st.floats(0.0, 1e-3)), 0.05, 30.0, values),
        ]
    for odd in draw(st.lists(messages, max_size=12)):
        records.insert(draw(st.integers(0, len(records))), odd)
    return [record for record in records if believable(record)]


@fuzzed
@given(sequences())
def test_the_tccm_processor_uses_or_counts_every_scan(records):
    fed = fed_tccm(rig())
    feed(fed, records)
    fed.finish()
    processor = fed.processor
    scans = sum(isinstance(record, Scan) for record in records)
    # A scan that straddles a turn is used by two cycles.
    assert processor.counts["scans used"] + sum(fed.dropped.values()) >= scans
    cuboids = processor.map.cuboids()
    assert (cuboids.top >= cuboids.bottom).all()
    assert len(cuboids) < 1_000_000


@fuzzed
@given(sequences())
def test_the_slam_processor_gives_finite_poses_for_any_records(records):
    fed = fed_slam(rig())
    feed(fed, records)
    fed.finish()
    slam = fed.processor
    solution = slam.solve()
    assert np.isfinite(solution.trajectory).all()
    assert slam.counts["level scans"] <= sum(isinstance(record, Scan) for record in records)


def feed(fed, records) -> None:
    """Add records as a node does: an error of ours is a refusal, all others are defects."""
    for record in records:
        try:
            fed.add(record)
        except TccmError:
            continue


@fuzzed
@given(st.lists(st.tuples(stamps, frames, frames, st.booleans()), max_size=40))
def test_scans_under_any_tree_of_transforms_are_used_or_dropped(edges):
    fed = fed_tccm()
    for stamp, parent, child, is_static in edges:
        feed(fed, [TransformSample(stamp, parent, child, np.eye(4), is_static)])
        feed(fed, [Scan(stamp, "laser", 0.0, 0.1, 0.0, 0.1, 9.0, np.ones(3, np.float32))])
    results = fed.finish()
    # Nothing waits any more: each scan was used, or dropped for a reason.
    assert sum(fed.dropped.values()) + fed.processor.counts["scans used"] == len(edges)
    assert all(np.isfinite(result.T_odom_base).all() for result in results)
