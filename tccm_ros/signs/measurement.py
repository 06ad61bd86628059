"""What one picture tells of door signs (section III.A.2 of the surface mapping paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tccm_ros.arrays import Float64, UInt8


@dataclass(frozen=True, slots=True, eq=False)
class DetectedSign:
    """A door sign in a picture.

    Attributes
    ----------
    text
        All lines of the plate that were read, from top to bottom, joined by spaces.
    number
        The number of the room, capital letters; the name on a plate without one.
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
    """Text in a picture that is no door sign.

    Attributes
    ----------
    text
        As read; empty where it was not.
    pixel
        float64 (2,), its middle, pixels.
    reason
        Why it is none.
    """

    text: str
    pixel: Float64
    reason: str


class SearchedText(NamedTuple):
    """The text of a picture.

    Attributes
    ----------
    signs
        Door signs, from left to right.
    refused
        What else was looked at, from top to bottom.
    """

    signs: list[DetectedSign]
    refused: list[RefusedText]


@dataclass(frozen=True, slots=True, eq=False)
class SignMeasurement:
    """A door sign in a picture: where, what it says and what it looks like.

    Attributes
    ----------
    stamp_ns
        When the picture was taken.
    pixel
        float64 (2,), middle of the number, of the picture as it was taken: (0, 0) is the middle of
        its first pixel, as for a CameraInfo.
    bearing
        float64 (3,), unit vector from the camera to that middle, in the optical frame (x right,
        y down, z forward: REP-103), without the lens' distortion.
    T_base_camera
        float64 (4, 4), pose of the optical frame in the base frame at the stamp.
    text
        All lines of the plate that were read, from top to bottom, joined by spaces.
    number
        The number of the room, in capital letters; the name on a plate without one.
    confidence
        Mean probability of the number's characters, 0 to 1.
    patch
        uint8 (h, w), brightness of the number and its surroundings, scaled to one size
        (`signs.hog`).
    corners
        float64 (4, 2), of the number: top left, top right, bottom right, bottom left, pixels.
    plate
        float64 (4, 3), unit vectors as `bearing` to the corners of all lines of the plate; NaN
        where they are not known.
    focal_length
        Of the camera, pixels: a pixel's noise divided by it is one in rad.
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


@dataclass(frozen=True, slots=True, eq=False)
class SearchedPicture:
    """A picture in which door signs were looked for, whether one was read in it or not.

    Attributes
    ----------
    stamp_ns
        When the picture was taken.
    T_base_camera
        float64 (4, 4), pose of the optical frame in the base frame at the stamp.
    focal_lengths, center
        float64 (2,) each, of the picture as it was taken, pixels; without the lens' distortion.
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
        """What it has in common with the measurements that were made in it."""
        return picture_key(self.stamp_ns, self.T_base_camera)


def picture_key(stamp_ns: int, T_base_camera: Float64) -> tuple[int, bytes]:
    """Return what tells pictures from each other: the stamp, and of several cameras the pose."""
    return stamp_ns, T_base_camera.tobytes()
