"""Collision shapes of surfaces, sides of racks, objects and unseen space for motion planning.

`Box` has the content of shape_msgs/SolidPrimitive, `Mesh` that of shape_msgs/Mesh.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64, Int64
from tccm_ros.geometry import pose
from tccm_ros.outlines.triangulation import fill_rings
from tccm_ros.racks.compartment import Compartment, FaceState
from tccm_ros.racks.unseen_space import UnseenSpace
from tccm_ros.records import Surface
from tccm_ros.scene.scene import object_pose
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.surfaces.polygons import NEARLY_WHOLE

SURFACE_PREFIX = "tccm_surface_"
"""Prefix of the names of collision objects, so that those of other programs are kept."""

PANEL_PREFIX = "tccm_rack_"
"""Prefix of the names of panels of racks."""

OBJECT_PREFIX = "tccm_object_"
"""Prefix of the names of objects."""

UNSEEN_PREFIX = "tccm_unseen_"
"""Prefix of the names of boxes of unseen space."""

THICKNESS = 0.02
"""Thickness of a surface whose lower side was not measured, downwards, m; chosen: a thin board, as
the space below may be free."""

MIN_BOARD, MAX_BOARD = 0.005, 0.08
"""Limits of a measured thickness, m; chosen: a sheet, and a worktop."""

PANEL = 0.01
"""Thickness of sides and backs of racks, m; chosen: thinner than real panels, as only one side was
seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box in map, or the vertical cylinder in it.

    Attributes
    ----------
    T_map_box
        float64 (4, 4), pose of its centre.
    size
        float64 (3,), edges along its x, y and z axes, m.
    is_round
        Whether it is the cylinder, whose axis is z; the edges along x and y are its diameter.
    """

    T_map_box: Float64
    size: Float64
    is_round: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A closed triangle mesh in map.

    Attributes
    ----------
    vertices
        float64 (N, 3), m.
    triangles
        int64 (M, 3), rows of `vertices`, counter-clockwise seen from outside.
    """

    vertices: Float64
    triangles: Int64


def surface_shape(surface: Surface, thickness: float = THICKNESS) -> Box | Mesh:
    """Return a surface as a box, or as a mesh if it covers too little of its box.

    Parameters
    ----------
    surface
        A surface of the map.
    thickness
        Thickness downwards from the surface, m.
    """
    box = surface_box(surface, thickness)
    if surface.area / surface.normal[2] < NEARLY_WHOLE * box.size[0] * box.size[1]:
        return surface_mesh(surface, thickness)
    return box


def structure_shapes(
    surfaces: Iterable[Surface], compartments: Sequence[Compartment]
) -> dict[str, Box | Mesh]:
    """Return the shapes of all surfaces except the floor, and of measured faces of racks, by name.

    The robot, which stands on the floor, would always be in collision with it.

    Parameters
    ----------
    surfaces
        Surfaces of the map. A board whose lower side was measured has its measured thickness.
    compartments
        Their sides, backs and ceilings without a surface are panels behind the measured faces;
        doors and drawers that stand open are boxes.
    """
    known = [surface for surface in surfaces if surface.label != "floor"]
    heights = {surface.id: surface.height for surface in known}
    thickness: dict[int, float] = {}
    for space in compartments:
        if space.above in heights and space.ceiling == FaceState.MEASURED:
            lower_side = float(space.T_map_front[2, 3]) + space.height
            measured = min(max(heights[space.above] - lower_side, MIN_BOARD), MAX_BOARD)
            thickness[space.above] = max(measured, thickness.get(space.above, 0.0))
    shapes: dict[str, Box | Mesh] = {
        f"{SURFACE_PREFIX}{s.id}": surface_shape(s, thickness.get(s.id, THICKNESS)) for s in known
    }
    parts: Counter[int] = Counter()
    for space in compartments:
        name = f"{PANEL_PREFIX}{space.board}_{parts[space.board]}"
        parts[space.board] += 1
        shapes |= {f"{name}_{face}": box for face, box in _panels(space)}
        for k, part in enumerate(space.open_parts):
            shapes[f"{name}_open_{k}"] = Box(part.T_map_part, part.size)
    return shapes


