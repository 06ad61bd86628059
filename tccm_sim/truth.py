"""Ground truth of a world: surfaces, objects, walls and the trajectory, in the formats of files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from shapely import Polygon, set_precision, union_all
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from tccm_ros.arrays import Float64
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.rigid import invert, quaternion_xyzw, rigid
from tccm_sim.scene import Solid
from tccm_sim.world import World

POSE_PERIOD = 0.02  # s, of the true trajectory
SMALLEST = 0.01  # m2, minimum area of a surface (chosen)
CONTACT = 0.005  # m, maximum distance of an object from the surface below it (chosen)
CAP_CORNERS = 64  # number of corners of the polygon of a cylinder's top
GRID = 1e-6  # m, of the coordinates of polygons


def map_from_world(simulation: Simulation) -> Float64:
    """Return T_map_world, float64 (4, 4): the map is the first base pose without roll and pitch."""
    first = simulation.true_poses(np.zeros(1))[0]
    yaw = float(np.arctan2(first[1, 0], first[0, 0]))
    return invert(rigid(first[:3, 3], (0.0, 0.0, yaw)))


def trajectory(simulation: Simulation) -> Iterator[str]:
    """Yield the lines of truth.tum: stamp, position and quaternion of the base in map."""
    T_map_world = map_from_world(simulation)
    times = np.arange(0.0, simulation.world.duration, POSE_PERIOD)
    for time, T_world_base in zip(times, simulation.true_poses(times)):
        T = T_map_world @ T_world_base
        stamp_ns = EPOCH_NS + round(time * 1e9)
        numbers = " ".join(f"{v:.9f}" for v in (*T[:3, 3], *quaternion_xyzw(T)))
        yield f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {numbers}"


def surfaces(simulation: Simulation) -> dict[str, Any]:
    """Return truth.json: surfaces at the end of the recording, with the keys of surfaces.json.

    `surfaces` are those named in the scene, `gone` those that vanished before the end, and `others`
    all other horizontal tops of at least 0.01 m2; objects on surfaces are in `objects`. The floor
    is not listed; `floor_z` is its height. If the world has rooms, `signs` are the door signs and
    `rooms` the boundaries of the rooms.
    """
    T_map_world = map_from_world(simulation)
    end = simulation.world.duration
    solids = simulation.scene.solids
    present = [_moved(s, end) for s in solids if s.span[0] <= end < s.span[1]]
    before = [
        _moved(s, max(s.span[0], 0.0)) for s in solids if s.span[1] <= end and s.role != "person"
    ]
    named = _by_name([s for s in present if s.surface and _has_vertical_axis(s)])
    return {
        "format": "tccm_ros/surfaces",
        "version": 1,
        "frame_id": "map",
        "floor_z": round(float(T_map_world[2, 3]), 6),
        "surfaces": _surfaces(named, present, T_map_world),
        "gone": _surfaces(_by_name([s for s in before if s.surface]), before, T_map_world),
        "others": _surfaces([(s.name, [s]) for s in present if _is_other(s)], present, T_map_world),
        "objects": [_object(s, T_map_world) for s in present if s.role == "object"],
        **_signs_and_rooms(simulation.world, T_map_world),
    }


def _signs_and_rooms(world: World, T_map_world: Float64) -> dict[str, Any]:
    """Return the door signs and rooms of a world, if it has any."""
    if not world.rooms:
        return {}
    R, t = T_map_world[:3, :3], T_map_world[:3, 3]
    names = {room.name for room in world.rooms}
    plates = [panel for panel in world.panels if panel.number]
    return {
        "signs": [
            {
                "id": k,
                "text": panel.number,
                "position": _rounded(R @ panel.position + t),
                "normal": _rounded(R @ panel.normal),
                "room": panel.number if panel.number in names else None,
            }
            for k, panel in enumerate(plates)
        ],
        "rooms": [
            {"name": room.name, "boundary": _rounded(room.boundary @ R[:2, :2].T + t[:2])}
            for room in world.rooms
        ],
    }


def walls(simulation: Simulation) -> dict[str, Any]:
    """Return truth_walls.json: the vertical faces of walls, as lines in map."""
    T_map_world = map_from_world(simulation)
    return {
        "frame_id": "map",
        "walls": [
            {"id": i, **_line(np.array(face), T_map_world)}
            for i, face in enumerate(simulation.world.scene.wall_faces)
        ],
    }


def _line(face: Float64, T_map_world: Float64) -> dict[str, Any]:
    """Return phi, rho and the endpoints of a face (2, 2) in the world."""
    ends = face @ T_map_world[:2, :2].T + T_map_world[:2, 3]
    ux, uy = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    normal = np.array([-uy, ux])
    rho = float(normal @ ends[0])
    if rho < 0.0:
        normal, rho = -normal, -rho
    phi = float(np.arctan2(normal[1], normal[0]))
    return {"phi": round(phi, 6), "rho": round(rho, 6), "endpoints": _rounded(ends)}


def _by_name(solids: list[Solid]) -> list[tuple[str, list[Solid]]]:
    """Group solids by their surface, in order of first appearance."""
    names = dict.fromkeys(s.surface for s in solids)
    return [(name, [s for s in solids if s.surface == name]) for name in names]


def _surfaces(
    groups: list[tuple[str, list[Solid]]], present: list[Solid], T_map_world: Float64
) -> list[dict[str, Any]]:
    """Return a row per polygon of the tops of each group, without the areas under objects."""
    rows: list[dict[str, Any]] = []
    for name, group in groups:
        height = _top(group[0])
        covers = [s for s in present if s.role != "object" and s not in group and _on(s, height)]
        region = union_all([_outline(s) for s in group]).difference(
            union_all([_outline(s) for s in covers])
        )
        for polygon in _polygons(region):
            rows.append({"id": len(rows), "label": name, **_row(polygon, height, T_map_world)})
    return rows


def _row(polygon: Polygon, height: float, T_map_world: Float64) -> dict[str, Any]:
    def ring(coordinates: Any) -> list[list[float]]:
        xy = np.array(coordinates)[:-1, :2]
        return _rounded(np.column_stack([xy, np.full(len(xy), height)]) @ R.T + t)

    R, t = T_map_world[:3, :3], T_map_world[:3, 3]
    polygon = orient(polygon)
    center = np.array([polygon.centroid.x, polygon.centroid.y, height]) @ R.T + t
    return {
        "height": round(float(height + t[2]), 6),
        "normal": [0.0, 0.0, 1.0],
        "area": round(polygon.area, 6),
        "centroid": _rounded(center),
        "boundary": ring(polygon.exterior.coords),
        "holes": [ring(hole.coords) for hole in polygon.interiors],
    }


def _object(solid: Solid, T_map_world: Float64) -> dict[str, Any]:
    T = T_map_world @ solid.T_world_solid
    yaw = float(np.arctan2(T[1, 0], T[0, 0]))
    yaw -= np.pi * np.ceil(yaw / np.pi - 0.5)
    return {
        "name": solid.name,
        "center": _rounded(T[:3, 3]),
        "size": _rounded(2.0 * np.array(solid.half)),
        "yaw": round(yaw, 6),
    }


def _is_other(solid: Solid) -> bool:
    """Return whether a solid has a horizontal top that is not named as a surface."""
    is_furniture = solid.role in ("furniture", "object") and not solid.surface
    return is_furniture and _has_vertical_axis(solid) and _outline(solid).area >= SMALLEST


def _has_vertical_axis(solid: Solid) -> bool:
    return bool(abs(solid.T_world_solid[2, 2]) > 1.0 - 1e-9)


def _top(solid: Solid) -> float:
    return float(solid.T_world_solid[2, 3] + solid.half_extent[2])


def _on(solid: Solid, height: float) -> bool:
    """Return whether a solid covers a surface at a height: it stands on it or intersects it."""
    low, high = solid.T_world_solid[2, 3] - solid.half_extent[2], _top(solid)
    return bool(low < height + CONTACT and high > height + CONTACT)


def _outline(solid: Solid) -> BaseGeometry:
    """Return the outline from above of a solid with a vertical axis."""
    x, y, _ = solid.half
    if solid.shape == "cylinder":
        angles = np.arange(CAP_CORNERS) * 2.0 * np.pi / CAP_CORNERS
        corners = np.column_stack([x * np.cos(angles), x * np.sin(angles)])
    else:
        corners = np.array([(-x, -y), (x, -y), (x, y), (-x, y)])
    T = solid.T_world_solid
    return set_precision(Polygon(corners @ T[:2, :2].T + T[:2, 3]), GRID)


def _polygons(region: BaseGeometry) -> list[Polygon]:
    region = region.normalize().simplify(GRID)  # remove the corners at seams of joined tops
    parts = getattr(region, "geoms", [region])
    return [p for p in parts if isinstance(p, Polygon) and p.area >= SMALLEST]


def _moved(solid: Solid, time: float) -> Solid:
    """Return a static solid at the pose of a moving one at a time."""
    if solid.motion is None:
        return solid
    x, y, z, yaw = solid.motion.at(time)
    T = rigid((x, y, z), (0.0, 0.0, yaw))
    place = rigid(solid.T_world_solid[:3, 3] + T[:3, 3])
    place[:3, :3] = T[:3, :3] @ solid.T_world_solid[:3, :3]
    return replace(solid, T_world_solid=place, motion=None)


def _rounded(values: Float64) -> Any:
    return (np.round(values, 6) + 0.0).tolist()
