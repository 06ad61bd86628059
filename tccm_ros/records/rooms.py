"""Rooms of the map."""

from __future__ import annotations

from dataclasses import dataclass

from tccm_ros.arrays import Float64


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A room: an area that walls enclose when doors are closed.

    Attributes
    ----------
    id
        Number, in the order of decreasing area.
    name
        Number on the door sign; empty where none was read.
    boundary
        float64 (N, 2), open ring in map, counter-clockwise, m.
    area
        Area, m2.
    signs
        Ids of the door signs that name it, ascending.
    """

    id: int
    name: str
    boundary: Float64
    area: float
    signs: tuple[int, ...] = ()
