"""Posed pictures of walls with door signs, for tests."""

from importlib.util import find_spec

import numpy as np
import pytest
from PIL import Image

from tccm_ros.records import CameraImage, CameraInfo
from tccm_ros.sensors.camera_image import PosedPicture
from tccm_sim.door_plates import STYLES, door_plate

START = 1_600_000_000_000_000_000
needs_reader = pytest.mark.skipif(
    find_spec("rapidocr_onnxruntime") is None, reason="the extra signs is not installed"
)


def picture_of(pixels, stamp_ns=START, frame="optical"):
    """Return a picture with its calibration: a focal length of 500 pixels."""
    height, width = pixels.shape[:2]
    K = np.array([[500.0, 0.0, width / 2], [0.0, 500.0, height / 2], [0.0, 0.0, 1.0]])
    P = np.hstack([K, np.zeros((3, 1))])
    camera = CameraInfo(stamp_ns, frame, width, height, "plumb_bob", np.zeros(5), K, P)
    return CameraImage(stamp_ns, frame, "rgb8", (width, height), pixels.ravel(), camera)


def posed(pixels, stamp_ns=START, role="camera/image_raw"):
    """Return a picture whose camera is at (0.1, 0.2, 1.4) in the base frame."""
    T = np.eye(4)
    T[:3, 3] = 0.1, 0.2, 1.4
    stamps = np.array([stamp_ns])
    return PosedPicture(picture_of(pixels, stamp_ns), stamps, np.eye(4)[None], T[None], role)


def wall_with(number, at=(200, 150), width=120):
    """Return the pixels of a wall with a plate whose upper left corner is at a pixel."""
    rng = np.random.default_rng(2)
    picture = Image.fromarray((170 + rng.normal(0, 3, (384, 512, 3))).astype(np.uint8))
    plate = Image.fromarray(door_plate(number, "Archive", STYLES[0]).pixels)
    plate = plate.resize((width, round(width * plate.height / plate.width)), Image.Resampling.BOX)
    picture.paste(plate, at)
    return np.asarray(picture)
