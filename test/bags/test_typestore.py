import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.errors import MessageError

TYPES = TypestoreMessages()


def test_defaults_are_filled_at_every_depth():
    odometry = TYPES.make("nav_msgs/msg/Odometry")
    assert odometry.header.frame_id == ""
    assert odometry.pose.covariance.shape == (36,)
    assert odometry.pose.pose.orientation.w == 1.0
    assert odometry.pose.pose.orientation.x == 0.0


def test_defaults_are_not_shared():
    first, second = (TYPES.make("sensor_msgs/msg/JointState") for _ in range(2))
    first.name.append("tilt")
    assert second.name == []


@pytest.mark.parametrize(
    "msgtype",
    [
        "visualization_msgs/msg/MarkerArray",
        "visualization_msgs/msg/Marker",
        "sensor_msgs/msg/PointCloud2",
        "tf2_msgs/msg/TFMessage",
        "nav_msgs/msg/OccupancyGrid",
        "diagnostic_msgs/msg/DiagnosticArray",
    ],
)
def test_default_messages_survive_cdr(msgtype):
    data = TYPES.serialize(msgtype, TYPES.make(msgtype))
    assert bytes(TYPES.serialize(msgtype, TYPES.deserialize(msgtype, data))) == bytes(data)


def test_unknown_fields_and_types_are_errors():
    with pytest.raises(TypeError):
        TYPES.make("std_msgs/msg/String", text="x")
    with pytest.raises(KeyError):
        TYPES.make("std_msgs/msg/Strin")


@pytest.mark.parametrize("extra", [0, 4, 8, 15])
def test_padding_after_a_message_is_accepted(extra):
    data = bytes(TYPES.serialize("std_msgs/msg/String", TYPES.make("std_msgs/msg/String")))
    assert TYPES.deserialize("std_msgs/msg/String", data + b"\xff" * extra).data == ""


def test_a_message_that_is_much_too_long_is_refused():
    data = bytes(TYPES.serialize("std_msgs/msg/String", TYPES.make("std_msgs/msg/String")))
    with pytest.raises(MessageError, match="bytes, expected"):
        TYPES.deserialize("std_msgs/msg/String", data + b"\0" * 16)


def test_both_byte_orders_are_read():
    message = TYPES.make("sensor_msgs/msg/JointState", name=["tilt"], position=np.array([0.25]))
    data = TYPES._store.serialize_cdr(message, "sensor_msgs/msg/JointState", little_endian=False)
    back = TYPES.deserialize("sensor_msgs/msg/JointState", data)
    assert back.position.tolist() == [0.25]


@pytest.mark.parametrize("data", [b"", b"\0\1", b"\0\3\0\0", b"\xff" * 40, b"\0\1\0\0\xff\xff\xff"])
def test_data_that_is_no_message_is_refused(data):
    with pytest.raises(MessageError):
        TYPES.deserialize("sensor_msgs/msg/LaserScan", data)


@settings(max_examples=200, deadline=None)
@given(position=st.integers(0, 10**6), byte=st.integers(0, 255), cut=st.integers(0, 200))
def test_damaged_messages_are_read_or_refused(position, byte, cut):
    ranges = np.linspace(1, 2, 20).astype(np.float32)
    message = TYPES.make("sensor_msgs/msg/LaserScan", ranges=ranges)
    data = bytearray(TYPES.serialize("sensor_msgs/msg/LaserScan", message))
    data[position % len(data)] = byte
    try:
        back = TYPES.deserialize("sensor_msgs/msg/LaserScan", bytes(data[: len(data) - cut]))
    except MessageError:
        return
    assert len(back.ranges) <= 20 + 4
