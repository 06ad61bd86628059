"""Measurements of door signs in one picture (section III.A.2 of the surface mapping paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tccm_ros.arrays import Float64, UInt8


@dataclass(frozen=True, slots=True, eq=False)
class DetectedSign:
    """A door sign in a picture, in pixels.

    Attributes
    ----------
    text
        All read lines of the plate, from top to bottom, joined by spaces.
    number
        The room number, in capital letters; the name on a plate without a number.
    pixel
        float64 (2,), middle of the number, pixels from the left and the top.
    box
        float64 (4,), left, top, width and height of the number, pixels.
    confidence
        Mean probability of the characters of the number, 0 to 1.
    corners
        float64 (4, 2), of the number: top left, top right, bottom right, bottom left, pixels.
    plate
        float64 (4, 2), of all lines of the plate, likewise.
    """

    text: str
    number: str
    pixel: Float64
    box: Float64
    confidence: float
    corners: Float64
    plate: Float64


class RefusedText(NamedTuple):
    """Text in a picture that was refused as a door sign.

    Attributes
    ----------
    text
        Text of the line; empty if it was not read.
    pixel
        float64 (2,), its middle, pixels.
    reason
        Reason of the refusal.
    """

    text: str
    pixel: Float64
    reason: str


class SearchedText(NamedTuple):
    """All text of a picture: door signs and refused text.

    Attributes
    ----------
    signs
        Door signs, from left to right.
    refused
        Refused text, from top to bottom.
    """

    signs: list[DetectedSign]
    refused: list[RefusedText]


@dataclass(frozen=True, slots=True, eq=False)
class SignMeasurement:
    """A door sign in a picture: bearing, text and appearance.

    Attributes
    ----------
    stamp_ns
        Time of the picture.
    pixel
        float64 (2,), middle of the number in the original picture; (0, 0) is the centre of the
        first pixel, as for a CameraInfo.
    bearing
        float64 (3,), unit vector from the camera to that middle, in the optical frame (x right, y
        down, z forward: REP-103), with lens distortion removed.
    T_base_camera
        float64 (4, 4), pose of the optical frame in the base frame at the stamp.
    text
        All read lines of the plate, from top to bottom, joined by spaces.
    number
        The room number, in capital letters; the name on a plate without a number.
    confidence
        Mean probability of the number's characters, 0 to 1.
    patch
        uint8 (h, w), brightness of the number and its surroundings, scaled to one size
        (`signs.hog`).
    corners
        float64 (4, 2), of the number: top left, top right, bottom right, bottom left, pixels.
    plate
        float64 (4, 3), unit vectors as `bearing` to the corners of all lines of the plate; NaN
        where unknown.
    focal_length
        Of the camera, pixels; converts pixel noise to rad.
    """

    stamp_ns: int
    pixel: Float64
    bearing: Float64
    T_base_camera: Float64
    text: str
    number: str
    confidence: float
    patch: UInt8
    corners: Float64
    plate: Float64
    focal_length: float

    @property
    def picture_key(self) -> tuple[int, bytes]:
        """`SearchedPicture.key` of its picture."""
        return picture_key(self.stamp_ns, self.T_base_camera)


@dataclass(frozen=True, slots=True, eq=False)
class SearchedPicture:
    """A picture that was searched for door signs, with or without a result.

    Attributes
    ----------
    stamp_ns
        Time of the picture.
    T_base_camera
        float64 (4, 4), pose of the optical frame in the base frame at the stamp.
    focal_lengths, center
        float64 (2,) each, of the original picture, pixels, for a pinhole camera without distortion.
    size
        Width and height, pixels.
    """

    stamp_ns: int
    T_base_camera: Float64
    focal_lengths: Float64
    center: Float64
    size: tuple[int, int]

    @property
    def key(self) -> tuple[int, bytes]:
        """Key of the picture, equal for all measurements made in it."""
        return picture_key(self.stamp_ns, self.T_base_camera)


def picture_key(stamp_ns: int, T_base_camera: Float64) -> tuple[int, bytes]:
    """Return the identity of a picture: its stamp, and its pose to distinguish several cameras."""
    return stamp_ns, T_base_camera.tobytes()
