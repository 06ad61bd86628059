"""Door signs of the map."""

from __future__ import annotations

from dataclasses import dataclass

from tccm_ros.arrays import Float64

SIGN = "sign"
"""The kind of landmark that a door sign is."""


@dataclass(frozen=True, slots=True, eq=False)
class SignSighting:
    """One picture in which a sign was read.

    Attributes
    ----------
    stamp_ns
        Of the picture.
    keyframe
        The keyframe that the picture hangs on.
    pixel
        float64 (2,), middle of the number, pixels from the left and the top.
    """

    stamp_ns: int
    keyframe: int
    pixel: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Sign:
    """A door sign: a point on a wall, and what the plate says.

    Attributes
    ----------
    id
        Stays with the sign over solutions and sessions.
    text, number
        All lines of the plate, and the number of the room in them, as most pictures say.
    confidence
        Mean over the pictures of the confidence in the number, 0 for those that say another; 0 to
        1.
    position
        float64 (3,), middle of the number in map, m.
    normal
        float64 (3,), unit vector from its wall to who reads it, horizontal.
    covariance
        float64 (3, 3) of the position, m2.
    wall
        Id of the wall that it is fixed to; None where no wall is known there.
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
    """Text that was read at one place as the number of a room, and is no door sign.

    Attributes
    ----------
    number
        As most pictures say.
    position
        float64 (3,), in map, m.
    reason
        Why it is none.
    """

    number: str
    position: Float64
    reason: str
