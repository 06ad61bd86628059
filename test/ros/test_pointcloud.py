import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_families import TYPESTORE

from tccm_ros.errors import MessageError
from tccm_ros.ros.pointcloud import (
    MAP_ROW,
    SURFACE_MAP_ROW,
    SURFACE_ROW,
    VIEW_ROW,
    cloud_message,
    cloud_rows,
)


def random_rows(row, n):
    data = np.random.default_rng(n).integers(0, 256, n * row.itemsize, dtype=np.uint8)
    return data.view(row)


@pytest.mark.parametrize("row", [MAP_ROW, SURFACE_MAP_ROW, SURFACE_ROW, VIEW_ROW])
@pytest.mark.parametrize("n", [0, 1, 5])
def test_rows_are_read_back_bit_for_bit(row, n):
    rows = random_rows(row, n)
    back = cloud_rows(cloud_message(TYPESTORE, 7, "map", rows), row)
    assert back.dtype == row
    assert back.tobytes() == rows.tobytes()


def organised(row, height, width, padding, big):
    """Make a cloud as other publishers do: an extra field first, padding, several lines."""
    order = ">" if big else "<"
    wide = np.dtype(
        [("intensity", f"{order}f8")]
        + [(name, order + row[name].str[1:]) for name in row.names]
        + [("pad", "V3")]
    )
    rows = np.zeros(height * width, wide)
    for k, name in enumerate(row.names):
        rows[name] = np.arange(height * width) + 10 * k
    lines = [rows[k * width : (k + 1) * width].tobytes() + b"\xff" * padding for k in range(height)]
    message = cloud_message(TYPESTORE, 0, "map", np.zeros(0, row))
    for field in message.fields:
        field.offset = wide.fields[field.name][1]
    message.height, message.width = height, width
    message.point_step, message.row_step = wide.itemsize, wide.itemsize * width + padding
    message.is_bigendian = big
    message.data = np.frombuffer(b"".join(lines), np.uint8)
    return message


@pytest.mark.parametrize("big", [False, True])
def test_cloud_with_padding_extra_fields_and_any_byte_order_is_read(big):
    rows = cloud_rows(organised(SURFACE_ROW, 3, 4, 5, big), SURFACE_ROW)
    assert rows["x"].tolist() == list(range(12))
    assert rows["surface"].tolist() == [k + 30 for k in range(12)]


def test_a_missing_field_is_an_error_that_names_it():
    message = cloud_message(TYPESTORE, 0, "map", np.zeros(2, VIEW_ROW))
    with pytest.raises(MessageError, match="no field 'z'"):
        cloud_rows(message, SURFACE_ROW)


def test_a_field_of_another_type_is_an_error_that_names_it():
    message = cloud_message(TYPESTORE, 0, "map", np.zeros(2, SURFACE_ROW))
    message.fields[3].datatype = 7
    with pytest.raises(MessageError, match="'surface' is f4, expected u4"):
        cloud_rows(message, SURFACE_ROW)


sizes = st.one_of(st.integers(0, 40), st.sampled_from([2**31, 2**32 - 1]))


@settings(max_examples=150, deadline=None)
@given(width=sizes, height=sizes, step=sizes, line=sizes, offset=sizes, n=st.integers(0, 64))
def test_contradicting_sizes_are_refused_without_allocation(width, height, step, line, offset, n):
    message = cloud_message(TYPESTORE, 0, "map", np.zeros(2, SURFACE_ROW))
    message.width, message.height = width, height
    message.point_step, message.row_step = step, line
    message.fields[1].offset = offset
    message.data = np.zeros(n, np.uint8)
    try:
        rows = cloud_rows(message, SURFACE_ROW)
    except MessageError:
        return
    assert rows.nbytes <= 16 * max(n, 16)
