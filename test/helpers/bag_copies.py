"""Copies of a recording as other writers store it, and comparison of their records."""

import numpy as np
from mcap.writer import Writer
from rosbags.rosbag2 import CompressionFormat
from rosbags.rosbag2 import Writer as RosbagsWriter
from sample_bags import TYPES, sample_messages

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader


def summary(records):
    """Return comparable records: role, log time, and the numbers in them."""
    result = []
    for role, log_ns, record in records:
        fields = [getattr(record, name) for name in record.__slots__]
        flat = [f.tolist() if isinstance(f, np.ndarray) else f for f in fields]
        result.append((role, log_ns, flat))
    return result


def read(path, topics=DEFAULT_TOPICS):
    with BagReader(path) as bag:
        return summary(bag.records(topics))


def rosbags_bag(path, plugin, mode=None, messages=None):
    writer = RosbagsWriter(path, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, msgtype, stamp, message in messages or sample_messages():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=TYPES._store)
            writer.write(connections[topic], stamp, TYPES.serialize(msgtype, message))
    return path


def mcap_bag(path, messages, **options):
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start("ros2")
        channels = {}
        for topic, msgtype, stamp, message in messages:
            if topic not in channels:
                schema = writer.register_schema(
                    msgtype, "ros2msg", TYPES.definition(msgtype).encode()
                )
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(TYPES.serialize(msgtype, message))
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
    return path


def foreign_bag(path, messages, *, profile="ros2", name=str, **of_messages):
    """Write messages with the mcap library, as programs other than the package do.

    Parameters
    ----------
    path
        The file; its folder is created.
    messages
        (topic, type, log_ns, message or its bytes) each.
    profile
        MCAP profile of the file.
    name
        Returns the name of a type in the file.
    of_messages
        ``encoding`` of all messages, and of all schemas: ``schema_encoding``, ``schema_data``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    encoding = of_messages.get("encoding", "cdr")
    schema_encoding = of_messages.get("schema_encoding", "ros2msg")
    with path.open("wb") as stream:
        writer, channels = Writer(stream), {}
        writer.start(profile)
        for topic, kind, stamp, message in messages:
            if (topic, kind) not in channels:
                text = of_messages.get("schema_data", b"")
                schema = writer.register_schema(name(kind), schema_encoding, text)
                channels[topic, kind] = writer.register_channel(topic, encoding, schema)
            data = message if isinstance(message, bytes) else bytes(TYPES.serialize(kind, message))
            writer.add_message(channels[topic, kind], stamp, data, stamp)
        writer.finish()
    return path


def ros1_name(msgtype):
    """Return the ROS 1 name of a type: ``package/Type``."""
    return msgtype.replace("/msg/", "/")
