"""Messages of depth cameras and lidars become records, or a reason why not."""

import io
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from message_families import TYPESTORE, family, to_bag_message
from PIL import Image

from tccm_ros.errors import MessageError
from tccm_ros.records import CameraInfo, DepthImage, PointCloud
from tccm_ros.ros.pointcloud import cloud_message
from tccm_ros.sensors.cloud_messages import point_cloud_from_message
from tccm_ros.sensors.compressed_depth import (
    decode_rvl,
    is_depth_format,
    read_compressed_depth,
)
from tccm_ros.sensors.depth_messages import (
    camera_info_from_message,
    compressed_depth_from_message,
    depth_image_from_message,
)
from tccm_sim.sensor_messages import (
    camera_info_message,
    compressed_depth_message,
    depth_image_message,
    point_cloud_message,
)

MAX_POINTS = 4_000_000  # of a cloud: eight times the largest lidar

STAMP = 1_700_000_000_123_456_789

depths = hnp.arrays(np.uint16, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@pytest.fixture(params=["typestore", "rosidl"])
def types(request):
    return family(request.param)


def make_camera(**changes):
    K = np.array([[525.0, 0.0, 319.5], [0.0, 524.0, 239.5], [0.0, 0.0, 1.0]])
    P = np.hstack([K, np.zeros((3, 1))])
    D = np.array([0.1, -0.2, 0.001, 0.002, 0.03])
    return replace(CameraInfo(STAMP, "optical", 640, 480, "plumb_bob", D, K, P), **changes)


@settings(max_examples=50, deadline=None)
@given(depths)
def test_depths_in_mm_are_read_back_from_images_of_both_kinds(depth):
    image = DepthImage(STAMP, "optical", depth)
    for write, read in (
        (depth_image_message, depth_image_from_message),
        (compressed_depth_message, compressed_depth_from_message),
    ):
        back = read(write(TYPESTORE, image))
        assert (back.stamp_ns, back.frame_id, back.encoding) == (STAMP, "optical", "16UC1")
        assert np.array_equal(back.depth, depth)


def test_an_image_is_the_same_in_both_families_of_messages(types):
    image = DepthImage(STAMP, "optical", np.arange(12, dtype=np.uint16).reshape(3, 4))
    message = depth_image_message(types, image)
    for one in (message, to_bag_message(types, "sensor_msgs/msg/Image", message)):
        assert np.array_equal(depth_image_from_message(one).depth, image.depth)
    camera = make_camera(binning=(2, 2), region=(10, 20, 320, 240))
    message = camera_info_message(types, camera)
    for one in (message, to_bag_message(types, "sensor_msgs/msg/CameraInfo", message)):
        back = camera_info_from_message(one)
        assert np.array_equal(back.K, camera.K)
        assert np.array_equal(back.D, camera.D)
        assert (back.binning, back.region) == (camera.binning, camera.region)
        assert back.image_size == (160, 120)


def test_compressed_depths_in_m_are_within_half_a_step():
    depth = np.array([[0.5, 1.0, 3.0, 9.0], [np.nan, np.inf, 0.0, -1.0]], np.float32)
    back = compressed_depth_from_message(
        compressed_depth_message(TYPESTORE, DepthImage(STAMP, "optical", depth))
    )
    step = depth[0] ** 2 / (100.0 * 101.0)  # of a number, at that depth
    assert back.encoding == "32FC1"
    assert (np.abs(back.depth[0] - depth[0]) <= 0.5 * step + 1e-6).all()
    assert np.isnan(back.depth[1]).all()


def test_lines_with_padding_and_the_other_byte_order_are_read():
    depth = np.array([[1, 2, 3], [400, 500, 60000]], np.uint16)
    data = b"".join(line.astype(">u2").tobytes() + b"\xff\xff\xff" for line in depth)
    message = TYPESTORE.make(
        "sensor_msgs/msg/Image", height=2, width=3, encoding="16UC1", is_bigendian=1, step=9,
        data=np.frombuffer(data, np.uint8),
    )  # fmt: skip
    assert np.array_equal(depth_image_from_message(message).depth, depth)
    message.data = message.data[:-3]  # some drivers do not pad the last line
    assert np.array_equal(depth_image_from_message(message).depth, depth)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"encoding": "rgb8"}, "encoding 'rgb8', expected 16UC1 or 32FC1"),
        ({"step": 3}, "8 bytes in lines of 3"),
        ({"height": 3}, "expected 3 lines of 4"),
        ({"width": 0}, "0 x 2 pixels"),
        ({"width": 10**5, "height": 10**5}, "100000 x 100000 pixels"),
    ],
)
def test_an_image_that_contradicts_itself_is_refused_with_the_reason(changes, why):
    image = DepthImage(STAMP, "optical", np.ones((2, 2), np.uint16))
    message = depth_image_message(TYPESTORE, image)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(MessageError, match=why):
        depth_image_from_message(message)


