"""Camera pictures: their stream, and readers of raw and compressed messages.

A picture waits for its calibration, as a depth image does, and has one pose, at its stamp.
Compressed pictures are decoded only when used: most are not (`signs.rate`).
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from PIL import Image

from tccm_ros.arrays import Float64, UInt8
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.errors import MessageError, one_line
from tccm_ros.records import CameraImage, CameraInfo, Posed
from tccm_ros.records.building import frame_name, stamp_ns_from_message
from tccm_ros.robot import MountKind, Stream
from tccm_ros.robot.streams import Companion
from tccm_ros.sensors.camera_rays import undistort
from tccm_ros.sensors.compressed_depth import MAX_PIXELS
from tccm_ros.sensors.depth_image import RECTIFIED, camera_info_topic, join_camera
from tccm_ros.sensors.depth_messages import CAMERA_INFO_READER, image_rows

CHANNELS = {"rgb8": 3, "bgr8": 3, "mono8": 1}
"""Supported encodings of raw pictures, and bytes per pixel."""

COMPRESSED = "compressed"
"""Encoding of a picture stored as a file; also the last part of its topic (image_transport)."""

FILE_FORMATS = ("JPEG", "PNG")

MAX_WAITING = 30
"""Maximum number of waiting pictures: 83 MB of 1280 x 720 pixels, one second."""


class PosedPicture(Posed):
    """A picture with the pose of its camera."""

    __slots__ = ()

    @property
    def image(self) -> CameraImage:
        """The picture."""
        image: CameraImage = self.record
        return image


def is_compressed_picture(topic: str) -> bool:
    """Return whether a topic has compressed pictures."""
    return topic.rsplit("/", 1)[-1] == COMPRESSED


def camera_image_from_message(message: Any) -> CameraImage:
    """Return the picture of a sensor_msgs/Image.

    Raises
    ------
    MessageError
        For an encoding other than rgb8, bgr8 and mono8, and for inconsistent sizes.
    """
    encoding = str(message.encoding)
    if encoding.startswith("bayer"):
        raise MessageError(
            f"image has encoding '{encoding[:20]}', raw values behind a colour filter, expected "
            "rgb8, bgr8 or mono8; run image_proc's debayer node and use its image_color or "
            "image_mono"
        )
    if encoding not in CHANNELS:
        raise MessageError(
            f"image has encoding '{encoding[:20]}', expected rgb8, bgr8, mono8 or a CompressedImage"
        )
    rows = image_rows(message, CHANNELS[encoding], "image")
    size = int(message.width), int(message.height)
    return _camera_image(message.header, encoding, size, rows.ravel())


def compressed_image_from_message(message: Any) -> CameraImage:
    """Return the picture of a sensor_msgs/CompressedImage, JPEG or PNG, without decoding it.

    Raises
    ------
    MessageError
        For another format, and for a damaged file header.
    """
    data = np.frombuffer(message.data, np.uint8)
    try:
        with Image.open(io.BytesIO(data.tobytes()), formats=FILE_FORMATS) as file:
            size = file.size
    except Exception as error:  # Pillow raises many exceptions for damaged files
        raise MessageError(
            f"compressed image has format '{str(message.format)[:60]}', expected jpeg or png: "
            f"{one_line(error)}"
        ) from None
    if size[0] * size[1] > MAX_PIXELS:
        raise MessageError(f"image of {size[0]} x {size[1]} pixels, expected 1 to {MAX_PIXELS}")
    return _camera_image(message.header, COMPRESSED, size, data)


def _camera_image(header: Any, encoding: str, size: tuple[int, int], data: UInt8) -> CameraImage:
    stamp_ns, frame = stamp_ns_from_message(header.stamp), frame_name(header.frame_id)
    return CameraImage(stamp_ns, frame, encoding, size, data)


def picture_pixels(image: CameraImage) -> UInt8:
    """Return the pixels of a picture: uint8 (H, W) brightness, or (H, W, 3) red, green, blue.

    Raises
    ------
    MessageError
        For a damaged file.
    """
    width, height = image.size
    if image.encoding == "mono8":
        return image.data.reshape(height, width)
    if image.encoding == COMPRESSED:
        try:
            with Image.open(io.BytesIO(image.data.tobytes()), formats=FILE_FORMATS) as file:
                return np.asarray(file.convert("L" if file.mode == "L" else "RGB"))
        except Exception as error:  # Pillow raises many exceptions for damaged files
            raise MessageError(f"compressed image is damaged: {one_line(error)}") from None
    pixels = image.data.reshape(height, width, 3)
    return pixels if image.encoding == "rgb8" else pixels[:, :, ::-1]


def pixel_directions(camera: CameraInfo, pixels: Float64, *, is_rectified: bool) -> Float64:
    """Return unit vectors (N, 3) of pixels in the optical frame; NaN outside the lens model.

    Parameters
    ----------
    camera
        Camera calibration.
    pixels
        float64 (N, 2), pixel coordinates from the left and the top, with fractions.
    is_rectified
        Whether the image is rectified: then P applies, without distortion.
    """
    K, D = camera.K, camera.D
    if is_rectified and camera.P[0, 0] > 0.0:
        K, D = camera.P[:, :3], np.zeros(0)
    u = pixels[:, 0] * camera.binning[0] + camera.region[0]
    v = pixels[:, 1] * camera.binning[1] + camera.region[1]
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    if D.any():
        x, y = undistort(x, y, D)
    rays = np.column_stack([x, y, np.ones(len(x))])
    directions: Float64 = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return directions


def is_rectified_topic(topic: str) -> bool:
    """Return whether a topic has images rectified by image_proc."""
    return topic.removesuffix(f"/{COMPRESSED}").rsplit("/", 1)[-1].startswith(RECTIFIED)


PICTURE_READER = MessageReader(
    "sensor_msgs/msg/Image", lambda message: (camera_image_from_message(message),)
)

COMPRESSED_PICTURE_READER = MessageReader(
    "sensor_msgs/msg/CompressedImage", lambda message: (compressed_image_from_message(message),)
)


def camera_stream(topic: str, *, compressed: bool | None = None) -> Stream:
    """Return the stream of the pictures on a topic.

    Parameters
    ----------
    topic
        Topic name, which is the role of the stream.
    compressed
        Whether the pictures are compressed; by default, by the topic name.
    """
    packed = is_compressed_picture(topic) if compressed is None else compressed
    return Stream(
        role=topic,
        record=CameraImage,
        reader=COMPRESSED_PICTURE_READER if packed else PICTURE_READER,
        mount=MountKind.ANY,
        processor="signs",
        event=PosedPicture,
        companion=Companion(camera_info_topic(topic), CameraInfo, CAMERA_INFO_READER, join_camera),
        max_waiting=MAX_WAITING,
    )
