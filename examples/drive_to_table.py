"""Drive to a counter, back off, and drive to where a mug can be put down on a table."""

import rclpy
from rclpy.node import Node
from tccm_interfaces.msg import SurfaceFilter

from tccm_ros.client import SurfaceMapClient

MUG = (0.10, 0.10, 0.12)

rclpy.init()
node = Node("drive_to_table")
surface_map = SurfaceMapClient(node)
while not (surface_map.is_ready and surface_map.can_approach):
    rclpy.spin_once(node, timeout_sec=0.1)


def answer(asked):
    """Return what was asked for; RequestError says why the base did not get there."""
    rclpy.spin_until_future_complete(node, asked)
    return asked.result()


print(answer(surface_map.approach(SurfaceFilter(labels=["counter"]))).message.message)
print(f"{answer(surface_map.retreat(0.3)):.2f} m back")
place = answer(surface_map.find_placements(MUG, SurfaceFilter(labels=["table"]), max_count=1))[0]
table = SurfaceFilter(ids=[place.surface_id])
there = answer(surface_map.approach(table, spot=place.T_map_object[:2, 3]))
print(f"{there.distance:.2f} m from where the mug goes; moved: {there.has_moved}")
surface_map.close()
