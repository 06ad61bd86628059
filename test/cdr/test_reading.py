import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_bags import START, TYPES, sample_messages

from tccm_ros.cdr.message_reader import NotPlain
from tccm_ros.errors import MessageError
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import Imu, JointSample, Odometry, Scan, TransformSample
from tccm_ros.ros.reading import READERS
from tccm_ros.ros.writing import scan_message, transforms_message
from tccm_sim.sensor_messages import imu_message, joint_sample_message, odometry_message

T = pose_from_rpy([1, 2, 3, 0.1, 0.2, 0.3])
FORCE = np.array([0.4, -0.5, 9.8])


def fields(records):
    """Return what is in records, comparable bit by bit."""
    values = [[getattr(r, name) for name in r.__slots__] for r in records]
    return [[v.tobytes() if isinstance(v, np.ndarray) else v for v in row] for row in values]


def by_typestore(role, data):
    reader = READERS[role]
    return fields(reader.of_message(TYPES.deserialize(reader.message_type, data)))


def fast(role, data):
    """Read as the bag reader does."""
    return fields(READERS[role].read(data, TYPES.deserialize))


def outcome(read, role, data):
    try:
        return read(role, data)
    except MessageError:
        return "refused"


names = st.text(max_size=6).filter(lambda text: "\0" not in text)
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)


@settings(max_examples=80, deadline=None)
@given(stamp=stamps, frame=names, child=names, joints=st.lists(names, max_size=4))
def test_records_read_from_bytes_equal_those_read_from_messages(stamp, frame, child, joints):
    ranges = np.linspace(0.5, 3.0, len(joints), dtype=np.float32)
    scan = Scan(stamp, frame, -1.0, 0.01, 1e-5, 0.05, 30.0, ranges)
    transforms = [TransformSample(stamp, frame, child, T, False)] * len(joints)
    sample = JointSample(stamp, tuple(joints), np.arange(len(joints)) * 0.1)
    messages = {
        "scan": scan_message(TYPES, scan),
        "odom": odometry_message(TYPES, Odometry(stamp, frame, child, T)),
        "imu": imu_message(TYPES, Imu(stamp, frame, np.array([0.1, -0.2, 0.3]), FORCE)),
        "joint_states": joint_sample_message(TYPES, sample),
        "tf": transforms_message(TYPES, transforms),
        "tf_static": transforms_message(TYPES, transforms),
    }
    for role, message in messages.items():
        data = bytes(TYPES.serialize(READERS[role].message_type, message))
        assert fields(READERS[role].of_bytes(data)) == by_typestore(role, data)


def test_joint_names_are_those_of_each_message_however_they_alternate():
    samples = [
        JointSample(k, tuple(f"{name}{i}" for i in range(count)), np.arange(float(count)))
        for k, (name, count) in enumerate([("a", 2), ("a", 2), ("b", 2), ("a", 3), ("a", 2)])
    ]
    for sample in samples:
        data = bytes(
            TYPES.serialize(
                READERS["joint_states"].message_type, joint_sample_message(TYPES, sample)
            )
        )
        assert fields(READERS["joint_states"].of_bytes(data)) == fields([sample])


SAMPLES = {
    role: next(
        bytes(TYPES.serialize(msgtype, message))
        for topic, msgtype, _, message in sample_messages(2)
        if topic == f"/{role}"
    )
    for role in ("odom", "joint_states", "tf_static", "tilt_scan")
}
IMU = imu_message(TYPES, Imu(START, "imu", np.array([0.1, 0.2, 3.0]), FORCE))
SAMPLES["imu"] = bytes(TYPES.serialize(READERS["imu"].message_type, IMU))


@settings(max_examples=400, deadline=None)
@given(
    role=st.sampled_from(sorted(SAMPLES)),
    place=st.integers(0, 10**6),
    piece=st.binary(min_size=1, max_size=8),
    cut=st.integers(-20, 20),
)
def test_damaged_bytes_have_the_same_outcome_both_ways(role, place, piece, cut):
    data = bytearray(SAMPLES[role])
    at = place % len(data)
    data[at : at + len(piece)] = piece
    data = bytes(data[: len(data) + cut] if cut < 0 else data + bytes(cut))
    assert outcome(fast, role, data) == outcome(by_typestore, role, data)


def test_big_endian_messages_are_left_to_the_typestore():
    message = odometry_message(TYPES, Odometry(START, "odom", "base", T))
    data = bytes(
        TYPES._store.serialize_cdr(message, READERS["odom"].message_type, little_endian=False)
    )
    with pytest.raises(NotPlain):
        READERS["odom"].of_bytes(data)
    assert fast("odom", data) == by_typestore("odom", data)
