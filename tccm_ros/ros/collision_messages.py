"""Planning scenes as moveit_msgs/CollisionObject and moveit_msgs/PlanningScene.

A surface is a thin slab below its plane: a box, or a mesh if a box would block a much larger area
than the surface (`surface_shape`). An object is a cylinder or its bounding box. The pose of a solid
is that of its collision object, so that a MOVE needs no shape.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from tccm_ros.ros.types import MessageTypes, header_message, pose_message
from tccm_ros.scene.planning_shapes import Box, Mesh
from tccm_ros.scene.published_scene import SceneChanges, Shapes

COLLISION_OBJECT = "moveit_msgs/msg/CollisionObject"

PLANNING_SCENE = "moveit_msgs/msg/PlanningScene"

ADD, REMOVE, MOVE = 0, 1, 3
"""Operations of moveit_msgs/CollisionObject; ADD replaces an object of the same id."""

SOLID_BOX, SOLID_CYLINDER = 1, 3
"""BOX and CYLINDER of shape_msgs/SolidPrimitive; dimensions are x, y, z, and height, radius."""


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
        yield _added(types, header, name, shape)


def planning_scene_message(
    types: MessageTypes,
    stamp_ns: int,
    frame_id: str,
    changes: SceneChanges,
) -> Any:
    """Return a moveit_msgs/PlanningScene of changes (``is_diff``).

    Parameters
    ----------
    types
        Message classes.
    stamp_ns, frame_id
        Header of the collision objects; the shapes are in that frame.
    changes
        Changes around the robot, and objects that it takes or puts down. MoveIt takes an object
        that it knows out of the world when it is attached, and puts it back when it is detached.
    """
    header, diff = header_message(types, stamp_ns, frame_id), changes.diff
    objects = list(collision_messages(types, stamp_ns, frame_id, diff.add, diff.remove))
    objects += [
        types.make(
            COLLISION_OBJECT,
            header=header,
            id=name,
            operation=types.octet(MOVE),
            pose=pose_message(types, box.T_map_box),
        )
        for name, box in diff.move.items()
    ]
    attached = [
        types.make(
            "moveit_msgs/msg/AttachedCollisionObject",
            link_name=item.link,
            touch_links=list(item.touch_links),
            object=_added(types, header, item.name, item.shape)
            if item.shape is not None
            else types.make(
                COLLISION_OBJECT, header=header, id=item.name, operation=types.octet(REMOVE)
            ),
        )
        for item in changes.held
    ]
    return types.make(
        PLANNING_SCENE,
        is_diff=True,
        robot_state=types.make(
            "moveit_msgs/msg/RobotState", is_diff=True, attached_collision_objects=attached
        ),
        world=types.make("moveit_msgs/msg/PlanningSceneWorld", collision_objects=objects),
    )


def _added(types: MessageTypes, header: Any, name: str, shape: Box | Mesh) -> Any:
    """Return a CollisionObject that adds or replaces a shape."""
    fields = _shape_fields(types, shape)
    return types.make(
        COLLISION_OBJECT, header=header, id=name, operation=types.octet(ADD), **fields
    )


def _shape_fields(types: MessageTypes, shape: Box | Mesh) -> dict[str, Any]:
    """Return the fields of a CollisionObject with a shape and its pose."""
    if isinstance(shape, Box):
        x, _, z = shape.size.tolist()
        kind = SOLID_CYLINDER if shape.is_round else SOLID_BOX
        lengths = types.array("f8", np.array([z, 0.5 * x]) if shape.is_round else shape.size)
        solid = types.make("shape_msgs/msg/SolidPrimitive", type=kind, dimensions=lengths)
        return {
            "pose": pose_message(types, shape.T_map_box),
            "primitives": [solid],
            "primitive_poses": [pose_message(types, np.eye(4))],
        }
    mesh = types.make(
        "shape_msgs/msg/Mesh",
        triangles=[
            types.make("shape_msgs/msg/MeshTriangle", vertex_indices=np.uint32(corners))
            for corners in shape.triangles
        ],
        vertices=types.rows("geometry_msgs/msg/Point", shape.vertices),
    )
    return {"meshes": [mesh], "mesh_poses": [pose_message(types, np.eye(4))]}
