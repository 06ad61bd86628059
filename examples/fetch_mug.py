"""Fetch a mug from kitchen/counter and put it on living/table, wherever that stands by then."""

import rclpy
from rclpy.node import Node

from tccm_ros.client import SurfaceMapClient

rclpy.init()
node = Node("fetch_mug")
surface_map = SurfaceMapClient(node)
while not surface_map.can_approach:
    rclpy.spin_once(node, timeout_sec=0.1)


def answer(asked):
    """Return what was asked for; RequestError says why the base did not get there."""
    rclpy.spin_until_future_complete(node, asked)
    return asked.result()


for name, task in (("kitchen/counter", "take the mug"), ("living/table", "put the mug down")):
    print(f"{name} is {answer(surface_map.resolve_name(name)).surface.label}", flush=True)
    there = answer(surface_map.approach(name=name))
    print(f"gap {there.gap:.3f} m, {there.distance:.3f} m to the spot, moved: {there.has_moved}")
    # Here the arm acts: the spot is within its reach.
    print(task, flush=True)
    answer(surface_map.retreat(0.3))
surface_map.close()
