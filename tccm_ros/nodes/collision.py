"""collision_object: surfaces and objects for MoveIt, if moveit_msgs is installed.

MoveIt's planning scene monitor subscribes to that topic. Objects that have left the map are
removed.
"""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from tccm_ros.nodes.ros_types import is_installed, message_class
from tccm_ros.ros.collision_messages import COLLISION_OBJECT, collision_messages, collision_shapes
from tccm_ros.ros.types import MessageTypes
from tccm_ros.surfaces.scene import Scene

COLLISION_PROFILE = QoSProfile(depth=500, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A late subscriber receives the newest 500 messages in order. Each solution sends all surfaces and
objects, so these include the newest map."""


class CollisionObjects:
    """Publishes the surfaces and objects of each solution to MoveIt.

    Parameters
    ----------
    node, types
        The node and its message classes.
    """

    def __init__(self, node: Node, types: MessageTypes):
        self._types, self._context = types, node.context
        self._shown: frozenset[str] = frozenset()
        self._publisher = None
        if is_installed(COLLISION_OBJECT):
            self._publisher = node.create_publisher(
                message_class(COLLISION_OBJECT), "collision_object", COLLISION_PROFILE
            )

    def publish(self, scene: Scene) -> None:
        """Publish all surfaces except the floor and all objects, unless the node is ending."""
        if self._publisher is None or not self._context.ok():
            return
        shapes = collision_shapes(
            [known.surface for known in scene.surfaces], scene.objects, scene.compartments
        )
        gone = self._shown - shapes.keys()
        for message in collision_messages(
            self._types, scene.stamp_ns, scene.frame_id, shapes, gone
        ):
            self._publisher.publish(message)
        self._shown = frozenset(shapes)
