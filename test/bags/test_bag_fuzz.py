"""Damaged bags: an error of ours or the truth, never a crash, a hang or gigabytes."""

import sqlite3
import tracemalloc
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import zstandard
from bag_copies import mcap_bag, rosbags_bag, summary
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from sample_bags import sample_messages

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.recover import recover
from tccm_ros.errors import TccmError

MAX_BYTES = 30_000_000
"""Peak of Python's allocations for a bag of some kB; the codecs' own buffers are a few MB."""


def original(name):
    """Return the bytes of a small bag of some kind."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bag.mcap"
        if name == "sqlite3":
            bag = rosbags_bag(Path(folder) / "bag", StoragePlugin.SQLITE3)
            (path,) = bag.glob("*.db3")
            connection = sqlite3.connect(path)
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            connection.close()
        elif name == "message compression":
            bag = rosbags_bag(Path(folder) / "bag", StoragePlugin.MCAP, CompressionMode.MESSAGE)
            (path,) = bag.glob("*.mcap")
        else:
            options = {
                "zstd": {"chunk_size": 1500},
                "lz4": {"chunk_size": 1500, "compression": CompressionType.LZ4},
                "plain": {"chunk_size": 1500, "compression": CompressionType.NONE},
                "unchunked": {"use_chunking": False},
                "without checksums": {"chunk_size": 1500, "enable_crcs": False},
            }[name]
            mcap_bag(path, sample_messages(12), **options)
        return path.read_bytes()


KINDS = ["zstd", "lz4", "plain", "unchunked", "without checksums", "sqlite3"]
KINDS += ["message compression"]
UNDAMAGED = {}
CHECKED = ("zstd", "lz4", "plain")
"""Kinds in which every byte of a message is under a checksum."""

numbers = [b"\xff" * 8, b"\0" * 8, (2**31).to_bytes(8, "little"), (2**62).to_bytes(8, "little")]
edits = st.lists(
    st.tuples(
        st.floats(0, 1, exclude_max=True),
        st.one_of(st.binary(min_size=1, max_size=2), st.sampled_from(numbers)),
    ),
    min_size=1,
    max_size=4,
)


def apply(data, changes):
    result = bytearray(data)
    for place, piece in changes:
        at = int(place * len(result))
        result[at : at + len(piece)] = piece
    return bytes(result[: len(data)])


def read_some(path):
    """Return what can be read of a bag before the first error, and whether there was one."""
    got = []
    try:
        with BagReader(path) as bag:
            bag.topics()
            for item in bag.records():
                got.append(item)
    except TccmError as error:
        text = str(error)
    else:
        return got, bool(bag.dropped)
    assert str(path) in text
    assert "\n" not in text
    return got, True


@pytest.fixture(scope="module", autouse=True)
def undamaged_bags():
    for kind in KINDS:
        UNDAMAGED[kind] = original(kind)


@settings(max_examples=250, deadline=None)
@given(kind=st.sampled_from(KINDS), changes=edits, cut=st.floats(0.0, 1.0))
@example(kind="zstd", changes=[(0.0, b"\x88")], cut=1.0)
def test_damage_is_an_error_or_harmless(kind, changes, cut):
    data = UNDAMAGED[kind]
    damaged = apply(data, changes)
    if cut < 0.3:
        damaged = damaged[: int(len(damaged) * cut / 0.3)]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bag.mcap"
        path.write_bytes(damaged)
        tracemalloc.start()
        try:
            got, failed = read_some(path)
            with suppress(TccmError):
                recover(path, Path(folder) / "out")
            assert tracemalloc.get_traced_memory()[1] < MAX_BYTES
        finally:
            tracemalloc.stop()
        if kind in CHECKED:
            path.write_bytes(data)
            truth = summary(read_some(path)[0])
            assert summary(got) == truth[: len(got)]
            assert failed or len(got) == len(truth)


@settings(max_examples=60, deadline=None)
@given(
    data=st.binary(max_size=300),
    head=st.sampled_from([b"", b"\x89MCAP0\r\n", b"SQLite format 3\0"]),
)
def test_garbage_is_an_error(data, head):
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bag.mcap"
        path.write_bytes(head + data)
        assert read_some(path) == ([], True)
        with pytest.raises(TccmError):
            recover(path, Path(folder) / "out")


def test_a_compressed_bomb_is_refused(tmp_path):
    compressor = zstandard.ZstdCompressor().compressobj()
    bomb = b"".join(compressor.compress(bytes(2**22)) for _ in range(40)) + compressor.flush()
    packed = tmp_path / "bomb.mcap.zstd"
    packed.write_bytes(bomb)
    _, failed = read_some(packed)
    assert failed
