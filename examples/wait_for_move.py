"""Wait until a table has moved, and say where to."""

import rclpy
from rclpy.node import Node

from tccm_ros.client import MapEvent, SurfaceMapClient

moved: list[MapEvent] = []


def note(event: MapEvent) -> None:
    """Keep a table's move."""
    if event.kind == "moved" and event.label == "table":
        moved.append(event)


rclpy.init()
node = Node("wait_for_move")
surface_map = SurfaceMapClient(node)
surface_map.on_event(note)
while not moved:
    rclpy.spin_once(node)
event = moved[0]
print("table", event.ids_after[0], "from", event.T_before[:2, 3].round(3))
print("to", event.T_after[:2, 3].round(3))
