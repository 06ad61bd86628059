"""Conversion of messages of tccm_interfaces to entities of the live page."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.nodes.map_records import (
    MapCompartment,
    MapEvent,
    compartments_of,
    objects_of,
    surfaces_of,
)
from tccm_ros.racks.outline import box_edges
from tccm_ros.tabletop.free_places import rectangle_corners
from tccm_ros.view.live_state import MARGIN_M, Entities, free_entity, rounded, surface_entity


def entities_of(message: Any) -> Entities:
    """Return a tccm_interfaces/SurfaceMap as entities (`view.live_state`)."""
    ground = 0.0 if math.isnan(message.floor_z) else message.floor_z
    surfaces = surfaces_of(message.surfaces)
    found: Entities = {}
    names = {s.id: f"{s.label} (surface {s.id})" for s in surfaces}
    points = [s.boundary[:, :2] for s in surfaces]
    for surface in surfaces:
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
            "first": seconds(m.first_seen),
            "last": seconds(m.last_seen),
        }
        holes = [_ring(hole) for hole in m.holes]
        middle = surface.T_map_surface[:3, 3].tolist()
        normal = surface.T_map_surface[:3, 2]
        entity = surface_entity(facts, surface.boundary, holes, normal, middle)
        found[f"surface/{surface.id}"] = entity
    for item in objects_of(message.objects):
        z = float(item.T_map_object[2, 3])
        yaw = math.atan2(item.T_map_object[1, 0], item.T_map_object[0, 0])
        corners = rectangle_corners(float(item.size[0]), float(item.size[1]), yaw)
        found[f"object/{item.id}"] = {
            "id": item.id,
            "surface": item.surface_id,
            "on": names.get(item.surface_id),
            "size": rounded(item.size),
            "corners": [rounded(corner) for corner in item.T_map_object[:2, 3] + corners],
            "low": round(z - item.size[2] / 2, 3),
            "high": round(z + item.size[2] / 2, 3),
        }
    for wall in message.walls:
        ends = np.array([[p.x, p.y] for p in wall.endpoints])
        points.append(ends)
        found[f"wall/{wall.id}"] = {
            "id": wall.id,
            "ends": [rounded(end) for end in ends],
            "length": round(float(np.hypot(*(ends[1] - ends[0]))), 3),
            "observations": wall.observations,
        }
    for sign in message.signs:
        at, normal = sign.position, sign.normal
        found[f"sign/{sign.id}"] = {
            "id": sign.id,
            "text": sign.text,
            "at": rounded([at.x, at.y, at.z]),
            "normal": rounded([normal.x, normal.y, normal.z]),
        }
    for area in message.free_areas:
        rings = [_ring(ring) for ring in area.outlines if len(ring.points) > 2]
        if rings:
            name = names.get(area.surface_id, "")
            found[f"free/{area.surface_id}"] = free_entity(name, rings)
    for k, space in enumerate(compartments_of(message.compartments)):
        found[f"compartment/{k}"] = _compartment(space)
    every = np.concatenate([np.zeros((1, 2)), *points])
    found["world"] = {
        "ground": round(ground, 3),
        "start": min((seconds(s.first_seen) for s in message.surfaces), default=0.0),
        # Rounded to whole metres, so that small growth of the map does not change the extent.
        "extent": [
            np.floor(every.min(axis=0) - MARGIN_M).tolist(),
            np.ceil(every.max(axis=0) + MARGIN_M).tolist(),
        ],
    }
    return found


def _compartment(space: MapCompartment) -> dict[str, Any]:
    middle, R = space.T_map_front[:3, 3], space.T_map_front[:3, :3]
    front = middle + 0.5 * space.width * np.array([R[:, 1], -R[:, 1]])
    edges = box_edges(front, R[:, 0], space.depth, space.height)
    return {
        "board": space.board_id,
        "width": round(space.width, 3),
        "depth": round(space.depth, 3),
        "height": round(space.height, 3),
        "sides": [space.left, space.right],
        "back": space.back,
        "ceiling": space.ceiling,
        "edges": [[rounded(end) for end in ends] for ends in edges],
    }


def event_text(event: MapEvent) -> str:
    """Return a sentence about a change of the map."""
    kind = event.kind.replace("_", " ")
    ids = (event.ids_before, event.ids_after)
    shown = " -> ".join(", ".join(map(str, part)) for part in ids if part)
    if event.object_id >= 0:
        return f"{kind}: {event.label or 'object'} {event.object_id} on surface {shown}"
    return f"{kind}: {event.label} {shown}"


def planar(pose: Any) -> list[float]:
    """Return (x, y, yaw) of a geometry_msgs/Pose, rounded to mm and mrad."""
    q = pose.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return rounded([pose.position.x, pose.position.y, yaw])


def seconds(stamp: Any) -> float:
    """Return a builtin_interfaces/Time, s."""
    return round(float(stamp.sec) + 1e-9 * stamp.nanosec, 3)


def _ring(message: Any) -> Float64:
    return np.array([[p.x, p.y, p.z] for p in message.points]).reshape(-1, 3)
