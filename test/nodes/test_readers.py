"""Serialised messages give the records that their messages give, in arrays that can be written."""

import dataclasses

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from tccm_ros.errors import MessageError
from tccm_ros.nodes.intake.record_subscriptions import read_records
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records import (
    JointSample,
    Odometry,
    RobotDescription,
    Scan,
    SurfaceCloud,
    TransformSample,
    ViewIntervals,
)
from tccm_ros.ros import writing as ros
from tccm_ros.ros.reading import READERS
from tccm_sim import sensor_messages

T = np.eye(4)
T[:3, 3] = 1.0, 2.0, 3.0
NS = 1_600_000_000_123_456_789
TRANSFORM = TransformSample(NS, "odom", "base", T, False)
RECORDS = {
    "scan": (ros.scan_message, Scan(
        NS, "laser", -1.0, 0.5, 0.25, 0.125, 9.0, np.arange(5, dtype=np.float32))),
    "joint_states": (sensor_messages.joint_sample_message, JointSample(
        NS, ("tilt", "wheel"), np.array([0.5, -1.0]))),
    "odom": (sensor_messages.odometry_message, Odometry(NS, "odom", "base", T)),
    "robot_description": (sensor_messages.robot_description_message, RobotDescription("<robot/>")),
    "surfaces": (ros.surface_cloud_message, SurfaceCloud(
        NS, "base", np.ones((3, 3), np.float32), np.arange(3, dtype=np.uint32))),
    "view": (ros.view_message, ViewIntervals(NS, "base", np.ones((2, 4), np.float32))),
}  # fmt: skip


def assert_same(found, expected) -> None:
    assert type(found) is type(expected)
    for field in dataclasses.fields(expected):
        value, wanted = getattr(found, field.name), getattr(expected, field.name)
        if isinstance(wanted, np.ndarray):
            np.testing.assert_array_equal(value, wanted)
            assert value.dtype == wanted.dtype
            # Kernels take the ranges of scans read-only, as one signature.
            assert value.flags.writeable == (field.name != "ranges")
        else:
            assert value == wanted


@pytest.mark.parametrize("role", RECORDS)
def test_a_record_that_was_written_as_bytes_is_read_back(role):
    build, record = RECORDS[role]
    message = build(RosidlMessages(), record)
    (found,) = read_records(READERS[role], serialize_message(message))
    assert_same(found, record)


def test_a_message_that_cannot_be_used_is_refused():
    message = sensor_messages.odometry_message(RosidlMessages(), RECORDS["odom"][1])
    message.pose.pose.position.x = float("nan")
    with pytest.raises(MessageError):
        read_records(READERS["odom"], serialize_message(message))
