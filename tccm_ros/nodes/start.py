"""Entry points of the nodes, with signal handling from the first moment on.

The imports of a node take a second or more, the first compilation of kernels half a minute. Until
the nodes exist there is nothing to save, and a signal ends the process at once with status 0.
"""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from importlib import import_module
from types import FrameType

from tccm_ros.blas import use_one_thread
from tccm_ros.nodes.process.stopping import stopping_signals


def _start(module: str, main: str = "main", *, solves: bool = False) -> None:
    """Run the main function of a module; with `solves`, fork the solver process first."""
    leave_at_a_signal()
    find_wheels()
    use_one_thread()
    if solves:
        import_module("tccm_ros.nodes.solver.forked").prepare()
    getattr(import_module(f"tccm_ros.nodes.{module}"), main)()


tccm_node = partial(_start, "tccm_node")
slam_node = partial(_start, "slam_node", solves=True)
managed_tccm_node = partial(_start, "managed", "main_tccm")
managed_slam_node = partial(_start, "managed", "main_slam", solves=True)
player_node = partial(_start, "player_node")
view_node = partial(_start, "view_node")
approach_node = partial(_start, "approach_node")
all_in_one = partial(_start, "all_in_one", solves=True)


def find_wheels() -> None:
    """Let rclpy find its plugins in this environment if pip has installed ROS into it."""
    known = [path for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]
    index = os.path.join(sys.prefix, "share", "ament_index")
    if os.path.isdir(index) and sys.prefix not in known:
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join([*known, sys.prefix])


def leave_at_a_signal() -> None:
    """Exit on SIGINT, SIGTERM and SIGHUP, until other handlers are installed."""
    for number in stopping_signals():
        signal.signal(number, _leave)


def _leave(number: int, frame: FrameType | None) -> None:
    # An exception could surface in any import as another error, or crash the compiler.
    os._exit(0)
