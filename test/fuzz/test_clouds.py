"""Point clouds of any layout: read whole, with a time for each point, or refused in one line."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from campaign import fuzzed
from hypothesis import example, given
from hypothesis import strategies as st
from robots import START

from tccm_ros.errors import MessageError
from tccm_ros.sensors.cloud_messages import point_cloud_from_message

MAX_SCAN_S = 60.0  # s, of the longest plausible scan

SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
NAMES = ["x", "y", "z", "intensity", "ring", "t", "time", "timestamp", "offset_time", "", "X"]

sizes = st.one_of(st.integers(0, 40), st.sampled_from([2**31 - 1, 2**31, 2**32 - 1]))
stamps = st.sampled_from([0, 1, START, 2**31 * 10**9 - 1, -(2**31) * 10**9])


@st.composite
def any_clouds(draw):
    """Draw a message whose sizes, offsets and types need not fit each other."""
    fields = [
        SimpleNamespace(
            name=draw(st.sampled_from(NAMES)),
            offset=draw(sizes),
            datatype=draw(st.integers(0, 9)),
            count=draw(st.integers(0, 3)),
        )
        for _ in range(draw(st.integers(0, 6)))
    ]
    sec, nanosec = divmod(draw(stamps), 10**9)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id="lidar"),
        width=draw(sizes), height=draw(sizes), fields=fields, is_bigendian=draw(st.booleans()),
        point_step=draw(sizes), row_step=draw(sizes), data=draw(st.binary(max_size=600)),
        is_dense=draw(st.booleans()),
    )  # fmt: skip


def field(name, offset, datatype=7):
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=1)


def cloud_of(fields, step, data, width, height=1, **changes):
    stamp = SimpleNamespace(sec=START // 10**9, nanosec=START % 10**9)
    values = {
        "header": SimpleNamespace(stamp=stamp, frame_id="lidar"), "fields": fields, "data": data,
        "point_step": step, "row_step": step * width, "width": width, "height": height,
        "is_bigendian": False, "is_dense": True,
    }  # fmt: skip
    return SimpleNamespace(**{**values, **changes})


XYZ = [field("x", 0), field("y", 4), field("z", 8)]


@fuzzed
@given(any_clouds())
@example(cloud_of(XYZ, 2**32 - 1, b"", 1))
@example(cloud_of(XYZ, 2**32 - 1, b"", 0))
@example(cloud_of([*XYZ, field("t", 2**32 - 4, 6)], 2**32 - 1, bytes(12), 1))
def test_any_cloud_is_read_whole_or_refused(message):
    try:
        cloud = point_cloud_from_message(message)
    except MessageError:
        return
    assert cloud.points.shape == (message.width * message.height, 3)
    if cloud.since_ns is not None:
        assert np.abs(cloud.since_ns).max(initial=0) <= MAX_SCAN_S * 1e9


@st.composite
def layouts(draw):
    """Draw fields that do not overlap, in any order, with gaps: the layout of a driver."""
    names = draw(st.permutations(["x", "y", "z", draw(st.sampled_from(["t", "time"])), "ring"]))
    fields, at, wide = [], draw(st.integers(0, 8)), draw(st.sampled_from([7, 8]))
    for name in names:
        kind = {"t": 6, "time": 7, "ring": 4}.get(name, wide)
        fields.append(field(name, at, kind))
        at += SIZES[kind] + draw(st.integers(0, 5))
    return fields, at


numbers = st.one_of(
    st.floats(-50.0, 50.0, width=32), st.sampled_from([0.0, math.nan, math.inf, -math.inf])
)


@fuzzed
@given(
    layouts(),
    st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=12),
    st.booleans(),
    st.integers(1, 3),
    st.integers(0, 7),
)
def test_a_cloud_of_any_layout_has_the_points_that_were_written(layout, rows, big, height, gap):
    (fields, step), order = layout, ">" if big else "<"
    kind = np.dtype({
        "names": [f.name for f in fields], "formats": [order + FORMATS[f.datatype] for f in fields],
        "offsets": [f.offset for f in fields], "itemsize": step,
    })  # fmt: skip
    written = np.zeros((height, len(rows)), kind)
    for k, axis in enumerate("xyz"):
        written[axis] = np.array(rows, np.float32)[:, k]
    time = "t" if "t" in kind.names else "time"
    after = np.arange(written.size).reshape(written.shape) * 1000
    written[time] = after if time == "t" else after * 1e-9
    data = b"".join(line.tobytes() + b"\xff" * gap for line in written)
    message = cloud_of(
        fields, step, data, len(rows), height, is_bigendian=big, row_step=step * len(rows) + gap
    )
    cloud = point_cloud_from_message(message)
    expected = np.tile(np.array(rows, np.float32), (height, 1))
    np.testing.assert_array_equal(cloud.points, expected)
    square = (expected.astype(float) ** 2).sum(axis=1)
    known = np.isfinite(square) & (square >= 0.0026)  # beyond 5 cm
    assert cloud.since_ns[known] == pytest.approx(after.ravel()[known], abs=1)
    assert not cloud.since_ns[~np.isfinite(square)].any()
