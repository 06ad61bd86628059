"""Records of the recordings in the shared folder, read without the package's own bag reader."""

from functools import lru_cache
from pathlib import Path

import pytest
from shared_data import shared

from tccm_ros.geometry import pose_from_quaternion
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan, TransformSample


def stamp_of(header):
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def pose_of(p, q):
    return pose_from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def records_of(message, topic):
    kind = type(message).__name__.split("__")[-1]
    if kind == "LaserScan":
        yield Scan(
            stamp_of(message.header),
            message.header.frame_id,
            message.angle_min,
            message.angle_increment,
            message.time_increment,
            message.range_min,
            message.range_max,
            message.ranges,
        )
    elif kind == "JointState":
        yield JointSample(stamp_of(message.header), tuple(message.name), message.position)
    elif kind == "Odometry":
        pose = message.pose.pose
        yield Odometry(
            stamp_of(message.header),
            message.header.frame_id,
            message.child_frame_id,
            pose_of(pose.position, pose.orientation),
        )
    elif kind == "String":
        yield RobotDescription(message.data)
    elif kind == "TFMessage":
        for one in message.transforms:
            T = pose_of(one.transform.translation, one.transform.rotation)
            is_static = topic == "/tf_static"
            yield TransformSample(
                stamp_of(one.header), one.header.frame_id, one.child_frame_id, T, is_static
            )


@lru_cache(maxsize=2)
def read(name, until_s=None):
    """Return (topic, record) of the first seconds of a recording, in its order."""
    rosbags = pytest.importorskip("rosbags.highlevel")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    records = []
    with rosbags.AnyReader([Path(shared(f"bags/{name}"))], default_typestore=store) as reader:
        stop = None if until_s is None else reader.start_time + until_s * 1_000_000_000
        for connection, _, raw in reader.messages(stop=stop):
            message = reader.deserialize(raw, connection.msgtype)
            records += [(connection.topic, r) for r in records_of(message, connection.topic)]
    return records
