"""Select posed pictures at a limited rate, and measure the door signs in them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from PIL import Image

from tccm_ros.arrays import Float64, UInt8
from tccm_ros.config import Config
from tccm_ros.errors import MessageError, MissingExtraError
from tccm_ros.records import MapReset
from tccm_ros.sensors.camera_image import (
    PosedPicture,
    is_rectified_topic,
    picture_pixels,
    pixel_directions,
)
from tccm_ros.signs.detector import Detector, sign_detector
from tccm_ros.signs.hog import region_patches
from tccm_ros.signs.measurement import DetectedSign, SearchedPicture, SignMeasurement

BEYOND_RATE = "pictures beyond signs.rate"
UNCHANGED = "pictures of a view that was looked at before"
NO_EXTRA = "pictures that nothing can read: extra signs is not installed"

STILL_M, STILL_RAD = 0.01, 0.01
"""A camera that has moved less than this (m, rad) may show the same view. Chosen: odometry drifts
less at rest; half a degree moves a picture by several pixels."""

VIEW_SIZE = (64, 48)
"""Width and height to which views are scaled before they are compared, pixels. Chosen: averages the
noise of a picture, and still shows a change of a readable digit."""

BORDER = 0.25
"""Distance of a number from the border of a picture below which it may be cut off, in its heights.
Chosen: a line grows by as much beyond its ink."""

MIN_UP = 0.5
"""Minimum length of the vertical projected to the image plane for which the upper side of a picture
is defined. Chosen: a camera looks up or down by less than 60 deg."""

SAME_LEVELS = 4.0
"""Maximum change of brightness of a scaled pixel within the same view, of 255. Chosen."""


class PictureSelector:
    """Selects the first picture of each 1 / `signs.rate` s of stamps, whatever the processing
    speed.

    Parameters
    ----------
    rate
        Hz.
    """

    def __init__(self, rate: float) -> None:
        self._period_ns = round(1e9 / rate)
        self._last = -1

    def selects(self, stamp_ns: int) -> bool:
        """Return whether a picture is selected; pictures come in stamp order."""
        number = stamp_ns // self._period_ns
        is_first, self._last = number != self._last, number
        return is_first

    def clear(self) -> None:
        """Reset the selection after a jump of the clock."""
        self._last = -1


class LastView:
    """The view that was searched last."""

    def __init__(self) -> None:
        self._last: tuple[Float64, Float64] | None = None

    def changes(self, posed: PosedPicture, pixels: UInt8) -> bool:
        """Return whether a picture shows a new view, by its camera's pose or its content."""
        view = Image.fromarray(pixels).convert("L").resize(VIEW_SIZE, Image.Resampling.BOX)
        new = posed.T_odom_base[0] @ posed.T_base_sensor[0], np.asarray(view, float)
        if self._last is not None and _is_same(*self._last, *new):
            return False
        self._last = new
        return True


def _is_same(T_before: Float64, view_before: Float64, T: Float64, view: Float64) -> bool:
    moved = float(np.linalg.norm(T[:3, 3] - T_before[:3, 3]))
    cosine = 0.5 * (float(np.trace(T_before[:3, :3].T @ T[:3, :3])) - 1.0)
    is_still = moved < STILL_M and cosine > np.cos(STILL_RAD)
    return bool(is_still and np.abs(view - view_before).max() < SAME_LEVELS)


class SignProcessor:
    """Reads door signs in selected pictures.

    Parameters
    ----------
    config
        Group `signs`.

    Attributes
    ----------
    counts
        Numbers of ``pictures`` searched, and of ``signs`` read in them.
    dropped
        Number of pictures that were not searched, by reason.
    problem
        Error sentence if the packages for reading text are missing; empty otherwise.
    """

    def __init__(self, config: Config) -> None:
        self._settings = config.signs
        self._selector = PictureSelector(config.signs.rate)
        self._detector: Detector | None = None
        self._view = LastView()
        self.counts: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self.problem = ""

    def add(self, event: Any) -> list[SearchedPicture | SignMeasurement]:
        """Handle an event: return the result of `read` for a picture, nothing for other events."""
        if type(event) is MapReset:
            self._selector.clear()
            self._view = LastView()
        return self.read(event) if self.selects(event) else []

    def selects(self, event: Any) -> bool:
        """Return whether an event is a selected picture; other pictures are counted as dropped."""
        if type(event) is not PosedPicture:
            return False
        is_selected = self._selector.selects(event.stamp_ns)
        if not is_selected:
            self.dropped[BEYOND_RATE] += 1
        return is_selected

    def read(self, posed: PosedPicture) -> list[SearchedPicture | SignMeasurement]:
        """Return the searched picture and the signs in it.

        An unchanged view gives nothing.
        """
        try:
            self._detector = self._detector or sign_detector(self._settings)
            pixels = picture_pixels(posed.image)
            if not self._view.changes(posed, pixels):
                self.dropped[UNCHANGED] += 1
                return []
            measured = measure_signs(self._detector, posed, pixels)
        except MissingExtraError as error:
            self.problem = str(error)
            self.dropped[NO_EXTRA] += 1
            return []
        except MessageError as error:
            self.dropped[str(error)] += 1
            return []
        self.counts["pictures"] += 1
        self.counts["signs"] += len(measured)
        return [searched_picture(posed), *measured]


