import shutil
import sqlite3
from collections import Counter

import pytest
import zstandard
from bag_copies import mcap_bag, read, rosbags_bag
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from sample_bags import START, sample_messages, write_sample

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.recover import recover
from tccm_ros.errors import BagError, OutputError

TABLE_LEAF = 0x0D
"""First byte of a database page with rows of a table."""

N = 200
EVERYTHING = 2 + 3 * N


def big_bag(path, **options):
    return mcap_bag(path, sample_messages(N), **{"chunk_size": 4000, **options})


KINDS = [
    {"compression": CompressionType.ZSTD},
    {"compression": CompressionType.LZ4},
    {"compression": CompressionType.NONE},
    {"use_chunking": False},
]


@pytest.mark.parametrize("options", KINDS)
def test_a_whole_bag_is_copied(tmp_path, options):
    bag = big_bag(tmp_path / "bag.mcap", **options)
    found = recover(bag, tmp_path / "out")
    assert (found.messages, found.topics, found.damaged_chunks) == (EVERYTHING, 5, 0)
    assert read(tmp_path / "out") == read(bag)


@pytest.mark.parametrize("options", KINDS)
@pytest.mark.parametrize("fraction", [0.3, 0.5, 0.9])
def test_every_chunk_before_the_cut_is_recovered(tmp_path, options, fraction):
    bag = big_bag(tmp_path / "bag.mcap", **options)
    before = read(bag)
    data = bag.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(len(data) * fraction)])
    with pytest.raises(BagError, match="recover"):
        BagReader(cut)
    found = recover(cut, tmp_path / "out.mcap")
    after = read(tmp_path / "out.mcap")
    assert after == before[: len(after)]
    assert len(after) > 0.6 * fraction * len(before)
    assert found.messages == len(after) - 1


@pytest.mark.parametrize("options", KINDS[:3])
def test_only_a_damaged_chunk_is_lost(tmp_path, options):
    bag = big_bag(tmp_path / "bag.mcap", **options)
    before = read(bag)
    data = bytearray(bag.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 30] = b"\xaa" * 30
    bag.write_bytes(data)
    recover(bag, tmp_path / "out")
    after = read(tmp_path / "out")
    lost = Counter(map(repr, before)) - Counter(map(repr, after))
    assert not Counter(map(repr, after)) - Counter(map(repr, before))
    assert 0 < sum(lost.values()) < 0.2 * len(before)


def test_recovery_continues_after_a_damaged_record_length(tmp_path):
    bag = big_bag(tmp_path / "bag.mcap")
    before = read(bag)
    data = bytearray(bag.read_bytes())
    with bag.open("rb") as stream:
        chunks = [
            index.chunk_start_offset for index in make_reader(stream).get_summary().chunk_indexes
        ]
    hit = sorted(chunks)[len(chunks) // 2]
    data[hit + 1 : hit + 9] = b"\xff" * 8
    bag.write_bytes(data)
    found = recover(bag, tmp_path / "out")
    assert len(read(tmp_path / "out")) > len(before) - 20
    assert found.skipped_bytes > 0


def test_offered_qos_and_definitions_are_kept(tmp_path):
    bag = write_sample(tmp_path / "bag")
    recover(bag, tmp_path / "out")
    stored = []
    for path in (bag, tmp_path / "out"):
        with AnyReader([path]) as reader:
            stored.append({(c.topic, c.msgtype, c.msgdef, repr(c.ext)) for c in reader.connections})
    assert stored[0] == stored[1]
    assert len(stored[0]) == 5


def test_a_cut_compressed_file_is_recovered(tmp_path):
    data = big_bag(tmp_path / "bag.mcap", compression=CompressionType.NONE).read_bytes()
    packed = tmp_path / "bag.mcap.zstd"
    compressor = zstandard.ZstdCompressor().compressobj()
    whole = b"".join(
        compressor.compress(data[k : k + 1000])
        + compressor.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
        for k in range(0, len(data), 1000)
    )
    packed.write_bytes(whole[: len(whole) // 2])
    found = recover(packed, tmp_path / "out")
    assert 0 < found.messages < EVERYTHING


def test_a_damaged_database_is_read_from_both_ends(tmp_path):
    folder = rosbags_bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = folder.glob("*.db3")
    connection = sqlite3.connect(file)
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for k in range(3000):
        connection.execute(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)",
            (START + k, b"\0\1\0\0\1\0\0\0\0"),
        )
    connection.commit()
    page = connection.execute("PRAGMA page_size").fetchone()[0]
    connection.close()
    data = bytearray(file.read_bytes())
    leaves = [k for k in range(page, len(data), page) if data[k] == TABLE_LEAF]
    middle = leaves[len(leaves) // 2]
    data[middle : middle + page] = b"\xff" * page
    file.write_bytes(data)
    with pytest.raises(BagError, match=f"{file}.*try `tccm recover`"), BagReader(file) as reader:
        list(reader.messages())
    found = recover(file, tmp_path / "out")
    assert 3062 - 2 * page / 20 < found.messages < 3062


def test_a_database_whose_log_was_left_beside_it_is_recovered_with_it(tmp_path):
    folder = rosbags_bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = folder.glob("*.db3")
    before = read(file)
    recorder = sqlite3.connect(file)
    recorder.execute("PRAGMA journal_mode=WAL")
    last = START + 10**9
    recorder.execute(
        "INSERT INTO messages (topic_id, timestamp, data) "
        f"SELECT topic_id, {last}, data FROM messages WHERE id = 3"
    )
    recorder.commit()
    crashed = tmp_path / "crashed"
    shutil.copytree(folder, crashed)
    recorder.close()
    with pytest.raises(BagError, match=r"db3-wal holds messages.*try `tccm recover`"):
        BagReader(crashed)
    recover(crashed, tmp_path / "out")
    after = read(tmp_path / "out")
    assert after[:-1] == before
    assert after[-1][1] == last


def test_without_readable_messages_no_bag_is_written(tmp_path):
    (tmp_path / "bag.mcap").write_bytes(b"\x89MCAP0\r\n" + b"garbage" * 100)
    with pytest.raises(BagError, match="nothing in it can be recovered"):
        recover(tmp_path / "bag.mcap", tmp_path / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["bag.mcap"]
    with pytest.raises(BagError, match="no such bag"):
        recover(tmp_path / "absent", tmp_path / "out")


def test_an_existing_bag_is_not_overwritten(tmp_path):
    bag = write_sample(tmp_path / "bag.mcap", n=1)
    with pytest.raises(OutputError, match="exists already"):
        recover(bag, bag)