@pytest.mark.parametrize(
    ("text", "data", "why"),
    [
        ("jpeg", b"", "format 'jpeg'"),
        ("16UC1; compressedDepth", b"\0" * 8, "8 bytes"),
        ("16UC1; compressedDepth", b"\0" * 64, "no PNG"),
        ("16UC1; compressedDepth rvl", b"\0" * 12 + struct.pack("<ii", 10**6, 10**6), "at most"),
        ("16UC1; compressedDepth rvl", b"\0" * 12 + struct.pack("<ii", 4, 4), "is cut"),
    ],
)
def test_compressed_data_that_cannot_be_read_are_refused(text, data, why):
    message = TYPESTORE.make(
        "sensor_msgs/msg/CompressedImage", format=text, data=np.frombuffer(data, np.uint8)
    )
    with pytest.raises(MessageError, match=why):
        compressed_depth_from_message(message)


def test_a_cut_png_is_refused():
    image = DepthImage(STAMP, "optical", np.arange(400, dtype=np.uint16).reshape(20, 20))
    message = compressed_depth_message(TYPESTORE, image)
    for size in range(0, len(message.data) - 20, 7):  # checksums and the end follow
        cut = TYPESTORE.make(
            "sensor_msgs/msg/CompressedImage", format=message.format, data=message.data[:size]
        )
        with pytest.raises(MessageError):
            compressed_depth_from_message(cut)


def encode_rvl(numbers):
    """Code depths as Wilson (2017) does: the twin of the decoder, nibble by nibble."""
    nibbles = []

    def put(value):
        while True:
            low, value = value & 7, value >> 3
            nibbles.append(low | (8 if value else 0))
            if not value:
                return

    at, last = 0, 0
    while at < len(numbers):
        zeros = 0
        while at + zeros < len(numbers) and numbers[at + zeros] == 0:
            zeros += 1
        at += zeros
        count = 0
        while at + count < len(numbers) and numbers[at + count] != 0:
            count += 1
        put(zeros)
        put(count)
        for value in numbers[at : at + count]:
            delta = int(value) - last
            put((delta << 1) ^ (delta >> 31))
            last = int(value)
        at += count
    nibbles += [0] * (-len(nibbles) % 8)
    return np.array(
        [
            sum(n << (28 - 4 * k) for k, n in enumerate(nibbles[i : i + 8]))
            for i in range(0, len(nibbles), 8)
        ],
        np.uint32,
    )


@settings(max_examples=50, deadline=None)
@given(
    hnp.arrays(np.uint16, st.integers(1, 60), elements=st.sampled_from([0, 0, 1, 900, 901, 65535]))
)
def test_rvl_is_decoded(numbers):
    out = np.zeros(len(numbers), np.uint16)
    words = encode_rvl(numbers)
    assert decode_rvl(words, out)
    assert np.array_equal(out, numbers)
    message = TYPESTORE.make(
        "sensor_msgs/msg/CompressedImage", format="16UC1; compressedDepth rvl",
        data=np.frombuffer(
            b"\0" * 12 + struct.pack("<ii", len(numbers), 1) + words.tobytes(), np.uint8
        ),
    )  # fmt: skip
    assert np.array_equal(compressed_depth_from_message(message).depth[0], numbers)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"k": np.zeros(9), "p": np.zeros(12)}, "not calibrated"),
        ({"k": np.full(9, np.nan)}, "not finite"),
        ({"d": np.zeros(20)}, "20 distortion coefficients"),
        ({"width": 0}, "0 x 480"),
    ],
)
def test_a_camera_info_that_cannot_be_used_is_refused(changes, why):
    message = camera_info_message(TYPESTORE, make_camera())
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(MessageError, match=why):
        camera_info_from_message(message)


def test_p_serves_where_a_driver_leaves_k_empty():
    message = camera_info_message(TYPESTORE, make_camera())
    message.k = np.zeros(9)
    message.p = np.array([500.0, 0, 320, 0, 0, 510, 240, 0, 0, 0, 1, 0])
    camera = camera_info_from_message(message)
    np.testing.assert_array_equal(camera.K, [[500, 0, 320], [0, 510, 240], [0, 0, 1]])
    assert not len(camera.D)


def test_png_of_16_bits_is_depth_with_and_without_plugin_header():
    numbers = np.array([[0, 500, 65535]], np.uint16)
    stream = io.BytesIO()
    Image.fromarray(numbers).save(stream, "PNG")
    for text in ("16UC1; png compressed ", "16UC1; png compressed"):
        assert is_depth_format(text)
        np.testing.assert_array_equal(read_compressed_depth(text, stream.getvalue()), numbers)
    for text in ("16UC1; jpeg compressed ", "rgb8; png compressed bgr8", "mono16; png compressed"):
        assert not is_depth_format(text)
    assert is_depth_format("png", stream.getvalue())
    assert not is_depth_format("mono16; png compressed", stream.getvalue())


