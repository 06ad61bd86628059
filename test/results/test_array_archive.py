import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.results.array_archive import array_archive, read_arrays

MAX_ARCHIVE_BYTES = 2**31  # of all arrays together

ARRAYS = {
    "a": np.arange(5.0),
    "name/of": np.array("odom"),
    "none": np.zeros((0, 3), np.int32),
    "fortran": np.asfortranarray(np.arange(6).reshape(2, 3)),
    "number": np.int64(7),
}


def test_an_archive_is_the_same_each_time_and_is_an_npz():
    data = array_archive(ARRAYS)
    assert data == array_archive(ARRAYS)
    with np.load(io.BytesIO(data), allow_pickle=False) as found:
        for name, array in ARRAYS.items():
            np.testing.assert_array_equal(found[name], array)


def test_arrays_are_read_as_they_were_written(tmp_path):
    (tmp_path / "a.npz").write_bytes(array_archive(ARRAYS))
    for found in (read_arrays(tmp_path / "a.npz"), read_arrays(io.BytesIO(array_archive(ARRAYS)))):
        assert list(found) == list(ARRAYS)
        for name, array in ARRAYS.items():
            np.testing.assert_array_equal(found[name], array)
            assert found[name].dtype == np.asarray(array).dtype


def archive_of(header: dict, body: bytes = b"") -> io.BytesIO:
    entry, stream = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(entry, header)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", entry.getvalue() + body)
    return stream


@pytest.mark.parametrize("shape", [(10**12,), (2**40, 2**40), (-1,), (3,)])
def test_an_array_that_declares_more_than_it_stores_takes_no_memory(shape):
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    with pytest.raises(ValueError, match="an array of shape"):
        read_arrays(archive_of(header, b"\0" * 16))


def test_an_array_of_objects_is_refused():
    header = {"descr": "|O", "fortran_order": False, "shape": (1,)}
    with pytest.raises(ValueError, match="an array of objects"):
        read_arrays(archive_of(header))


def test_an_archive_that_declares_too_much_is_refused_unread():
    stream = archive_of({"descr": "<f8", "fortran_order": False, "shape": (2,)}, b"\0" * 16)
    content = bytearray(stream.getvalue())
    directory = content.rindex(b"PK\x01\x02")
    content[directory + 24 : directory + 28] = (MAX_ARCHIVE_BYTES + 1).to_bytes(4, "little")
    with pytest.raises(ValueError, match=r"declare 2\.0 GiB"):
        read_arrays(io.BytesIO(content))


@given(st.data())
def test_a_damaged_archive_is_an_error_or_reads_as_before(data):
    content = bytearray(array_archive(ARRAYS))
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    try:
        found = read_arrays(io.BytesIO(content))
    except ValueError:
        return
    for name in set(found) & set(ARRAYS):
        np.testing.assert_array_equal(found[name], ARRAYS[name])
