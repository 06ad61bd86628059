"""List what stands on every counter and table of the map."""

import rclpy
from rclpy.node import Node

from tccm_ros.client import SurfaceMapClient

rclpy.init()
node = Node("list_counters")
surface_map = SurfaceMapClient(node)
while not surface_map.is_ready:
    rclpy.spin_once(node, timeout_sec=0.1)
for surface in surface_map.surfaces:
    if surface.label in ("counter", "table"):
        print(f"{surface.label} {surface.id} at {surface.height:.2f} m")
        for item in surface_map.objects_on(surface):
            x, y, z = item.T_map_object[:3, 3]
            print(f"  object {item.id} at {x:.2f} {y:.2f} {z:.2f}")
