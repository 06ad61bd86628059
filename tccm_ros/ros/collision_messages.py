"""Surfaces and the objects on them as moveit_msgs/CollisionObject.

A surface is a thin slab below its plane: a box, or a mesh if a box would block a much larger area
than the surface (`surface_shape`). An object is its bounding box.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tccm_ros.racks.compartment import Compartment
from tccm_ros.records import Surface
from tccm_ros.ros.types import MessageTypes, header_message, pose_message
from tccm_ros.surfaces.planning_shapes import Box, Mesh, structure_shapes
from tccm_ros.surfaces.scene import object_pose
from tccm_ros.surfaces.scene_objects import SceneObject

COLLISION_OBJECT = "moveit_msgs/msg/CollisionObject"

ITEM_PREFIX = "tccm_object_"
"""Prefix of an object's id; the prefixes of surfaces and racks are in `planning_shapes`."""

ADD, REMOVE = 0, 1
"""Operations of moveit_msgs/CollisionObject; ADD replaces an object of the same id."""

SOLID_BOX = 1
"""BOX of shape_msgs/SolidPrimitive."""

Shapes = Mapping[str, Box | Mesh]
"""Shapes in map by the name of the collision object."""


def collision_shapes(
    surfaces: Iterable[Surface],
    objects: Iterable[SceneObject],
    compartments: Sequence[Compartment] = (),
) -> Shapes:
    """Return the shapes of surfaces and racks (`structure_shapes`), and of objects on surfaces.

    Parameters
    ----------
    surfaces, objects, compartments
        Contents of a solution, in map.
    """
    structure = structure_shapes(surfaces, compartments)
    return structure | {f"{ITEM_PREFIX}{o.id}": Box(object_pose(o), o.size) for o in objects}


def collision_messages(
    types: MessageTypes, stamp_ns: int, frame_id: str, shapes: Shapes, gone: Iterable[str] = ()
) -> Iterator[Any]:
    """Yield a moveit_msgs/CollisionObject for each removed object, then for each shape.

    Parameters
    ----------
    types
        Message classes.
    stamp_ns, frame_id
        Header; the shapes are in that frame.
    shapes
        Shapes to add or replace.
    gone
        Names of objects to remove.
    """
    header = header_message(types, stamp_ns, frame_id)
    for name in sorted(gone):
        yield types.make(COLLISION_OBJECT, header=header, id=name, operation=types.octet(REMOVE))
    for name, shape in shapes.items():
        yield types.make(
            COLLISION_OBJECT,
            header=header,
            id=name,
            operation=types.octet(ADD),
            **_shape_fields(types, shape),
        )


def _shape_fields(types: MessageTypes, shape: Box | Mesh) -> dict[str, list[Any]]:
    """Return the fields of a CollisionObject with a shape and its pose."""
    if isinstance(shape, Box):
        sides = types.array("f8", shape.size)
        solid = types.make("shape_msgs/msg/SolidPrimitive", type=SOLID_BOX, dimensions=sides)
        return {"primitives": [solid], "primitive_poses": [pose_message(types, shape.T_map_box)]}
    mesh = types.make(
        "shape_msgs/msg/Mesh",
        triangles=[
            types.make("shape_msgs/msg/MeshTriangle", vertex_indices=np.uint32(corners))
            for corners in shape.triangles
        ],
        vertices=types.rows("geometry_msgs/msg/Point", shape.vertices),
    )
    return {"meshes": [mesh], "mesh_poses": [pose_message(types, np.eye(4))]}
