"""Say where on the nearest table a mug can be put down, and where the base stands for it."""

import rclpy
from rclpy.node import Node
from tccm_interfaces.msg import SurfaceFilter
from tccm_interfaces.srv import FindPlacements

from tccm_ros.client import SurfaceMapClient

MUG = (0.10, 0.10, 0.12)
ARM = {"base": FindPlacements.Request.BASE_FIND, "reach": 0.8, "robot_radius": 0.25}

rclpy.init()
node = Node("put_down_mug")
surface_map = SurfaceMapClient(node)
while not (surface_map.is_ready and any(s.label == "table" for s in surface_map.surfaces)):
    rclpy.spin_once(node, timeout_sec=0.1)

tables = SurfaceFilter(labels=["table"])
tables.near.header.frame_id = "base_link"
found = surface_map.find_surfaces(tables, max_count=1)
rclpy.spin_until_future_complete(node, found)
nearest = SurfaceFilter(ids=[found.result()[0].id])

asked = surface_map.find_placements(MUG, nearest, max_count=1, **ARM)
rclpy.spin_until_future_complete(node, asked)
print(asked.result().message)
for place in asked.result():
    print("mug to", place.T_map_object[:3, 3].round(3), "on surface", place.surface_id)
    print("base to", place.T_map_bases[0, :2, 3].round(3))
