import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from sample_bags import SCAN, START, STRING, TYPES, expected_records, sample_messages, write_sample

from tccm_ros.bags.offered_qos import Qos
from tccm_ros.bags.writer import BagWriter
from tccm_ros.errors import OutputError


def files(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


def test_same_input_gives_the_same_bytes(tmp_path):
    first = write_sample(tmp_path / "one" / "bag")
    second = write_sample(tmp_path / "two" / "bag")
    assert files(first) == files(second)
    assert sorted(files(first)) == ["bag.mcap", "metadata.yaml"]


def test_other_readers_read_the_folder(tmp_path):
    bag = write_sample(tmp_path / "bag")
    with AnyReader([bag]) as reader:
        found = [(c.topic, c.msgtype, t, bytes(raw)) for c, t, raw in reader.messages()]
        qos = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    written = [(a, b, c, bytes(TYPES.serialize(b, d))) for a, b, c, d in sample_messages()]
    assert sorted(found) == sorted(written)
    assert qos["/tf_static"].durability == QosDurability.TRANSIENT_LOCAL
    assert qos["/tilt_scan"].durability == QosDurability.VOLATILE
    assert qos["/tilt_scan"].reliability == QosReliability.RELIABLE


def test_the_file_has_checksums_and_the_given_times(tmp_path):
    bag = write_sample(tmp_path / "bag.mcap")
    with bag.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert all(m.log_time == m.publish_time for _, _, m in reader.iter_messages())
        assert reader.get_header().library == "tccm_ros"
    assert summary.statistics.message_count == 2 + 3 * 20
    assert all(schema.data for schema in summary.schemas.values())


def test_metadata_has_the_counts_and_times_of_the_messages(tmp_path):
    bag = write_sample(tmp_path / "bag")
    information = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    counts = {
        t["topic_metadata"]["name"]: t["message_count"]
        for t in information["topics_with_message_count"]
    }
    assert counts == {f"/{role}": max(n, 1) for role, n in expected_records().items()} | {
        "/tf_static": 1
    }
    assert information["starting_time"]["nanoseconds_since_epoch"] == START
    assert information["duration"]["nanoseconds"] == 19 * 20_000_000 + 2000
    assert information["relative_file_paths"] == ["bag.mcap"]


def test_the_quality_of_service_of_a_topic_can_be_given(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/scan", SCAN, Qos(reliable=False, depth=5))
        writer.write("/scan", SCAN, START, TYPES.make(SCAN))
    with AnyReader([tmp_path / "bag"]) as reader:
        (profile,) = reader.connections[0].ext.offered_qos_profiles
    assert profile.reliability == QosReliability.BEST_EFFORT
    assert profile.depth == 5


def test_an_empty_bag_is_a_bag(tmp_path):
    with BagWriter(tmp_path / "bag"):
        pass
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 0


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_no_file_remains_after_an_exception(tmp_path, name):
    def interrupted():
        with BagWriter(tmp_path / name) as writer:
            writer.write("/a", STRING, START, TYPES.make(STRING))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_existing_bag_is_replaced_on_request_once_the_new_one_is_complete(tmp_path, name):
    path = write_sample(tmp_path / name, n=3)
    with pytest.raises(OutputError, match="exists already"):
        BagWriter(path)

    def failing():
        with BagWriter(path, overwrite=True) as writer:
            writer.write("/a", STRING, START, "not a message")

    before = path.read_bytes() if path.is_file() else files(path)
    with pytest.raises(AttributeError):
        failing()
    assert (path.read_bytes() if path.is_file() else files(path)) == before
    write_sample(path, n=4, overwrite=True)
    assert (path.read_bytes() if path.is_file() else files(path)) != before
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_other_files_are_renamed_with_the_bag(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        (writer.folder / "truth.json").write_text("{}")
        assert not (tmp_path / "bag").exists()
    assert (tmp_path / "bag" / "truth.json").exists()


def test_the_error_names_a_path_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"), BagWriter(tmp_path / "file" / "a"):
        pass


@pytest.mark.parametrize("stamp", [-1, 2**63])
def test_stamps_out_of_range_are_refused(tmp_path, stamp):
    def write():
        with BagWriter(tmp_path / "bag") as writer:
            writer.write("/a", STRING, stamp, TYPES.make(STRING))

    with pytest.raises(OutputError, match="stamp"):
        write()


def test_a_topic_keeps_its_type(tmp_path):
    def write():
        with BagWriter(tmp_path / "bag") as writer:
            writer.write("/a", STRING, START, TYPES.make(STRING))
            writer.write("/a", SCAN, START, TYPES.make(SCAN))

    with pytest.raises(ValueError, match="std_msgs"):
        write()
