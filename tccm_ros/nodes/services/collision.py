"""planning_scene and collision_object: the map for MoveIt, if moveit_msgs is installed.

MoveIt's planning scene monitor subscribes to both topics. planning_scene has the changes of each
solution and of the objects of newer tilt cycles, collision_object all shapes. ~/set_scene_object
takes objects out of both.
"""

from __future__ import annotations

from threading import Lock
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from tccm_ros.nodes.interfaces import has_interfaces, offer_service
from tccm_ros.nodes.ros_types import is_installed, message_class
from tccm_ros.ros.collision_messages import (
    COLLISION_OBJECT,
    PLANNING_SCENE,
    collision_messages,
    planning_scene_message,
)
from tccm_ros.ros.types import MessageTypes
from tccm_ros.scene.planning_shapes import scene_shapes
from tccm_ros.scene.published_scene import ObjectState, PublishedScene, SceneChanges
from tccm_ros.scene.scene import Scene

COLLISION_PROFILE = QoSProfile(depth=2000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A late subscriber receives the newest 2000 messages in order. Each solution sends all shapes, so
these include the newest map."""

CHANGES_PROFILE = QoSProfile(depth=100)
"""Reliable and volatile: an old change means nothing to a late subscriber, who receives all shapes
with the next solution."""


class CollisionObjects:
    """Publishes the surfaces and objects of each solution to MoveIt.

    Parameters
    ----------
    node, types
        The node and its message classes.
    """

    def __init__(self, node: Node, types: MessageTypes):
        self._types, self._context = types, node.context
        self._lock, self._scene = Lock(), PublishedScene()
        self._stamp_ns, self._frame_id = 0, ""
        self._shown: frozenset[str] = frozenset()
        self._listeners = 0
        self._objects = self._changes = None
        if is_installed(COLLISION_OBJECT):
            self._objects = node.create_publisher(
                message_class(COLLISION_OBJECT), "collision_object", COLLISION_PROFILE
            )
        if is_installed(PLANNING_SCENE):
            self._changes = node.create_publisher(
                message_class(PLANNING_SCENE), "planning_scene", CHANGES_PROFILE
            )
            if has_interfaces():
                offer_service(node, "SetSceneObject", "~/set_scene_object", self._set_state)

    @property
    def has_listeners(self) -> bool:
        """Whether anybody subscribes to the planning scene or to collision objects."""
        publishers = self._objects, self._changes
        return any(p is not None and p.get_subscription_count() for p in publishers)

    def publish(self, scene: Scene) -> None:
        """Publish all surfaces except the floor and all objects, unless the node is ending."""
        if (self._objects is None and self._changes is None) or not self._context.ok():
            return
        surfaces = [known.surface for known in scene.surfaces]
        shapes = scene_shapes(surfaces, scene.objects, scene.compartments, scene.unseen)
        with self._lock:
            self._stamp_ns, self._frame_id = scene.stamp_ns, scene.frame_id
            self._publish_changes(self._scene.update(shapes))
            self._publish_objects()

    def _publish_objects(self) -> None:
        """Publish each shape of the world, and the removal of those that were in it before."""
        if self._objects is None:
            return
        shapes = self._scene.shapes
        gone, self._shown = self._shown - shapes.keys(), frozenset(shapes)
        for message in collision_messages(
            self._types, self._stamp_ns, self._frame_id, shapes, gone
        ):
            self._objects.publish(message)

    def _publish_changes(self, changes: SceneChanges) -> None:
        """Publish changes; everything if there is a new subscriber."""
        if self._changes is None:
            return
        listeners = self._changes.get_subscription_count()
        if listeners > self._listeners:
            everything = self._scene.repeat()
            put_down = [item for item in changes.held if item.shape is None]
            changes = SceneChanges(everything.diff, (*put_down, *everything.held))
        self._listeners = listeners
        if changes:
            self._changes.publish(
                planning_scene_message(self._types, self._stamp_ns, self._frame_id, changes)
            )

    def _set_state(self, request: Any, _: Any) -> str:
        """Answer ~/set_scene_object."""
        links = request.link_name, tuple(request.touch_links)
        with self._lock:
            changes = self._scene.set_state(request.object_id, request.state, *links)
            self._publish_changes(changes)
        state = ObjectState(request.state).name.lower().replace("_", " ")
        return f"object {request.object_id} is {state}"
