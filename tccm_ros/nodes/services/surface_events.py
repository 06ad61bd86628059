"""~/events of slam_node: changes of the map between solutions."""

from __future__ import annotations

from rclpy.node import Node

from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.qos import EVENTS_DEPTH
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.surface_messages import SURFACE_EVENT, change_message
from tccm_ros.ros.types import MessageTypes
from tccm_ros.scene.changes import Change, MapChanges
from tccm_ros.scene.scene import Scene


class SurfaceEvents:
    """Publishes ~/events.

    Parameters
    ----------
    node, types
        The node and its message classes.
    """

    def __init__(self, node: Node, types: MessageTypes):
        self._types, self._context = types, node.context
        self._changes = MapChanges()
        self._publisher = (
            node.create_publisher(message_class(SURFACE_EVENT), "~/events", EVENTS_DEPTH)
            if has_interfaces()
            else None
        )

    def forget(self, *, is_map_loaded: bool) -> None:
        """Begin another map; the first scene of a loaded map is not a change."""
        self._changes = MapChanges(is_map_loaded=is_map_loaded)

    def note(self, scene: Scene, agreeing_views: int) -> list[Change]:
        """Publish and return the changes since the previous scene.

        Parameters
        ----------
        scene
            The newest scene.
        agreeing_views
            As for `changes`.
        """
        found = self._changes.note(scene, agreeing_views)
        if self._publisher is not None and self._context.ok():
            for event in found:
                self._publisher.publish(change_message(self._types, scene.frame_id, event))
        return found
