import os
import sqlite3
import tracemalloc
from collections import Counter

import numpy as np
import pytest
import yaml
import zstandard
from bag_copies import foreign_bag, mcap_bag, read, ros1_name, rosbags_bag
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from sample_bags import (
    JOINTS,
    SCAN,
    START,
    STRING,
    TYPES,
    expected_records,
    sample_messages,
    write_sample,
)
from shared_data import shared

from tccm_ros.bags.offered_qos import Qos
from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader, remap_topics
from tccm_ros.bags.recover import recover
from tccm_ros.bags.writer import BagWriter
from tccm_ros.errors import BagError, TopicError

MANY = 1_000_000 if os.environ.get("TCCM_LONG") else 100_000
"""Messages of a long bag."""


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Return the records of the sample, read from the simplest bag."""
    return read(write_sample(tmp_path_factory.mktemp("reference") / "bag"))


def test_records_are_read_in_log_order(reference):
    assert Counter(role for role, _, _ in reference) == expected_records()
    times = [log_ns for _, log_ns, _ in reference]
    assert times == sorted(times)
    roles = [role for role, _, _ in reference]
    assert roles[:6] == [
        "robot_description", "tf_static", "tf_static", "odom", "joint_states", "tilt_scan",
    ]  # fmt: skip


def test_a_bag_has_topics_and_times(tmp_path):
    with BagReader(write_sample(tmp_path / "bag")) as bag:
        infos = {t.name: (t.msgtype, t.count) for t in bag.topics()}
        assert infos["/joint_states"] == (JOINTS, 20)
        assert list(infos) == sorted(infos)
        assert (bag.start_ns, bag.end_ns) == (START, START + 19 * 20_000_000 + 2000)
        assert bag.duration == pytest.approx(0.380002)


@pytest.mark.parametrize("mode", [None, CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("with_metadata", [True, False])
def test_bags_of_other_writers_are_read(tmp_path, reference, plugin, mode, with_metadata):
    bag = rosbags_bag(tmp_path / "bag", plugin, mode)
    if not with_metadata:
        (bag / "metadata.yaml").unlink()
    assert read(bag) == reference
    (file,) = [p for p in bag.iterdir() if p.name != "metadata.yaml"]
    assert read(file) == reference


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.LZ4, "chunk_size": 500},
        {"compression": CompressionType.NONE, "chunk_size": 500},
        {"use_chunking": False},
        {"use_chunking": False, "use_statistics": False},
        {"index_types": IndexType.NONE, "chunk_size": 500},
        {"use_statistics": False, "chunk_size": 500},
        {"repeat_channels": False, "repeat_schemas": False},
        {"enable_crcs": False},
    ],
)
def test_mcap_files_with_all_options_of_writing_are_read(tmp_path, reference, options):
    bag = mcap_bag(tmp_path / "bag.mcap", sample_messages(), **options)
    assert read(bag) == reference
    with BagReader(bag) as reader:
        assert sum(t.count for t in reader.topics()) == 62
        assert reader.start_ns == START


def test_chunks_that_overlap_are_read_in_log_order(tmp_path, reference):
    messages = sample_messages()
    shuffled = [messages[k] for k in np.random.default_rng(1).permutation(len(messages))]
    bag = mcap_bag(tmp_path / "bag.mcap", shuffled, chunk_size=400)
    times = [log_ns for _, log_ns, _ in read(bag)]
    assert times == sorted(times)
    assert sorted(map(repr, read(bag))) == sorted(map(repr, reference))


def write_splits(folder, parts, names):
    folder.mkdir()
    messages = sample_messages()
    for k, name in enumerate(names):
        mcap_bag(folder / name, messages[k::parts] if parts < 0 else messages[
            k * len(messages) // parts : (k + 1) * len(messages) // parts])  # fmt: skip
    return folder


def long_bag(path, count):
    """Write many messages that are alike, as fast as may be."""
    types = {topic: (kind, message) for topic, kind, _, message in sample_messages(1)}
    kind, message = types["/joint_states"]
    data = bytes(TYPES.serialize(kind, message))
    if path.suffix == ".mcap":
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start("ros2")
            schema = writer.register_schema(kind, "ros2msg", TYPES.definition(kind).encode())
            channel = writer.register_channel("/joint_states", "cdr", schema)
            for k in range(count):
                writer.add_message(channel, START + k, data, START + k)
            writer.finish()
        return path
    with RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=TYPES._store)
        for k in range(count):
            writer.write(connection, START + k, data)
    return path


@pytest.mark.parametrize("name", ["bag.mcap", "sqlite"])
def test_memory_does_not_grow_with_the_length_of_a_bag(tmp_path, name):
    peaks = []
    for count in (20_000, MANY):
        path = long_bag(tmp_path / f"{count}_{name}", count)
        tracemalloc.start()
        with BagReader(path) as bag:
            read = sum(1 for _ in bag.records(DEFAULT_TOPICS))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert read == count
    # What grows is the index of an mcap's chunks: some hundred bytes for each megabyte.
    assert peaks[1] < peaks[0] + 1_000_000


def test_splits_are_one_bag_in_any_order_of_names(tmp_path, reference):
    assert read(write_splits(tmp_path / "a", 3, ["b_0.mcap", "b_1.mcap", "b_2.mcap"])) == reference
    assert read(write_splits(tmp_path / "b", 3, ["z.mcap", "y.mcap", "x.mcap"])) == reference


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_splits_that_are_compressed_and_have_no_metadata_are_read(tmp_path, reference, plugin):
    folder, messages = tmp_path / "bag", sample_messages()
    folder.mkdir()
    for k in range(3):
        part = messages[k * len(messages) // 3 : (k + 1) * len(messages) // 3]
        made = rosbags_bag(tmp_path / f"part{k}", plugin, CompressionMode.FILE, part)
        (content,) = made.glob("*.zstd")
        content.rename(folder / f"bag_{k}{''.join(content.suffixes)}")
    assert read(folder) == reference


def test_several_bags_are_read_as_one_recording(tmp_path, reference):
    folder = write_splits(tmp_path / "a", 3, ["b_0.mcap", "b_1.mcap", "b_2.mcap"])
    parts = [folder / "b_2.mcap", tmp_path / "first", folder / "b_1.mcap"]
    parts[1].mkdir()
    (folder / "b_0.mcap").rename(parts[1] / "bag.mcap")
    assert read(parts) == reference
    with BagReader(parts) as bag:
        assert {t.name: t.count for t in bag.topics()}["/joint_states"] == 20
        assert bag.duration == pytest.approx(0.380002)


def test_compressed_bags_of_one_name_are_read_together(tmp_path, reference):
    messages = sample_messages()
    for k, part in enumerate([messages[:30], messages[30:]]):
        folder = tmp_path / str(k)
        folder.mkdir()
        rosbags_bag(folder / "bag", StoragePlugin.MCAP, CompressionMode.FILE, part)
    assert read([tmp_path / "0" / "bag", tmp_path / "1" / "bag"]) == reference


@pytest.mark.parametrize("together", [False, True])
def test_topic_of_two_types_is_read_with_the_type_of_its_role(tmp_path, together):
    folders = [tmp_path / "one", tmp_path / ("one" if together else "two")]
    rows = [[("/scan", STRING, START, TYPES.make(STRING))],
            [("/scan", SCAN, START + 1, TYPES.make(SCAN))]]  # fmt: skip
    if together:
        foreign_bag(folders[0] / "bag.mcap", [*rows[0], *rows[1]])
    else:
        for folder, messages in zip(folders, rows):
            foreign_bag(folder / "bag.mcap", messages)
    with BagReader(sorted(set(folders))) as bag:
        infos = [info for info in bag.topics() if info.name == "/scan"]
        assert [(info.msgtype, info.count) for info in infos] == [(SCAN, 1), (STRING, 1)]
        assert [role for role, _, _ in bag.records()] == ["scan"]
        assert [i.why_not_read(SCAN) for i in infos] == ["", f"/scan is {STRING}, expected {SCAN}"]


def test_a_bag_cannot_be_named_twice(tmp_path):
    bag = write_sample(tmp_path / "bag", n=1)
    with pytest.raises(BagError, match=r"bag\.mcap: named 2 times"):
        BagReader([bag, bag / "bag.mcap"])


def test_a_missing_split_is_named(tmp_path):
    folder = write_splits(tmp_path / "a", 2, ["b_0.mcap", "b_1.mcap"])
    metadata = {"rosbag2_bagfile_information": {"relative_file_paths": ["b_0.mcap", "b_9.mcap"]}}
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    with pytest.raises(BagError, match=r"b_9\.mcap, which is not there"):
        BagReader(folder)


def test_metadata_cannot_point_outside_of_its_folder(tmp_path):
    folder = write_splits(tmp_path / "a", 1, ["b_0.mcap"])
    metadata = {"rosbag2_bagfile_information": {"relative_file_paths": ["../../etc/passwd"]}}
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    with pytest.raises(BagError, match="passwd, which is not there"):
        BagReader(folder)


def test_remappings_change_the_topics_of_roles(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write("/base_scan", SCAN, START, TYPES.make(SCAN))
    topics = remap_topics(["scan:=base_scan", "/tilt_scan:=/base_scan"])
    assert [role for role, _, _ in read(tmp_path / "bag", topics)] == ["tilt_scan", "scan"]
    assert read(tmp_path / "bag") == []


@pytest.mark.parametrize("remap", ["scan=/x", "scan:=", "scann:=/x"])
def test_remappings_of_another_form_are_errors(remap):
    with pytest.raises(TopicError):
        remap_topics([remap])


def test_unknown_role_names_the_nearest():
    with pytest.raises(TopicError, match="did you mean 'scan'"):
        remap_topics(["scann:=/x"])


def test_another_type_on_a_topic_names_both(tmp_path):
    foreign_bag(tmp_path / "bag.mcap", [("/scan", STRING, START, TYPES.make(STRING))])
    with BagReader(tmp_path / "bag.mcap") as bag:
        assert list(bag.records()) == []
        said = bag.missing("scan", "/scan")
    assert said.endswith(f"bag.mcap: /scan is {STRING}, expected {SCAN}")


def test_a_missing_topic_names_those_of_its_type(tmp_path):
    with BagReader(write_sample(tmp_path / "bag", n=2)) as bag:
        assert "of this type there are: /tilt_scan" in bag.missing("scan", "/scan")
        assert "there are: /joint_states" in bag.missing("view", "/tccm/view")


def test_messages_that_cannot_be_used_are_counted(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write("/odom", "nav_msgs/msg/Odometry", START, b"\0\1\0\0garbage")
        writer.write("/tilt_scan", SCAN, START, TYPES.make(SCAN, angle_min=float("nan")))
        writer.write("/tilt_scan", SCAN, START + 1, TYPES.make(SCAN))
    with BagReader(tmp_path / "bag") as bag:
        assert [role for role, _, _ in bag.records()] == ["tilt_scan"]
        assert bag.dropped == {"/odom": 1, "/tilt_scan": 1}
        assert "angle_min nan" in bag.problems["/tilt_scan"]


def test_offered_qos_is_kept(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/scan", SCAN, Qos(reliable=False, depth=7))
        writer.write("/scan", SCAN, START, TYPES.make(SCAN))
        writer.write("/tf_static", "tf2_msgs/msg/TFMessage", START,
                     TYPES.make("tf2_msgs/msg/TFMessage"))  # fmt: skip
    with BagReader(tmp_path / "bag") as bag:
        assert bag.qos("/scan") == Qos(reliable=False, depth=7)
        assert bag.qos("/tf_static") == Qos(latched=True, depth=1)
        assert bag.qos("/robot_description") == Qos(latched=True, depth=1)


@pytest.mark.parametrize("profile", ["ros1", "ros2", ""])
def test_ros_1_messages_name_the_conversion(tmp_path, profile):
    path = foreign_bag(
        tmp_path / "bag.mcap", [("/scan", SCAN, START, b"x")], profile=profile, encoding="ros1",
        schema_encoding="ros1msg", name=ros1_name,
    )  # fmt: skip
    with BagReader(path) as bag:
        assert list(bag.records()) == []
        assert "rosbags-convert" in bag.missing("scan", "/scan")


@pytest.mark.parametrize("profile", ["", "x-jsonschema"])
@pytest.mark.parametrize("name", [str, ros1_name])
def test_a_file_of_any_profile_and_names_of_types_with_one_slash_are_read(
    tmp_path, reference, profile, name
):
    path = foreign_bag(tmp_path / "bag.mcap", sample_messages(), profile=profile, name=name)
    assert read(path) == reference


@pytest.mark.parametrize(
    ("schema_encoding", "schema_data", "encoding"),
    [
        ("jsonschema", b"{}", "json"),
        ("protobuf", b"\x0a\xff\xfe", "protobuf"),
        ("ros1msg", b"", "ros1"),
        ("unknown", b"\x80", "cdr"),
        ("", b"", ""),
    ],
)
def test_a_topic_that_nobody_asks_for_may_be_anything(
    tmp_path, reference, schema_encoding, schema_data, encoding
):
    foreign_bag(tmp_path / "a" / "a.mcap", sample_messages())
    foreign = [("/status", "my_msgs/msg/Status", START, b"\xff")]
    foreign_bag(
        tmp_path / "b" / "b.mcap", foreign, schema_encoding=schema_encoding,
        schema_data=schema_data, encoding=encoding,
    )  # fmt: skip
    both = [tmp_path / "a", tmp_path / "b"]
    assert read(both) == reference
    with BagReader(both) as bag:
        (status,) = [info for info in bag.topics() if info.name == "/status"]
        assert (status.msgtype, status.encoding) == ("my_msgs/msg/Status", encoding)
    recover(tmp_path / "b", tmp_path / "copy")
    with BagReader(tmp_path / "copy") as bag:
        assert [(i.name, i.encoding, i.count) for i in bag.topics()] == [("/status", encoding, 1)]


def test_a_database_with_a_definition_in_an_unknown_form_is_read(tmp_path, reference):
    folder = rosbags_bag(tmp_path / "bag", StoragePlugin.SQLITE3, CompressionMode.NONE)
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("UPDATE message_definitions SET encoding = 'unknown'")
        database.execute("UPDATE topics SET offered_qos_profiles = 'damaged: ['")
    assert read(folder) == reference


def test_unknown_compression_is_not_recovered_as_damage(tmp_path):
    path = foreign_bag(tmp_path / "bag.mcap", sample_messages())
    path.write_bytes(path.read_bytes().replace(b"\4\0\0\0zstd", b"\4\0\0\0lzma"))
    without_summary_crc(path)
    with pytest.raises(BagError, match="compressed as 'lzma', expected zstd or lz4") as caught:
        BagReader(path)
    assert "recover" not in str(caught.value)


def without_summary_crc(path):
    """Set the checksum of the summary to 0: there is none."""
    data = bytearray(path.read_bytes())
    data[-12:-8] = bytes(4)
    path.write_bytes(data)


def damaged(path, name):
    """Make a path that is no bag, in one of many ways."""
    good = write_sample(path / "good.mcap").read_bytes()
    bag = path / "bag.mcap"
    if name == "absent":
        return path / "nothing"
    if name == "empty folder":
        (path / "folder").mkdir()
        return path / "folder"
    content = {
        "empty file": b"",
        "garbage": bytes(range(256)) * 20,
        "ros 1": b"#ROSBAG V2.0\n" + bytes(100),
        "magic alone": good[:8],
        "cut in half": good[: len(good) // 2],
        "cut by a byte": good[:-1],
        "sqlite header alone": b"SQLite format 3\0",
        "zstd of nothing": zstandard.compress(b""),
        "zstd of garbage": zstandard.compress(b"garbage"),
    }[name]
    bag.write_bytes(content)
    return bag


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("absent", "no such bag"),
        ("empty folder", "no bag in this folder"),
        ("empty file", "empty"),
        ("garbage", "neither mcap nor sqlite3"),
        ("ros 1", "ROS 1 bag"),
        ("magic alone", "cut off"),
        ("cut in half", "cut off.*try `tccm recover`"),
        ("cut by a byte", "cut off"),
        ("sqlite header alone", "database"),
        ("zstd of nothing", "empty"),
        ("zstd of garbage", "neither mcap nor sqlite3"),
    ],
)
def test_the_error_of_a_file_that_is_no_bag_names_the_cause(tmp_path, name, cause):
    path = damaged(tmp_path, name)
    with pytest.raises(BagError, match=cause) as caught:
        BagReader(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_bag_without_permission_is_an_error(tmp_path):
    bag = write_sample(tmp_path / "bag.mcap", n=1)
    bag.chmod(0)
    with pytest.raises(BagError, match="Permission denied"):
        BagReader(bag)


def test_damage_halfway_ends_the_reading_after_the_good_part(tmp_path):
    bag = mcap_bag(tmp_path / "bag.mcap", sample_messages(200), chunk_size=4000)
    data = bytearray(bag.read_bytes())
    data[len(data) // 2] ^= 0x40
    bag.write_bytes(data)
    got = []
    with BagReader(bag) as reader, pytest.raises(BagError, match="try `tccm recover`"):
        got.extend(reader.records())
    assert 200 < len(got) < 400


def test_chunks_that_declare_gigabytes_are_refused(tmp_path):
    bag = mcap_bag(tmp_path / "bag.mcap", sample_messages(3), compression=CompressionType.NONE,
                   enable_crcs=False)  # fmt: skip
    with bag.open("rb") as stream:
        (chunk,) = make_reader(stream).get_summary().chunk_indexes
    declared = chunk.uncompressed_size.to_bytes(8, "little")
    bag.write_bytes(bag.read_bytes().replace(declared, (2**40).to_bytes(8, "little")))
    with pytest.raises(BagError, match="declares"):
        BagReader(bag)


@pytest.mark.parametrize("kind", [CompressionType.ZSTD, CompressionType.LZ4])
@pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE])
def test_a_chunk_takes_no_more_memory_than_it_declares(tmp_path, kind, index):
    """It declares a megabyte and unpacks to 64: neither reading nor recovering takes them."""
    message = ("/robot_description", STRING, 1, TYPES.make(STRING, data="0" * 2**26))
    bag = mcap_bag(
        tmp_path / "bag.mcap", [message], compression=kind, enable_crcs=False, index_types=index
    )
    with bag.open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True).records)
    (chunk,) = (record for record in records if isinstance(record, Chunk))
    real, declared = (n.to_bytes(8, "little") for n in (chunk.uncompressed_size, 2**20))
    assert len(chunk.data) < 2**20 < 2**26 < chunk.uncompressed_size
    around = bag.read_bytes().split(chunk.data)
    bag.write_bytes(chunk.data.join(part.replace(real, declared) for part in around))
    tracemalloc.start()
    with (
        pytest.raises(BagError, match="declares 1048576 bytes and has more"),
        BagReader(bag) as reader,
    ):
        list(reader.records())
    with pytest.raises(BagError, match="nothing in it can be recovered"):
        recover(bag, tmp_path / "recovered")
    assert tracemalloc.get_traced_memory()[1] < 2**24
    tracemalloc.stop()


def test_messages_that_the_index_leaves_out_are_an_error(tmp_path):
    bag = mcap_bag(tmp_path / "bag.mcap", sample_messages(), chunk_size=500, enable_crcs=False)
    with bag.open("rb") as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[1]
    builder = RecordBuilder()
    chunk.write(builder)
    entry = builder.end()
    skipped = b"\xf0" + entry[1:]
    data = bag.read_bytes()
    assert data.count(entry) == 1
    bag.write_bytes(data.replace(entry, skipped))
    with pytest.raises(BagError, match="its index does not name all messages"):
        BagReader(bag)


def test_metadata_of_another_form_is_an_error(tmp_path):
    bag = write_sample(tmp_path / "bag", n=1)
    (bag / "metadata.yaml").write_text("- 1\n")
    with pytest.raises(BagError, match=r"metadata\.yaml.*without this file"):
        BagReader(bag)


def test_yaml_cannot_run_code(tmp_path):
    bag = write_sample(tmp_path / "bag", n=1)
    (bag / "metadata.yaml").write_text("!!python/object/apply:os.system ['touch hacked']\n")
    with pytest.raises(BagError):
        BagReader(bag)
    assert not os.path.exists("hacked")


@pytest.mark.parametrize("name", ["sim2_flat", "kurt3d_corridor", "dlut_A605"])
def test_real_recordings_are_read(name):
    with BagReader(shared(f"bags/{name}")) as bag:
        counts = Counter(role for role, _, _ in bag.records())
        topics = {t.name: t.count for t in bag.topics()}
    assert counts["tilt_scan"] == topics["/tilt_scan"] > 0
    assert not bag.dropped
