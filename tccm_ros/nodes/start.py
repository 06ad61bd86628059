"""Entry points of the nodes: a signal ends them quietly from the first moment on.

What a node imports takes a second and more, kernels that are compiled for the first time half a
minute. Until its nodes are there, nothing is to be saved and nothing half-written: it just ends,
with status 0.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module
from types import FrameType

from tccm_ros.nodes.stopping import stopping_signals


def tccm_node() -> None:
    """Run tccm_node."""
    _start("tccm_node")


def slam_node() -> None:
    """Run slam_node."""
    _start("slam_node")


def managed_tccm_node() -> None:
    """Run tccm_node for a lifecycle manager."""
    _start("managed_tccm_node")


def managed_slam_node() -> None:
    """Run slam_node for a lifecycle manager."""
    _start("managed_slam_node")


def player_node() -> None:
    """Run player_node."""
    _start("player_node")


def view_node() -> None:
    """Run view_node."""
    _start("view_node")


def approach_node() -> None:
    """Run approach_node."""
    _start("approach_node")


def all_in_one() -> None:
    """Run tccm_node and slam_node in one process."""
    _start("all_in_one")


def _start(name: str) -> None:
    leave_at_a_signal()
    find_wheels()
    import_module(f"tccm_ros.nodes.{name}").main()


def find_wheels() -> None:
    """Have rclpy find its plugins in this environment, where pip has installed ROS into it."""
    known = [path for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]
    index = os.path.join(sys.prefix, "share", "ament_index")
    if os.path.isdir(index) and sys.prefix not in known:
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join([*known, sys.prefix])


def leave_at_a_signal() -> None:
    """Have SIGINT, SIGTERM and SIGHUP end the process, until they are handled otherwise."""
    for number in stopping_signals():
        signal.signal(number, _leave)


def _leave(number: int, frame: FrameType | None) -> None:
    # An exception would come out of any import as anything, and crash the compiler.
    os._exit(0)
