"""Conversion of messages of tccm_interfaces to entities of the live page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.report.entities import (
    compartment_entity,
    object_entity,
    rounded,
    seconds,
    sign_entity,
    wall_entity,
)
from tccm_ros.ros.map_records import (
    MapCompartment,
    MapEvent,
    MapObject,
    MapSign,
    MapSurface,
    MapWall,
)
from tccm_ros.tabletop.free_places import rectangle_corners
from tccm_ros.view.live_state import MARGIN_M, Entities, free_entity, surface_entity


def entities_of(message: Any) -> Entities:
    """Return a tccm_interfaces/SurfaceMap as entities (`view.live_state`)."""
    surfaces = [MapSurface.of(m) for m in message.surfaces]
    walls = [MapWall.of(m) for m in message.walls]
    labels = {s.id: f"{s.label} (surface {s.id})" for s in surfaces}
    found: Entities = {f"surface/{s.id}": _surface(s) for s in surfaces}
    found |= {f"object/{o.id}": _object(o, labels) for o in map(MapObject.of, message.objects)}
    found |= {f"wall/{wall.id}": wall_entity(wall) for wall in walls}
    found |= {f"sign/{sign.id}": sign_entity(sign) for sign in map(MapSign.of, message.signs)}
    for area in message.free_areas:
        rings = [_ring(ring) for ring in area.outlines if len(ring.points) > 2]
        if rings:
            found[f"free/{area.surface_id}"] = free_entity(labels.get(area.surface_id, ""), rings)
    for k, space in enumerate(map(MapCompartment.of, message.compartments)):
        found[f"compartment/{k}"] = _compartment(space)
    found["world"] = _world(message, surfaces, walls)
    return found


def _surface(surface: MapSurface) -> dict[str, Any]:
    m = surface.message
    facts = {
        "id": surface.id,
        "label": surface.label,
        "room": surface.room,
        "height": round(surface.height, 3),
        "size": rounded(surface.size),
        "area": round(surface.area, 3),
        "views": len(m.view_stamps),
        "points": m.points,
        "std": None if math.isnan(m.height_std) else round(m.height_std, 5),
        "first": seconds(surface.first_seen_ns),
        "last": seconds(surface.last_seen_ns),
    }
    T, holes = surface.T_map_surface, [_ring(hole) for hole in m.holes]
    return surface_entity(facts, surface.boundary, holes, T[:3, 2], T[:3, 3].tolist())


def _object(item: MapObject, labels: Mapping[int, str]) -> dict[str, Any]:
    T = item.T_map_object
    yaw = math.atan2(T[1, 0], T[0, 0])
    corners = T[:2, 3] + rectangle_corners(float(item.size[0]), float(item.size[1]), yaw)
    label = labels.get(item.surface_id)
    return object_entity(item.id, item.surface_id, label, T[:3, 3], item.size, corners)


def _compartment(space: MapCompartment) -> dict[str, Any]:
    middle, R = space.T_map_front[:3, 3], space.T_map_front[:3, :3]
    front = middle + 0.5 * space.width * np.array([R[:, 1], -R[:, 1]])
    lengths = space.width, space.depth, space.height
    faces = space.left, space.right, space.back, space.ceiling
    return compartment_entity(space.board_id, front, R[:, 0], lengths, faces, space.open_parts)


def _world(
    message: Any, surfaces: Sequence[MapSurface], walls: Sequence[MapWall]
) -> dict[str, Any]:
    """Return the height of the floor, the first stamp, and the extent of the map."""
    shown = [s.boundary[:, :2] for s in surfaces] + [wall.endpoints[:, :2] for wall in walls]
    points = np.concatenate([np.zeros((1, 2)), *shown])
    return {
        "ground": 0.0 if math.isnan(message.floor_z) else round(message.floor_z, 3),
        "start": min((seconds(s.first_seen_ns) for s in surfaces), default=0.0),
        # Rounded to whole metres, so that small growth of the map does not change the extent.
        "extent": [
            np.floor(points.min(axis=0) - MARGIN_M).tolist(),
            np.ceil(points.max(axis=0) + MARGIN_M).tolist(),
        ],
    }


def event_text(event: MapEvent) -> str:
    """Return a sentence about a change of the map."""
    kind = event.kind.replace("_", " ")
    ids = (event.ids_before, event.ids_after)
    shown = " -> ".join(", ".join(map(str, part)) for part in ids if part)
    if event.object_id >= 0:
        return f"{kind}: {event.label or 'object'} {event.object_id} on surface {shown}"
    return f"{kind}: {event.label} {shown}"


def xy_yaw(pose: Any) -> list[float]:
    """Return (x, y, yaw) of a geometry_msgs/Pose, rounded to mm and mrad."""
    q = pose.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return rounded([pose.position.x, pose.position.y, yaw])


def _ring(message: Any) -> Float64:
    return np.array([[p.x, p.y, p.z] for p in message.points]).reshape(-1, 3)