def searched_picture(posed: PosedPicture) -> SearchedPicture:
    """Return the camera model and pose of a picture, which determine the signs it could show."""
    camera = posed.image.camera
    assert camera is not None
    has_P = is_rectified_topic(posed.role) and camera.P[0, 0] > 0.0
    K = camera.P[:, :3] if has_P else camera.K
    binning = np.array(camera.binning, float)
    center = (K[:2, 2] - np.array(camera.region[:2], float)) / binning
    focal_lengths = np.array([K[0, 0], K[1, 1]]) / binning
    T_base_camera = posed.T_base_sensor[0]
    return SearchedPicture(posed.stamp_ns, T_base_camera, focal_lengths, center, posed.image.size)


def measure_signs(detector: Detector, posed: PosedPicture, pixels: UInt8) -> list[SignMeasurement]:
    """Return the measurements of the door signs in a picture, from left to right.

    Parameters
    ----------
    detector
        Detector that finds and reads the signs.
    posed
        The picture with its calibration and the pose of its camera.
    pixels
        uint8 (H, W) or (H, W, 3), pixels of the picture.
    """
    quarters = quarter_rotations(posed.T_base_sensor[0])
    rotated = np.ascontiguousarray(np.rot90(pixels, quarters))
    # The middle of a number that is cut off at the border is unknown.
    size = rotated.shape[1], rotated.shape[0]
    found = [sign for sign in detector.search(rotated).signs if _is_whole(sign, size)]
    if not found:
        return []
    signs = [_in_picture(sign, quarters, posed.image.size) for sign in found]
    measured = map(
        partial(_measurement, posed), signs, _rays(posed, signs), _patches(rotated, found)
    )
    return [sign for sign in measured if np.isfinite(sign.bearing).all()]


def _patches(pixels: UInt8, signs: Sequence[DetectedSign]) -> UInt8:
    """Return the brightness of each number and its surroundings."""
    boxes = np.array([[*sign.box[:2], *(sign.box[:2] + sign.box[2:])] for sign in signs])
    return region_patches(np.asarray(Image.fromarray(pixels).convert("L")), boxes)


def _in_picture(sign: DetectedSign, quarters: int, size: tuple[int, int]) -> DetectedSign:
    """Return a sign of a rotated picture with the points in the original picture.

    The origin of the detector is the corner of the first pixel, that of a calibration its centre.
    """
    pixel, corners, plate = (
        _turned_back(points, quarters, size) - 0.5
        for points in (sign.pixel[None], sign.corners, sign.plate)
    )
    return replace(sign, pixel=pixel[0], corners=corners, plate=plate)


def _rays(posed: PosedPicture, signs: Sequence[DetectedSign]) -> Float64:
    """Return unit vectors (N, 5, 3) to the number and the plate's four corners of each sign."""
    assert posed.image.camera is not None
    points = np.concatenate([np.vstack([sign.pixel, sign.plate]) for sign in signs])
    is_rectified = is_rectified_topic(posed.role)
    return pixel_directions(posed.image.camera, points, is_rectified=is_rectified).reshape(-1, 5, 3)


def _measurement(
    posed: PosedPicture, sign: DetectedSign, rays: Float64, patch: UInt8
) -> SignMeasurement:
    camera = posed.image.camera
    assert camera is not None
    return SignMeasurement(
        stamp_ns=posed.stamp_ns,
        pixel=sign.pixel,
        bearing=rays[0],
        T_base_camera=posed.T_base_sensor[0],
        text=sign.text,
        number=sign.number,
        confidence=sign.confidence,
        patch=patch,
        corners=sign.corners,
        plate=rays[1:],
        focal_length=float(camera.K[0, 0] / camera.binning[0]),
    )


def quarter_rotations(T_base_camera: Float64) -> int:
    """Return the number of counter-clockwise rotations by 90 deg that bring its upper side up.

    0 for a camera that looks up or down so steeply that its picture has no upper side.

    Parameters
    ----------
    T_base_camera
        float64 (4, 4), pose of the optical frame in the base frame, whose z points up.
    """
    right, down = T_base_camera[2, :2].tolist()
    if math.hypot(right, down) < MIN_UP:
        return 0
    return round(math.atan2(right, -down) / (0.5 * math.pi)) % 4


def _turned_back(points: Float64, quarters: int, size: tuple[int, int]) -> Float64:
    """Return points (N, 2) of a counter-clockwise rotated picture in the original picture."""
    for k in reversed(range(quarters)):
        points = np.column_stack([size[k % 2] - points[:, 1], points[:, 0]])
    return points


def _is_whole(sign: DetectedSign, size: tuple[int, int]) -> bool:
    """Return whether a number has enough margin to the border to be complete."""
    margin = BORDER * sign.box[3]
    return bool((sign.corners > margin).all() and (sign.corners < np.array(size) - margin).all())
