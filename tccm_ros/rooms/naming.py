"""Names of rooms from door signs, and assignment of surfaces to rooms.

A sign hangs outside its room, on the wall of the room. If the wall is thick, or there are two walls
with a shaft between them, the room is searched for further behind the sign.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.records import Room, Sign, Surface

BEHIND = (0.2, 0.35, 0.5)
"""Distances behind a sign at which its room is searched for, m. Chosen: walls of up to half a
metre."""

BEFORE = 0.3
"""Distance in front of a sign at which the room that contains the sign is searched for, m.
Chosen."""

NEAR = 4.0
"""Maximum distance of a near sign from a surface in the same room, m. Chosen."""


def named_rooms(boundaries: Sequence[Float64], signs: Sequence[Sign]) -> tuple[Room, ...]:
    """Return rooms with the names of their door signs.

    If a room has several signs, the most confident one names it.

    Parameters
    ----------
    boundaries
        float64 (N, 2) each, open rings in map, m.
    signs
        Door signs in map.
    """
    areas = [Polygon(ring) for ring in boundaries]
    rooms = [Room(k, "", ring, area.area) for k, (ring, area) in enumerate(zip(boundaries, areas))]
    for sign in sorted(signs, key=lambda s: (-s.confidence, s.id)):
        k = _room_behind(sign, areas)
        if k is not None:
            room = rooms[k]
            ids = tuple(sorted((*room.signs, sign.id)))
            rooms[k] = replace(room, name=room.name or sign.number, signs=ids)
    return tuple(rooms)


def _room_behind(sign: Sign, areas: Sequence[Polygon]) -> int | None:
    for depth in BEHIND:
        k = _room_at(sign.position[:2] - depth * sign.normal[:2], areas)
        if k is not None:
            return k
    return None


def _room_at(point: Float64, areas: Sequence[Polygon]) -> int | None:
    """Return the index of the room that contains a point; None if there is none."""
    return next((k for k, a in enumerate(areas) if shapely.contains_xy(a, *point)), None)


def placed_surfaces(
    surfaces: Iterable[Surface], rooms: Sequence[Room], signs: Sequence[Sign]
) -> tuple[Surface, ...]:
    """Return surfaces with their rooms and near signs.

    A surface is in the room with the largest part of it; the floor, which extends over many, is in
    none. Near signs are those of its room, and those that hang inside the room within `NEAR`.

    Parameters
    ----------
    surfaces, rooms, signs
        Surfaces, rooms and signs in map.
    """
    areas = [Polygon(room.boundary) for room in rooms]
    before = [(sign.position + BEFORE * sign.normal)[:2] for sign in signs]
    hung_in = {sign.id: _room_at(point, areas) for sign, point in zip(signs, before)}
    placed = []
    for surface in surfaces:
        outline = shapely.make_valid(Polygon(surface.boundary[:, :2]))
        room = None if surface.label == "floor" else _fullest_room(outline, areas)
        if room is None:
            placed.append(surface)
            continue
        near = []
        for sign in signs:
            away = float(shapely.distance(outline, shapely.Point(sign.position[:2])))
            hangs_here = hung_in[sign.id] == room and away <= NEAR
            if sign.id in rooms[room].signs or hangs_here:
                near.append((away, sign.id, sign.text))
        texts = tuple(text for _, _, text in sorted(near))
        placed.append(replace(surface, room=rooms[room].name, near=texts))
    return tuple(placed)


def _fullest_room(outline: shapely.Geometry, areas: Sequence[Polygon]) -> int | None:
    """Return the index of the room with the largest part of an outline; None if there is none."""
    common = [float(shapely.area(shapely.intersection(outline, area))) for area in areas]
    return int(np.argmax(common)) if common and max(common) > 0.0 else None
