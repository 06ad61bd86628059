"""Delay of planning scene changes over DDS, in the simulator's changing rooms.

    python bench/bench_scene_diffs.py [--robot fetch] [--rate 1]

`all_in_one` maps the recording, played by player_node. Printed are the times at
which messages were sent (the stamps of DDS), relative to the message that caused them: a change of
the planning scene after the solution with its stamp; after the objects of the tilt cycle with its
stamp; and a solution after the objects of a tilt cycle that it contains.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from moveit_msgs.msg import PlanningScene
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from tccm_interfaces.msg import SurfaceMap

from tccm_sim.options import Options
from tccm_sim.recording import simulate

DOMAIN = os.environ.get("ROS_DOMAIN_ID", "78")
OBJECTS = "tccm_object_"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LAST_S = 8.0
"""Time without a message after the end of the recording, s."""

Sent = dict[int, float]
"""Time of sending, s, by the stamp of a message, ns."""


@contextmanager
def running(name: str, **parameters: object) -> Iterator[subprocess.Popen[bytes]]:
    """Have a node of the package run; it is told to stop at the end."""
    values = [w for k, v in parameters.items() for w in ("-p", f"{k}:={v}")]
    start = f"from tccm_ros.nodes.start import {name}; {name}()"
    words = ["-c", start, "--ros-args", "--log-level", "error", *values]
    process = subprocess.Popen([sys.executable, *words])
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


class Heard:
    """Times at which cycles, solutions and changes of the scene were sent."""

    def __init__(self, node: Node):
        self.cycles: Sent = {}
        self.solutions: Sent = {}
        self.changes: Sent = {}
        self.objects = 0
        self.count = 0
        listen: Callable[..., Any] = node.create_subscription
        for kind, topic, sent, profile in (
            (PointCloud2, "/tccm/object_boxes", self.cycles, QoSProfile(depth=50)),
            (SurfaceMap, "/surface_slam/surface_map", self.solutions, LATCHED),
            (PlanningScene, "/planning_scene", self.changes, QoSProfile(depth=100)),
        ):
            listen(kind, topic, lambda m, info, to=sent: self._note(m, info, to), profile)

    def _note(self, message: Any, info: dict[str, Any], sent: Sent) -> None:
        self.count += 1
        if isinstance(message, PlanningScene):
            items = message.world.collision_objects
            self.objects += sum(item.id.startswith(OBJECTS) for item in items)
            header = items[0].header if items else message.robot_state.joint_state.header
        else:
            header = message.header
        stamp_ns = header.stamp.sec * 10**9 + header.stamp.nanosec
        sent.setdefault(stamp_ns, 1e-9 * info["source_timestamp"])


def row(name: str, delays: list[float]) -> str:
    """Return a row of the table, of delays in s."""
    if not delays:
        return f"| {name} | 0 | | | |"
    ms = 1000.0 * np.array(delays)
    median, high = np.quantile(ms, [0.5, 0.9])
    return f"| {name} | {len(ms)} | {median:.0f} | {high:.0f} | {ms.max():.0f} |"


def main() -> None:
    """Play, listen, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", help="a robot with a depth camera; by default one with a laser")
    parser.add_argument("--rate", type=float, default=1.0, help="of the recording to the clock")
    args = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    rclpy.init()
    node = Node("listener")
    heard = Heard(node)
    with tempfile.TemporaryDirectory() as folder:
        bag = simulate("changing", Path(folder) / "bag", options=Options(robot=args.robot))
        player = {"bag": bag, "wait_for_subscribers": 300.0, "rate": args.rate}
        with running("all_in_one"), running("player_node", **player) as played:
            while played.poll() is None:
                rclpy.spin_once(node, timeout_sec=0.1)
            before = -1
            while heard.count > before:
                before, end = heard.count, time.monotonic() + LAST_S
                while time.monotonic() < end:
                    rclpy.spin_once(node, timeout_sec=0.1)
    rclpy.shutdown()
    changes = [heard.changes[k] - heard.solutions[k] for k in heard.changes if k in heard.solutions]
    seen = [heard.changes[k] - heard.cycles[k] for k in heard.changes if k in heard.cycles]
    cycles = [
        min(sent for stamp, sent in heard.solutions.items() if stamp >= cycle) - at
        for cycle, at in heard.cycles.items()
        if max(heard.solutions) >= cycle
    ]
    print(f"{heard.objects} changes of objects")
    print("| delay, ms | count | median | 90 % | largest |")
    print("|---|---|---|---|---|")
    print(row("change of the scene after its solution", changes))
    print(row("change of the scene after the objects of its cycle", seen))
    print(row("solution after the objects of a cycle", cycles))


if __name__ == "__main__":
    main()
