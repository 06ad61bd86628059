"""Surfaces and the objects on them as moveit_msgs/CollisionObject.

A surface is a thin slab under it: a box, or a mesh where a box would block much more than the
surface (`surface_shape`). An object is its bounding box.
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
"""Before the id of an object; those of surfaces and racks are in `planning_shapes`."""

ADD, REMOVE = 0, 1
"""moveit_msgs/CollisionObject: an object of the same name is replaced; removed."""

SOLID_BOX = 1
"""shape_msgs/SolidPrimitive BOX."""

Shapes = Mapping[str, Box | Mesh]
"""Shapes in map by the name of the collision object."""


def collision_shapes(
    surfaces: Iterable[Surface],
    objects: Iterable[SceneObject],
    compartments: Sequence[Compartment] = (),
) -> Shapes:
    """Return the shapes of surfaces and racks (`structure_shapes`), and of what stands on surfaces.

    Parameters
    ----------
    surfaces, objects, compartments
        In map.
    """
    structure = structure_shapes(surfaces, compartments)
    return structure | {f"{ITEM_PREFIX}{o.id}": Box(object_pose(o), o.size) for o in objects}


def collision_messages(
    types: MessageTypes, stamp_ns: int, frame_id: str, shapes: Shapes, gone: Iterable[str] = ()
) -> Iterator[Any]:
    """Yield a moveit_msgs/CollisionObject that removes each that is gone, and one for each shape.

    Parameters
    ----------
    types
        Message classes.
    stamp_ns, frame_id
        Header; the shapes are in that frame.
    shapes
        Of those to add or replace.
    gone
        Names of those to remove.
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
