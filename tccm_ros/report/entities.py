"""Walls, objects, signs and compartments as JSON values of the viewer's script."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64
from tccm_ros.racks.compartment import OpenPart
from tccm_ros.racks.outline import box_edges, part_edges
from tccm_ros.records import Wall
from tccm_ros.ros.map_records import MapSign, MapWall

if TYPE_CHECKING:  # the live page does not import the models of files
    from tccm_ros.results.models import SignEntry


def rounded(values: ArrayLike, digits: int = 3) -> list[float]:
    """Return numbers as a flat list, rounded to a number of decimals."""
    return [round(float(value), digits) for value in np.asarray(values).ravel()]


def seconds(stamp_ns: int) -> float:
    """Return a stamp in s, rounded to ms."""
    return round(stamp_ns * 1e-9, 3)


def wall_entity(wall: Wall | MapWall, digits: int = 3) -> dict[str, Any]:
    """Return a wall as a line with its number of measurements."""
    ends = wall.endpoints[:, :2]
    return {
        "id": wall.id,
        "ends": [rounded(end, digits) for end in ends],
        "length": round(float(np.hypot(*(ends[1] - ends[0]))), digits),
        "observations": wall.observations,
    }


def object_entity(
    number: int,
    surface: int,
    label: str | None,
    center: Float64,
    size: Float64,
    corners: Float64,
    digits: int = 3,
) -> dict[str, Any]:
    """Return an object on a surface.

    Parameters
    ----------
    number, surface
        Ids of the object and of the surface below it.
    label
        Name of that surface; None if it is unknown.
    center, size
        float64 (3,), centre and edge lengths of its box, m.
    corners
        float64 (4, 2), the box from above, in map, m.
    digits
        Decimals of all numbers.
    """
    return {
        "id": number,
        "surface": surface,
        "on": label,
        "size": rounded(size, digits),
        "corners": [rounded(corner, digits) for corner in corners],
        "low": round(float(center[2] - size[2] / 2), digits),
        "high": round(float(center[2] + size[2] / 2), digits),
    }


def sign_entity(sign: SignEntry | MapSign, digits: int = 3) -> dict[str, Any]:
    """Return a door sign with its position, and the normal of its wall."""
    at, normal = rounded(sign.position, digits), rounded(sign.normal, digits)
    return {"id": sign.id, "text": sign.text, "at": at, "normal": normal}


def compartment_entity(
    board: int,
    front: Float64,
    insertion: Float64,
    lengths: tuple[float, float, float],
    faces: Sequence[str],
    parts: Sequence[OpenPart],
    digits: int = 3,
) -> dict[str, Any]:
    """Return a compartment of a rack.

    Parameters
    ----------
    board
        Id of the surface below it.
    front
        float64 (2, 3), left and right end of its front edge, m.
    insertion
        float64 (3,), unit vector from the front inwards.
    lengths
        Width, depth and height, m.
    faces
        States of its left, right, back and ceiling.
    parts
        Doors and drawers that stand open before its front.
    digits
        Decimals of all numbers.
    """
    width, depth, height = lengths
    left, right, back, ceiling = faces
    edges = np.concatenate([box_edges(front, insertion, depth, height), part_edges(parts)])
    return {
        "board": board,
        "width": round(float(width), digits),
        "depth": round(float(depth), digits),
        "height": round(float(height), digits),
        "sides": [left, right],
        "back": back,
        "ceiling": ceiling,
        "open_parts": len(parts),
        "edges": [[rounded(end, digits) for end in ends] for ends in edges],
    }
