"""Messages of cameras become pictures, or a reason why not; pictures wait for their calibration."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from message_families import TYPESTORE, family, to_bag_message
from PIL import Image
from robots import MS, START, joint, joints_at, odometry_at, robot

from tccm_ros.config import Config
from tccm_ros.errors import MessageError
from tccm_ros.records import CameraImage, CameraInfo, RobotDescription
from tccm_ros.robot import Robot
from tccm_ros.sensors.camera_image import (
    PosedPicture,
    camera_image_from_message,
    camera_stream,
    compressed_image_from_message,
    is_rectified_topic,
    picture_pixels,
    pixel_directions,
)
from tccm_ros.sensors.camera_rays import distort, pixel_rays
from tccm_ros.sensors.depth_image import camera_info_topic
from tccm_sim.sensor_messages import camera_image_message

STAMP = 1_700_000_000_123_456_789
pictures = hnp.arrays(np.uint8, st.tuples(st.integers(1, 12), st.integers(1, 12), st.just(3)))


@pytest.fixture(params=["typestore", "rosidl"])
def types(request):
    return family(request.param)


def plain(pixels, encoding="rgb8"):
    height, width = pixels.shape[:2]
    return CameraImage(STAMP, "optical", encoding, (width, height), pixels.ravel())


def packed(pixels, kind="PNG"):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind)
    height, width = pixels.shape[:2]
    data = np.frombuffer(file.getvalue(), np.uint8)
    return CameraImage(STAMP, "optical", "compressed", (width, height), data)


def calibration(**changes):
    K = np.array([[525.0, 0.0, 319.5], [0.0, 524.0, 239.5], [0.0, 0.0, 1.0]])
    P = np.hstack([0.9 * K, np.zeros((3, 1))])
    D = np.array([0.1, -0.2, 0.001, 0.002, 0.03])
    return replace(CameraInfo(STAMP, "optical", 640, 480, "plumb_bob", D, K, P), **changes)


@settings(max_examples=50, deadline=None)
@given(pictures)
def test_pixels_of_every_encoding_are_read_back_as_red_green_blue(pixels):
    for image, expected in (
        (plain(pixels), pixels),
        (plain(np.ascontiguousarray(pixels[:, :, ::-1]), "bgr8"), pixels),
        (plain(np.ascontiguousarray(pixels[:, :, 0]), "mono8"), pixels[:, :, 0]),
    ):
        back = camera_image_from_message(camera_image_message(TYPESTORE, image))
        assert (back.stamp_ns, back.frame_id, back.size) == (STAMP, "optical", image.size)
        np.testing.assert_array_equal(picture_pixels(back), expected)
    file = compressed_image_from_message(camera_image_message(TYPESTORE, packed(pixels)))
    assert file.size == (pixels.shape[1], pixels.shape[0])
    np.testing.assert_array_equal(picture_pixels(file), pixels)


def test_a_jpeg_file_is_read_about_as_it_was():
    v, u = np.indices((60, 80))
    pixels = np.stack([u, 2 * v, u + v], axis=-1).astype(np.uint8)
    image = packed(pixels, "JPEG")
    back = compressed_image_from_message(camera_image_message(TYPESTORE, image))
    np.testing.assert_allclose(picture_pixels(back).astype(int), pixels, atol=12)
    gray = compressed_image_from_message(camera_image_message(TYPESTORE, packed(pixels[:, :, 0])))
    np.testing.assert_array_equal(picture_pixels(gray), pixels[:, :, 0])


def test_a_picture_is_the_same_in_both_families_of_messages(types):
    pixels = np.arange(5 * 4 * 3, dtype=np.uint8).reshape(5, 4, 3)
    message = camera_image_message(types, plain(pixels))
    for one in (message, to_bag_message(types, "sensor_msgs/msg/Image", message)):
        np.testing.assert_array_equal(picture_pixels(camera_image_from_message(one)), pixels)


def test_lines_may_be_padded():
    message = camera_image_message(TYPESTORE, plain(np.full((3, 2), 7, np.uint8), "mono8"))
    padded = np.array([[7, 7, 1, 2], [7, 7, 1, 2], [7, 7, 1, 2]], np.uint8).ravel()
    message.step, message.data = 4, padded
    np.testing.assert_array_equal(picture_pixels(camera_image_from_message(message)), 7)
    message.data = padded[:-2]  # the last line may lack its padding
    np.testing.assert_array_equal(picture_pixels(camera_image_from_message(message)), 7)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"encoding": "bayer_rggb8"}, "colour filter.*image_proc's debayer"),
        ({"encoding": "yuv422"}, "'yuv422', expected rgb8, bgr8, mono8"),
        ({"step": 11}, "lines of 11, expected 5 lines of 12"),
        ({"height": 6}, "expected 6 lines of 12"),
        ({"width": 0}, "0 x 5"),
    ],
)
def test_unreadable_images_have_a_message(changes, reason):
    message = camera_image_message(TYPESTORE, plain(np.zeros((5, 4, 3), np.uint8)))
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(MessageError, match=reason):
        camera_image_from_message(message)


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n", b"GIF89a" + bytes(40), bytes(100)])
def test_files_that_are_no_picture_are_refused(data):
    message = camera_image_message(TYPESTORE, packed(np.zeros((4, 4, 3), np.uint8)))
    message.data = np.frombuffer(data, np.uint8)
    with pytest.raises(MessageError, match="expected jpeg or png"):
        compressed_image_from_message(message)


def test_a_file_that_is_cut_is_refused_when_it_is_looked_at():
    image = packed(np.random.default_rng(1).integers(0, 255, (40, 40, 3)).astype(np.uint8))
    with pytest.raises(MessageError, match="damaged"):
        picture_pixels(replace(image, data=image.data[: len(image.data) // 2]))


def test_directions_are_those_of_the_rays_of_depth_images():
    camera = calibration()
    rays = pixel_rays(camera)
    pixels = np.array([[0.0, 0.0], [319.0, 200.0], [639.0, 479.0]])
    found = pixel_directions(camera, pixels, is_rectified=False)
    for (u, v), direction in zip(pixels.astype(int), found):
        assert direction[:2] / direction[2] == pytest.approx(rays[:, v, u], abs=1e-5)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1.0)


@settings(max_examples=50, deadline=None)
@given(st.floats(-0.4, 0.4), st.floats(-0.3, 0.3), st.sampled_from([(1, 1), (2, 2)]))
def test_a_direction_seen_through_the_lens_is_found_again(x, y, binning):
    camera = calibration(binning=binning, region=(20, 10, 600, 460))
    a, b = distort(np.array(x), np.array(y), camera.D)
    u = (camera.K[0, 0] * a + camera.K[0, 2] - 20) / binning[0]
    v = (camera.K[1, 1] * b + camera.K[1, 2] - 10) / binning[1]
    (direction,) = pixel_directions(camera, np.array([[u, v]]), is_rectified=False)
    assert direction[:2] / direction[2] == pytest.approx([x, y], abs=1e-6)


def test_rectified_pictures_have_the_rectified_calibration():
    camera = calibration()
    middle = np.array([[0.9 * 319.5, 0.9 * 239.5]])
    (direction,) = pixel_directions(camera, middle, is_rectified=True)
    assert direction == pytest.approx([0.0, 0.0, 1.0])
    assert is_rectified_topic("/camera/image_rect_color/compressed")
    assert not is_rectified_topic("/camera/image_raw")


def test_the_calibration_stands_beside_the_plain_picture():
    assert camera_info_topic("/camera/image_raw/compressed") == "/camera/camera_info"
    assert camera_info_topic("camera/image_raw") == "camera/camera_info"


URDF = robot([joint("turn", "revolute", "base", "mast", xyz="0 0 1", axis="0 0 1"),
              joint("look", "fixed", "mast", "optical", rpy="-1.570796 0 -1.570796")])  # fmt: skip


def test_a_picture_has_the_pose_of_its_stamp_and_its_calibration():
    one = Robot(Config(), [camera_stream("camera/image_raw")], expects_odometry=True)
    one.add("robot_description", RobotDescription(URDF))
    events = []
    for ms in range(0, 1000, 20):
        now = START + ms * MS
        events += one.add("odom", odometry_at(now, (0.5e-3 * ms, 0, 0, 0, 0, 0)))
        events += one.add("joint_states", joints_at(now, turn=1e-3 * ms))
        if ms == 400:
            stamp = now - 7 * MS
            picture = replace(plain(np.zeros((4, 6, 3), np.uint8)), stamp_ns=stamp)
            events += one.add("camera/image_raw", picture)
            K = np.array([[5.0, 0, 2.5], [0, 5.0, 1.5], [0, 0, 1.0]])
            info = CameraInfo(stamp, "optical", 6, 4, "plumb_bob", np.zeros(5), K,
                              np.hstack([K, np.zeros((3, 1))]))  # fmt: skip
            events += one.add("camera/camera_info", info)
    events += one.flush()
    (posed,) = [event for event in events if type(event) is PosedPicture]
    assert posed.image.camera is not None
    assert posed.T_odom_base[0][0, 3] == pytest.approx(0.5e-3 * 393)
    # The optical axis turns with the mast.
    axis = [np.cos(0.393), np.sin(0.393), 0.0]
    assert posed.T_base_sensor[0][:3, 2] == pytest.approx(axis, abs=1e-6)
    assert one.sensors["camera/image_raw"].posed == 1
