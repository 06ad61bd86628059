"""The area below furniture, for Nav2's costmaps, if nav2_msgs is installed.

The keepout filter takes a mask and its CostmapFilterInfo; the vector object server, which later
distributions than Jazzy have, takes a polygon per surface.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from rclpy.node import Node

from tccm_ros.nodes.qos import latched_qos
from tccm_ros.nodes.ros_types import is_installed, message_class
from tccm_ros.records import Surface
from tccm_ros.results.keepout_mask import obstructing
from tccm_ros.ros.types import MessageTypes, header_message
from tccm_ros.scene.scene import Scene

FILTER_INFO = "nav2_msgs/msg/CostmapFilterInfo"
KEEPOUT_FILTER = 0
"""Type of the keepout filter in CostmapFilterInfo."""

OCCUPIED = 100
"""Value of cells that the base must not enter, as in nav_msgs/OccupancyGrid."""


def tell_keepout_info(node: Node, mask_topic: str) -> None:
    """Publish ``~/keepout_info`` of a mask once, latched, if nav2_msgs is installed."""
    if not is_installed(FILTER_INFO):
        return
    kind = message_class(FILTER_INFO)
    publisher = node.create_publisher(kind, "~/keepout_info", latched_qos())
    mask = node.resolve_topic_name(mask_topic)
    info = kind(type=KEEPOUT_FILTER, filter_mask_topic=mask, base=0.0, multiplier=1.0)
    publisher.publish(info)


class VectorShapes:
    """Sends the outlines of furniture to the vector object server, where it is there.

    Parameters
    ----------
    node, types
        Node of the clients, and its message classes.
    """

    def __init__(self, node: Node, types: MessageTypes):
        self._types, self._context = types, node.context
        self._shown: dict[int, Any] = {}
        self._add: Any = None
        if not is_installed(FILTER_INFO):
            return
        self._services: Any = import_module("nav2_msgs.srv")
        if hasattr(self._services, "AddShapes"):
            server, services = "vector_object_server", self._services
            self._add = node.create_client(services.AddShapes, f"{server}/add_shapes")
            self._remove = node.create_client(services.RemoveShapes, f"{server}/remove_shapes")

    def send(self, scene: Scene) -> None:
        """Add or replace the polygons of all surfaces but the floor; remove those that are gone."""
        if self._add is None or not self._context.ok() or not self._add.service_is_ready():
            return
        header = header_message(self._types, scene.stamp_ns, scene.frame_id)
        surfaces = obstructing([known.surface for known in scene.surfaces], scene.floor_z)
        polygons = {surface.id: self._polygon(surface, header) for surface in surfaces}
        gone = [self._shown[number] for number in sorted(self._shown.keys() - polygons.keys())]
        if gone:
            self._remove.call_async(self._services.RemoveShapes.Request(uuids=gone))
        if polygons:
            request = self._services.AddShapes.Request(polygons=list(polygons.values()))
            self._add.call_async(request)
        self._shown = {number: polygon.uuid for number, polygon in polygons.items()}

    def _polygon(self, surface: Surface, header: Any) -> Any:
        """Return the outline of a surface; its UUID is the same in each run."""
        polygon = self._types.make(
            "nav2_msgs/msg/PolygonObject",
            header=header,
            points=self._types.rows("geometry_msgs/msg/Point32", surface.boundary),
            closed=True,
            value=OCCUPIED,
        )
        polygon.uuid.uuid = list(uuid5(NAMESPACE_URL, f"tccm_surface_{surface.id}").bytes)
        return polygon
