"""Door signs of the map."""

from __future__ import annotations

from dataclasses import dataclass

from tccm_ros.arrays import Float64, Vector

SIGN = "sign"
"""Landmark kind of door signs."""


@dataclass(frozen=True, slots=True, eq=False)
class SignSighting:
    """One observation of a sign in a picture.

    Attributes
    ----------
    stamp_ns
        Of the picture.
    keyframe
        Id of the keyframe that the picture is attached to.
    pixel
        float64 (2,), middle of the number, pixels from the left and the top.
    """

    stamp_ns: int
    keyframe: int
    pixel: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Sign:
    """A door sign: a point on a wall, and the text of the plate.

    Attributes
    ----------
    id
        Persistent over solutions and sessions.
    text, number
        All lines of the plate, and the room number in them, by majority of the pictures.
    confidence
        Mean confidence in the number over the pictures, 0 to 1; pictures with another number count
        as 0.
    position
        float64 (3,), middle of the number in map, m.
    normal
        float64 (3,), unit vector from the wall to a reader in front of it, horizontal.
    covariance
        float64 (3, 3) of the position, m2.
    wall
        Id of the wall that the sign is fixed to; None if no wall is known there.
    views
        The pictures, in the order of sessions and stamps.
    """

    id: int
    text: str
    number: str
    confidence: float
    position: Float64
    normal: Float64
    covariance: Float64
    wall: int | None
    views: tuple[SignSighting, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RefusedSign:
    """A text that was read as a room number at one place and then rejected as a door sign.

    Attributes
    ----------
    number
        The number, by majority of the pictures.
    position
        float64 (3,), in map, m.
    reason
        Reason of the rejection.
    """

    number: str
    position: Vector
    reason: str
