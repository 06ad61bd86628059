import struct

import numpy as np
import pytest
import zstandard
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from tccm_ros.results.packed import pack_arrays, unpack_arrays

KINDS = ["?", "u1", "i1", "i2", "u4", "i4", "i8", "f4", "f8", ">i4", ">f8"]


@given(
    st.lists(
        st.sampled_from(KINDS).flatmap(
            lambda kind: arrays(np.dtype(kind), array_shapes(min_dims=0, min_side=0, max_side=5))
        ),
        max_size=4,
    )
)
@example([np.zeros((0, 10), np.int64), np.zeros((3, 0), np.int32)])
@example([np.array(7), np.array(-0.0), np.array(np.nan)])
@example([np.asfortranarray(np.arange(12).reshape(3, 4)), np.arange(24).reshape(2, 3, 4)])
def test_arrays_come_back_bit_for_bit(given_arrays):
    named = {f"part/{k}": array for k, array in enumerate(given_arrays)}
    block = pack_arrays(named)
    assert pack_arrays(named) == block
    got = unpack_arrays(block)
    assert list(got) == list(named)
    for name, array in named.items():
        assert got[name].shape == array.shape
        assert got[name].dtype == array.dtype.newbyteorder("<")
        assert got[name].tobytes() == array.astype(array.dtype.newbyteorder("<")).tobytes()
        assert got[name].flags.writeable


def test_no_array_keeps_the_block_alive():
    got = unpack_arrays(pack_arrays({"a": np.zeros(100), "b": np.arange(10)}))
    for array in got.values():
        base = array if array.base is None else array.base
        assert base.nbytes == array.nbytes


def test_what_occurs_twice_is_kept_once():
    rng = np.random.default_rng(0)
    rows = rng.normal(0.0, 1.0, (20_000, 3))
    one = len(pack_arrays({"a": rows}))
    assert len(pack_arrays({"a": rows, "far": rng.normal(size=10**6), "b": rows[5000:]})) < (
        len(pack_arrays({"far": rng.normal(size=10**6)})) + 1.1 * one
    )


def test_small_integers_take_few_bytes():
    moments = np.random.default_rng(1).integers(0, 200, (10_000, 10))
    assert len(pack_arrays({"a": moments})) < 1.05 * moments.size


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.99])
def test_a_block_that_is_cut_off_is_an_error(share):
    block = pack_arrays({"a": np.arange(1000), "b": np.ones(1000)})
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        unpack_arrays(block[: int(share * len(block))])


def block_of(table, content=b""):
    return zstandard.compress(struct.pack("<Q", len(table)) + table + content)


@pytest.mark.parametrize(
    "block",
    [
        block_of(b"[]", b"more"),
        block_of(b"["),
        block_of(b"[1]"),
        block_of(b'[["a", "<i8", [2]]]', bytes(15)),
        block_of(b'[["a", "<i8", [-1, -2]]]', bytes(16)),
        block_of(b'[["a", "O", [1]]]', bytes(8)),
        block_of(b'[["a", "<i8", [9223372036854775807, 9]]]'),
        block_of(b'[["a", "no type", [1]]]', bytes(8)),
        zstandard.compress(b"123"),
        b"no block",
    ],
)
def test_what_is_no_block_is_an_error(block):
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        unpack_arrays(block)


def test_a_small_block_that_would_be_huge_is_refused():
    block = zstandard.compress(bytes(200 << 20))
    assert len(block) < 100_000
    with pytest.raises(ValueError, match="declares"):
        unpack_arrays(block)


def test_other_things_than_numbers_are_refused():
    with pytest.raises(TypeError, match="no numbers"):
        pack_arrays({"a": np.array(["text"])})
