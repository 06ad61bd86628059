"""Recordings at random: topics, types, encodings, schemas and headers that drivers write."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from bag_copies import foreign_bag, ros1_name, summary
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sample_bags import JOINTS, ODOM, SCAN, START, STRING, TF, TYPES, sample_messages

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.bags.topics import choose_topics
from tccm_ros.config import Config
from tccm_ros.errors import TopicError
from tccm_ros.replay.info import bag_info
from tccm_ros.replay.processors import Pipeline
from tccm_ros.replay.run import run_bag

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
PACKED, CLOUD = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2"
KNOWN = [SCAN, ODOM, JOINTS, STRING, TF, IMAGE, INFO, PACKED, CLOUD, "sensor_msgs/msg/Imu"]
FOREIGN = ["my_msgs/msg/Status", "my_msgs/Status", "a/srv/Switch_Event", "Status", "foxglove.Log",
           "", "a/b/c/d"]  # fmt: skip

topics = st.sampled_from([*DEFAULT_TOPICS.values(), "/camera/image", "/camera/camera_info", "/x"])
channels = st.tuples(
    topics,
    st.sampled_from([*KNOWN, *FOREIGN]),
    st.sampled_from(["cdr", "json", "protobuf", "ros1", "cbor", ""]),
    st.tuples(
        st.sampled_from(["ros2msg", "ros2idl", "jsonschema", "protobuf", "ros1msg", "unknown", ""]),
        st.binary(max_size=12),
    ),
    st.booleans(),
    st.none() | st.binary(max_size=40),
)


@settings(max_examples=60)
@given(st.lists(channels, max_size=4), st.sampled_from(["ros2", "ros1", "", "other"]))
@example([("/status", "my_msgs/msg/Status", "cdr", ("ros2msg", b"uint8 x"), False, b"\0\1\0\0x")],
         "ros2")  # fmt: skip
@example([("/scan", CLOUD, "cdr", ("ros2msg", b""), False, None)], "ros2")
def test_any_topics_beside_those_of_a_robot_leave_its_records_as_they_are(added, profile):
    messages = sample_messages(3, beams=5)
    with TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        foreign_bag(bag / "robot.mcap", messages, profile=profile)
        with BagReader(bag) as reader:
            alone = summary(reader.records())
        taken = set()
        for k, (topic, kind, encoding, (schema, text), is_ros1, data) in enumerate(added):
            if data is None:
                data = bytes(TYPES.serialize(kind, TYPES.make(kind))) if kind in KNOWN else b""
            foreign_bag(
                bag / f"{k}.mcap", [(topic, kind, START + k, data)], encoding=encoding,
                schema_encoding=schema, schema_data=text, name=ros1_name if is_ros1 else str,
            )  # fmt: skip
            if encoding == "cdr":
                taken.add((topic, kind))
        with BagReader(bag) as reader:
            roles = {
                role: topic for role, topic in DEFAULT_TOPICS.items()
                if not any(topic == name and kind in KNOWN for name, kind in taken)
            }  # fmt: skip
            choice = choose_topics(reader, Config(), may_doubt=True)
            assert all("\n" not in note for note in choice.notes)
            read = summary(reader.records(roles))
        assert read == [record for record in alone if record[0] in roles]
        assert all("\n" not in note for note in bag_info(bag).notes)


frames = st.sampled_from(["laser", "/laser", "", "base_link", "läser", "a b", "x" * 300])
stamps = st.sampled_from([0, 1, START, START + 1, START - 10**9, 2**31 * 10**9 - 1])


@settings(max_examples=25)
@given(st.lists(st.tuples(st.integers(0, 60), frames, stamps), max_size=8))
def test_any_headers_of_messages_end_with_records_counted_or_one_line(changes):
    messages = sample_messages(6, beams=9)[1:]  # its robot description is none
    for place, frame, stamp in changes:
        message = messages[place % len(messages)][3]
        if hasattr(message, "header"):
            message.header.frame_id = frame
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    with TemporaryDirectory() as folder:
        bag = foreign_bag(Path(folder) / "bag.mcap", messages)
        assert all("\n" not in note for note in bag_info(bag).notes)
        pipeline = Pipeline(Config(), expects_odometry=True)
        with BagReader(bag) as reader:
            choice = choose_topics(reader, Config(), may_doubt=True)
            reader.add_readers(choice.readers)
            for role, _, record in reader.records(choice.topics):
                pipeline.add(role, record)
        pipeline.finish()
    sensor = pipeline.robot.sensors["tilt_scan"]
    assert sensor.received == sensor.posed + sum(sensor.dropped.values())


def test_a_recording_without_anything_of_use_is_one_line(tmp_path):
    foreign = [("/status", "my_msgs/msg/Status", START, b"x")]
    bag = foreign_bag(tmp_path / "bag.mcap", foreign)
    assert bag_info(bag).notes
    with pytest.raises(TopicError, match="no topic /tilt_scan"):
        run_bag(bag, Config())
