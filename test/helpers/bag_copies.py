"""One recording as other writers store it, and what is read of it."""

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
