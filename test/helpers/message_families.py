"""The two families of message classes: rosidl, and the rosbags typestore."""

import pytest

from tccm_ros.bags.typestore import TypestoreMessages

TYPESTORE = TypestoreMessages()


def family(name):
    """Return a MessageTypes by name, or skip where ROS is not installed."""
    if name == "typestore":
        return TYPESTORE
    pytest.importorskip("rclpy", reason="rosidl messages need a ROS installation")
    from tccm_ros.nodes.ros_types import RosidlMessages

    return RosidlMessages()


def to_bag_message(types, msgtype, message):
    """Return a message as read from a bag, by its CDR bytes."""
    if types is TYPESTORE:
        data = TYPESTORE.serialize(msgtype, message)
    else:
        from rclpy.serialization import serialize_message

        data = serialize_message(message)
    return TYPESTORE.deserialize(msgtype, bytes(data))