def test_points_without_a_return_may_have_any_time():
    layout = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")]
    cloud = cloud_of(layout, x=[0.0, 1.0], t=[4294967295, 7])
    assert point_cloud_from_message(cloud).since_ns.tolist() == [0, 7]


def test_a_region_outside_the_image_is_refused():
    with pytest.raises(MessageError, match="region of 640 x 480 at 1, 0"):
        camera_info_from_message(
            camera_info_message(TYPESTORE, make_camera(region=(1, 0, 640, 480)))
        )


# -- point clouds


def test_a_cloud_is_read_back_with_its_times(types):
    points = np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0], [4.0, 5.0, 6.0]], np.float32)
    cloud = PointCloud(STAMP, "lidar", points, np.array([0, 0, 99_000_000]))
    back = point_cloud_from_message(point_cloud_message(types, cloud))
    assert (back.stamp_ns, back.frame_id) == (STAMP, "lidar")
    assert np.array_equal(back.points, points, equal_nan=True)
    assert back.since_ns.tolist() == [0, 0, 99_000_000]
    assert back.time_span == (STAMP, STAMP + 99_000_000)


def cloud_of(layout, **values):
    rows = np.zeros(2, layout)
    rows["x"] = 1.0
    for name, value in values.items():
        rows[name] = value
    return cloud_message(TYPESTORE, STAMP, "lidar", rows)


@pytest.mark.parametrize(
    ("name", "kind", "value", "since"),
    [
        ("time", "<f4", [0.0, 0.5], [0, 500_000_000]),
        ("t", "<u4", [0, 7], [0, 7]),
        ("offset_time", "<u4", [1000, 2000], [1000, 2000]),
        ("timestamp", "<f8", [1_700_000_000.25, 1_700_000_000.5], [126_543_211, 376_543_211]),
        # Livox: ns of the clock, as a double.
        ("timestamp", "<f8", [1.7000000001734568e18, 1.70000000022e18], [50_000_011, 96_543_211]),
        ("t", "<i4", [-5, 7], [-5, 7]),
        ("time", "<f4", [-0.25, 0.0], [-250_000_000, 0]),
    ],
)
def test_each_point_has_the_time_that_its_driver_wrote(name, kind, value, since):
    layout = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (name, kind)]
    found = point_cloud_from_message(cloud_of(layout, **{name: value})).since_ns
    assert np.abs(found - since).max() < 300  # a double has steps of 240 ns at these times


def test_any_offsets_padding_lines_and_byte_order_are_read():
    layout = np.dtype(
        {"names": ["z", "y", "x"], "formats": [">f8", ">f4", ">f8"], "offsets": [2, 11, 19],
         "itemsize": 32}
    )  # fmt: skip
    rows = np.zeros((2, 3), layout)
    rows["x"], rows["y"], rows["z"] = np.arange(6).reshape(2, 3), 7.0, 8.0
    data = b"".join(line.tobytes() + b"pad" for line in rows)
    make = TYPESTORE.make
    fields = [
        make("sensor_msgs/msg/PointField", name=n, offset=o, datatype=d, count=1)
        for n, o, d in (("x", 19, 8), ("y", 11, 7), ("z", 2, 8))
    ]
    message = make(
        "sensor_msgs/msg/PointCloud2", height=2, width=3, fields=fields, is_bigendian=True,
        point_step=32, row_step=99, data=np.frombuffer(data, np.uint8),
    )  # fmt: skip
    cloud = point_cloud_from_message(message)
    assert cloud.points[:, 0].tolist() == [0, 1, 2, 3, 4, 5]
    assert set(cloud.points[:, 1]) == {7.0}
    assert set(cloud.points[:, 2]) == {8.0}
    assert cloud.since_ns is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"fields": []}, "no field 'x'"),
        ({"point_step": 4}, "points of 4 bytes, its fields need 12"),
        ({"point_step": 24}, "has 24 bytes"),
        ({"width": 10**8}, f"100000000 points, at most {MAX_POINTS}"),
        ({"height": 5}, "expected 5 lines"),
    ],
)
def test_a_cloud_that_contradicts_itself_is_refused(changes, why):
    message = point_cloud_message(TYPESTORE, PointCloud(STAMP, "lidar", np.ones((2, 3), "f4")))
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(MessageError, match=why):
        point_cloud_from_message(message)


@pytest.mark.parametrize(
    ("times", "said"), [([1.6e9, 1.6e9], "more than 60 s"), ([np.nan, 0.0], "not finite")]
)
def test_invalid_times_are_ignored_and_reported(times, said):
    layout = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("time", "<f8")]
    cloud = point_cloud_from_message(cloud_of(layout, time=times))
    assert cloud.since_ns is None
    assert said in cloud.remark
    assert cloud.points[:, 0].tolist() == [1.0, 1.0]
