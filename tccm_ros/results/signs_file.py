"""Model of signs.json."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

from tccm_ros.arrays import Float64
from tccm_ros.records import RefusedSign, Sign
from tccm_ros.results.models import Covariance3, Vector, array_type
from tccm_ros.results.numbers import Stamp

Pixel = Annotated[Float64, *array_type(2)]


@dataclass(frozen=True, slots=True, eq=False)
class SignViewEntry:
    """A picture in which a sign was read.

    Attributes
    ----------
    stamp
        Stamp of the picture, s.
    keyframe
        Keyframe to which the picture is attached.
    pixel
        float64 (2,), centre of the number, from the left and the top of the picture.
    """

    stamp: float
    keyframe: int
    pixel: Pixel


@dataclass(frozen=True, slots=True, eq=False)
class SignEntry:
    """A door sign, in map, as `records.Sign`.

    Attributes
    ----------
    id
        Id, stable over solutions and sessions.
    text, number
        Text on the plate, and the room number in it.
    confidence
        Confidence in the number, 0 to 1.
    position
        float64 (3,), centre of the number, m.
    normal
        float64 (3,), unit normal of the wall towards the reader of the sign.
    covariance
        float64 (3, 3) of the position, m2.
    wall
        Id of its wall in walls.json; null if unknown.
    views
        Pictures, in order of sessions and stamps.
    """

    id: int
    text: str
    number: str
    confidence: float
    position: Vector
    normal: Vector
    covariance: Covariance3
    wall: int | None
    views: tuple[SignViewEntry, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RefusedEntry:
    """Text that was read as a room number but is not a door sign, as `records.RefusedSign`.

    Attributes
    ----------
    number
        Number read in most pictures.
    position
        float64 (3,), in map, m.
    reason
        Reason for the refusal.
    """

    number: str
    position: Vector
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class SignsFile:
    """signs.json: the door signs of the map.

    Attributes
    ----------
    signs
        Signs, by id.
    refused
        Texts read at one position that are not signs.
    """

    signs: tuple[SignEntry, ...] = ()
    refused: tuple[RefusedEntry, ...] = ()

    @classmethod
    def of(cls, signs: Iterable[Sign], refused: Iterable[RefusedSign] = ()) -> SignsFile:
        """Return the model of signs.json."""
        entries = (RefusedEntry(r.number, r.position, r.reason) for r in refused)
        return cls(tuple(_entry(sign) for sign in signs), tuple(entries))


def _entry(sign: Sign) -> SignEntry:
    views = (SignViewEntry(Stamp(v.stamp_ns), v.keyframe, v.pixel) for v in sign.views)
    return SignEntry(
        sign.id,
        sign.text,
        sign.number,
        sign.confidence,
        sign.position,
        sign.normal,
        sign.covariance,
        sign.wall,
        tuple(views),
    )
