"""Readers return records of messages, and refuse messages with unusable content."""

import math
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_families import TYPESTORE
from sample_records import STAMP, T, make_scan

from tccm_ros.errors import MessageError
from tccm_ros.records import (
    Imu,
    JointSample,
    Odometry,
    SurfaceCloud,
    TransformSample,
)
from tccm_ros.ros.reading import (
    READERS,
    imu_from_message,
    joint_sample_from_message,
    odometry_from_message,
    robot_description_from_message,
    surface_cloud_from_message,
    transforms_from_message,
)
from tccm_ros.ros.writing import scan_message, surface_cloud_message, transforms_message
from tccm_ros.sensors.laser_scan import scan_from_message
from tccm_sim.sensor_messages import imu_message, joint_sample_message, odometry_message


@pytest.mark.parametrize(
    "changes",
    [
        {"angle_min": math.nan},
        {"angle_increment": math.inf},
        {"time_increment": -100.0},
        {"time_increment": 100.0},
        {"range_max": math.nan},
    ],
)
def test_a_scan_that_no_processor_can_use_is_refused(changes):
    message = scan_message(TYPESTORE, make_scan([1.0, 2.0]))
    for key, value in changes.items():
        setattr(message, key, value)
    with pytest.raises(MessageError):
        scan_from_message(message)


def test_joint_state_without_positions_is_an_empty_sample(types):
    message = joint_sample_message(types, JointSample(STAMP, ("tilt",), np.zeros(0)))
    assert joint_sample_from_message(message).names == ()


def test_joint_state_with_too_few_positions_is_refused():
    message = joint_sample_message(TYPESTORE, JointSample(STAMP, ("a", "b"), np.zeros(1)))
    with pytest.raises(MessageError, match="2 names and 1 positions"):
        joint_sample_from_message(message)


def test_an_imu_without_angular_velocity_is_refused():
    message = imu_message(TYPESTORE, Imu(STAMP, "imu", np.array([0.1, 0.2, 0.3])))
    assert imu_from_message(message).angular_velocity.tolist() == [0.1, 0.2, 0.3]
    message.angular_velocity.y = math.nan
    with pytest.raises(MessageError, match="not finite"):
        imu_from_message(message)
    message.angular_velocity_covariance[0] = -1.0
    with pytest.raises(MessageError, match="no angular velocity"):
        imu_from_message(message)


def test_an_imu_without_acceleration_is_a_gyroscope():
    rates, force = np.array([0.1, 0.2, 0.3]), np.array([0.4, -0.5, 9.8])
    message = imu_message(TYPESTORE, Imu(STAMP, "imu", rates, force))
    assert imu_from_message(message).acceleration.tolist() == force.tolist()
    message.linear_acceleration.y = math.nan
    assert imu_from_message(message).acceleration is None
    message = imu_message(TYPESTORE, Imu(STAMP, "imu", rates))
    assert message.linear_acceleration_covariance[0] == -1.0
    assert imu_from_message(message).acceleration is None


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (0, 0, math.inf, 1)])
def test_odometry_without_a_rotation_is_refused(quaternion):
    message = odometry_message(TYPESTORE, Odometry(STAMP, "odom", "base", T))
    orientation = message.pose.pose.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, quaternion)
    with pytest.raises(MessageError):
        odometry_from_message(message)


def test_quaternions_are_normalised():
    message = odometry_message(TYPESTORE, Odometry(STAMP, "odom", "base", np.eye(4)))
    message.pose.pose.orientation.w = 0.999
    np.testing.assert_allclose(odometry_from_message(message).T_odom_base, np.eye(4))


def test_slashes_before_frame_names_are_removed():
    message = transforms_message(
        TYPESTORE, [TransformSample(STAMP, "/base_link", "/laser", np.eye(4), False)]
    )
    (sample,) = transforms_from_message(message)
    assert (sample.parent, sample.child) == ("base_link", "laser")


def test_a_surface_message_with_points_that_are_not_finite_is_refused():
    points = np.array([[0, 0, np.nan]], np.float32)
    message = surface_cloud_message(
        TYPESTORE, SurfaceCloud(STAMP, "base", points, np.zeros(1, np.uint32))
    )
    with pytest.raises(MessageError, match="not finite"):
        surface_cloud_from_message(message)


def test_every_reader_refuses_or_reads_default_messages():
    for reader in READERS.values():
        try:
            records = reader.of_message(TYPESTORE.make(reader.message_type))
        except MessageError:
            continue
        assert len(records) <= 1


@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=200), role=st.sampled_from(sorted(READERS)))
def test_a_reader_of_random_bytes_raises_nothing_but_message_errors(data, role):
    """Whatever bytes deserialise to, the reader gives records or a MessageError."""
    reader = READERS[role]
    records = []
    with suppress(MessageError):
        message = TYPESTORE.deserialize(reader.message_type, b"\0\1\0\0" + data)
        records = reader.of_message(message)
    assert all(type(record).__module__.startswith("tccm_ros.records") for record in records)


def test_readers_take_any_object_with_the_fields():
    message = SimpleNamespace(data="<robot/>")
    assert robot_description_from_message(message).urdf == "<robot/>"
