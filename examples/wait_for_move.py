"""Wait until a surface has moved or is gone, and say where to: wait_for_move.py [LABEL [SIGN]]."""

import sys

import rclpy
from rclpy.node import Node

from tccm_ros.client import MapEvent, SurfaceMapClient

label, sign = (*sys.argv[1:], *("table", "")[len(sys.argv) - 1 :])

rclpy.init()
node = Node("wait_for_move")
surface_map = SurfaceMapClient(node)
events: list[MapEvent] = []
surface_map.on_event(events.append)
meant: set[int] = set()
told: list[MapEvent] = []
while not told:
    rclpy.spin_once(node)
    labelled = [s for s in surface_map.surfaces if s.label == label]
    meant.update(s.id for s in labelled if sign in ("", *s.near_signs))
    told = [e for e in events if e.kind in ("moved", "gone") and meant & {*e.ids_before}]

event = told[0]
print(label, event.ids_before[0], event.kind, "from", event.T_before[:2, 3].round(3))
if event.T_after is not None:
    print("to", event.T_after[:2, 3].round(3))