def scene_shapes(
    surfaces: Iterable[Surface],
    objects: Iterable[SceneObject],
    compartments: Sequence[Compartment] = (),
    unseen: Iterable[UnseenSpace] = (),
) -> dict[str, Box | Mesh]:
    """Return the shapes of surfaces, racks and objects, and boxes of unseen space.

    Parameters
    ----------
    surfaces, objects, compartments, unseen
        Contents of a solution, in map.
    """
    shapes = structure_shapes(surfaces, compartments)
    shapes |= {f"{OBJECT_PREFIX}{o.id}": Box(object_pose(o), o.size, o.is_round) for o in objects}
    parts: Counter[int] = Counter()
    for space in unseen:
        name = f"{UNSEEN_PREFIX}{space.surface}_{parts[space.surface]}"
        parts[space.surface] += 1
        shapes[name] = Box(space.T_map_space, space.size)
    return shapes


def _panels(space: Compartment) -> Iterator[tuple[str, Box]]:
    """Yield the measured faces of a compartment, each as a panel behind it."""
    w, d, h, t = space.width, space.depth, space.height, PANEL
    side, high = np.array([d, t, h]), 0.5 * h
    panels = {
        "left": (space.left, (0.5 * d, 0.5 * (w + t), high), side),
        "right": (space.right, (0.5 * d, -0.5 * (w + t), high), side),
        "back": (space.back, (d + 0.5 * t, 0.0, high), np.array([t, w, h])),
    }
    if space.above is None:
        size = np.array([d, w, THICKNESS])
        panels["ceiling"] = (space.ceiling, (0.5 * d, 0.0, h + 0.5 * THICKNESS), size)
    for name, (state, middle, size) in panels.items():
        if state == FaceState.MEASURED:
            T = space.T_map_front.copy()
            T[:3, 3] += T[:3, :3] @ np.array(middle)
            yield name, Box(T, size)


def surface_box(surface: Surface, thickness: float = THICKNESS) -> Box:
    """Return the smallest box under a surface's outline; its top is in the surface's plane.

    Holes and notches are filled: a planner that avoids the box avoids the surface.
    """
    rectangle = shapely.oriented_envelope(Polygon(surface.boundary[:, :2]))
    corners = np.asarray(rectangle.exterior.coords)[:4]
    edge = corners[1] - corners[0]
    x = np.array([*edge, 0.0]) / np.linalg.norm(edge)
    x -= (x @ surface.normal) * surface.normal
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(surface.normal, x), surface.normal], axis=1)
    local = surface.boundary @ R
    low, high = local.min(axis=0), local.max(axis=0)
    size = np.array([high[0] - low[0], high[1] - low[1], thickness])
    middle = np.array([*(0.5 * (low + high))[:2], surface.offset - 0.5 * thickness])
    return Box(pose(R, R @ middle), size)


def surface_mesh(surface: Surface, thickness: float = THICKNESS) -> Mesh:
    """Return the slab under a surface, with its holes and its true outline."""
    rings = [surface.boundary, *surface.holes]
    top = np.concatenate(rings)
    _, faces = fill_rings([ring[:, :2] for ring in rings])
    count, down = len(top), thickness * surface.normal
    sides = []
    start = 0
    for ring in rings:
        a = start + np.arange(len(ring))
        b = start + (np.arange(len(ring)) + 1) % len(ring)
        sides.append(np.stack([a, a + count, b], axis=1))
        sides.append(np.stack([b, a + count, b + count], axis=1))
        start += len(ring)
    triangles = np.concatenate([faces, faces[:, ::-1] + count, *sides])
    return Mesh(np.concatenate([top, top - down]), triangles.astype(np.int64))
