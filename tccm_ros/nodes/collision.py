"""Surfaces as MoveIt collision objects: a thin slab under each, where moveit_msgs is installed.

It is a box, or a mesh where a box would block much more than the surface (`surface_shape`).
MoveIt's planning scene monitor listens on ``collision_object``. A surface that is gone is removed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from tccm_ros.nodes.ros_types import message_class
from tccm_ros.records import Surface
from tccm_ros.results.planning import OBJECT_PREFIX, Box, Mesh, surface_shape
from tccm_ros.ros.types import MessageTypes, header_message, pose_message

COLLISION_OBJECT = "moveit_msgs/msg/CollisionObject"

COLLISION_PROFILE = QoSProfile(depth=500, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A late subscriber gets the newest 500 objects, in their order: each solution sends all surfaces,
so that this is more than the newest map."""

SOLID_BOX = 1
"""shape_msgs/SolidPrimitive BOX."""


def collision_messages(
    types: MessageTypes, stamp_ns: int, frame_id: str, surfaces: Iterable[Surface], gone: set[int]
) -> Iterator[Any]:
    """Yield a moveit_msgs/CollisionObject for each surface, and one to remove each that is gone.

    Parameters
    ----------
    types
        Message classes.
    stamp_ns, frame_id
        Header; the surfaces are in that frame.
    surfaces
        Those to add or replace, by their ids.
    gone
        Ids of those to remove.
    """
    header = header_message(types, stamp_ns, frame_id)
    for identity in sorted(gone):
        yield types.make(
            COLLISION_OBJECT,
            header=header,
            id=f"{OBJECT_PREFIX}{identity}",
            operation=types.octet(1),
        )
    for surface in surfaces:
        yield types.make(
            COLLISION_OBJECT,
            header=header,
            id=f"{OBJECT_PREFIX}{surface.id}",
            operation=types.octet(0),
            **_shape_fields(types, surface_shape(surface)),
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


class CollisionObjects:
    """Publishes the surfaces of each solution to MoveIt.

    Parameters
    ----------
    node, types, frame_id
        The node, its message classes, and the map frame.
    """

    def __init__(self, node: Node, types: MessageTypes, frame_id: str):
        self._types, self._frame_id = types, frame_id
        self._context = node.context
        self._shown: set[int] = set()
        self._publisher = None
        if _has_moveit_msgs():
            self._publisher = node.create_publisher(
                message_class(COLLISION_OBJECT), "collision_object", COLLISION_PROFILE
            )

    @property
    def is_published(self) -> bool:
        """Whether there is such a topic."""
        return self._publisher is not None

    def publish(self, surfaces: Iterable[Surface], stamp_ns: int) -> None:
        """Publish all surfaces but the floor, unless the node is ending."""
        if self._publisher is None or not self._context.ok():
            return
        shown = [surface for surface in surfaces if surface.label != "floor"]
        now = {surface.id for surface in shown}
        for message in collision_messages(
            self._types, stamp_ns, self._frame_id, shown, self._shown - now
        ):
            self._publisher.publish(message)
        self._shown = now


def _has_moveit_msgs() -> bool:
    try:
        message_class(COLLISION_OBJECT)
    except ImportError:
        return False
    return True
