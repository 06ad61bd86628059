"""Run a node until it is told to stop: exit status 0, nothing half-written."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NoReturn

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from tccm_ros.errors import TccmError, one_line
from tccm_ros.nodes.ending import Ending
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.start import leave_at_a_signal
from tccm_ros.nodes.stopping import StopSignals, say

RCLError = rclpy_implementation.RCLError
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError
ARGUMENT_ERRORS = (RCLError, rclpy_implementation.RCLInvalidROSArgsError)

USAGE = (
    "usage: NODE [--ros-args [-p group.key:=value] [--params-file FILE] [-r from:=to] "
    "[-r __ns:=/robot1]]; `tccm parameters` prints every parameter"
)


def run(*factories: Callable[[], Node], usage: str = USAGE) -> None:
    """Spin the nodes in one executor until SIGINT, SIGTERM, SIGHUP or an error.

    A signal before all nodes are made ends the process at once. The exit status is 1 after an
    error, which one line explains, and after a save at the end that failed.

    Parameters
    ----------
    factories
        Make the nodes, after rclpy is initialised. A node with a `close` method has it called
        before it is destroyed; one with `interrupt` has that called, in another thread, at the
        first signal; nodes that all have `is_done` end the run.
    usage
        How the nodes are started, for who asks or errs.
    """
    leave_at_a_signal()
    status = 0
    nodes: list[Node] = []
    signals: StopSignals | None = None
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        _init(usage)
        try:
            nodes.extend(factory() for factory in factories)
            _forget_start()
            # The multi-threaded one takes 0.5 ms more for each callback and gains nothing here.
            executor = SingleThreadedExecutor()
            signals = _handle_signals(nodes, executor)
            _spin(nodes, executor, signals)
        except TccmError as error:
            print(f"tccm: {one_line(error)}", file=sys.stderr)
            status = 1
    ending = Ending() if signals is None else signals.ending
    _close(nodes, ending.begin())
    rclpy.try_shutdown()
    if signals is not None:
        signals.ignore()
    sys.exit(max(status, ending.status))


def _init(usage: str) -> None:
    """Initialise rclpy; end with one line where an argument or a parameter file is wrong.

    rclpy passes over what it does not know: who asks for help, or errs, would get a running node.
    """
    try:
        words = remove_ros_args(sys.argv)[1:]
        if words:
            _explain(words[0], usage)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except UnknownROSArgsError as error:  # its text is the list of them
        _explain(str(error).strip("[]").partition(",")[0].strip("'"), usage)
    except ARGUMENT_ERRORS as error:
        reason = str(error).removeprefix("failed to initialize rcl: ").partition(", at /")[0]
        print(f"tccm: {' '.join(reason.split())}; {_first_line(usage)}", file=sys.stderr)
        sys.exit(1)


def _first_line(usage: str) -> str:
    return usage.partition("\n")[0]


def _explain(word: str, usage: str) -> NoReturn:
    """End with how a node is started, for a word that is no argument of its own."""
    if word in ("-h", "--help"):
        print(usage)
        sys.exit(0)
    print(f"tccm: {word!r} is no argument of a node; {_first_line(usage)}", file=sys.stderr)
    sys.exit(2)


def _handle_signals(nodes: Sequence[Node], executor: SingleThreadedExecutor) -> StopSignals:
    """Have signals end the spinning: from now on there is something to save.

    The context lives on: what is closed in order leaves nothing that fails half-way.
    """

    def wake() -> None:
        for node in nodes:
            if hasattr(node, "interrupt"):
                node.interrupt()
        executor.wake()

    return StopSignals(wake)


def _forget_start() -> None:
    """Have the garbage collector pass over what modules and compiled kernels are made of.

    It lives until the end, and going through it takes 0.1 s each time, in the midst of a cycle.
    """
    gc.collect()
    gc.freeze()


def _spin(nodes: Sequence[Node], executor: SingleThreadedExecutor, signals: StopSignals) -> None:
    for node in nodes:
        executor.add_node(node)
    is_running = executor.context.ok
    while is_running() and not signals.is_told:
        if all(getattr(node, "is_done", False) for node in nodes):
            return
        try:
            executor.spin_once(timeout_sec=1.0)
        except RCLError:
            if is_running():
                raise


def _close(nodes: Sequence[Node], ending: Ending) -> None:
    """Save what there is of every node before one waits for what came last."""
    for node in nodes:
        if isinstance(node, SensorNode):
            node.save_quickly(ending)
    for node in nodes:
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            if isinstance(node, SensorNode):
                node.close(ending)
            elif hasattr(node, "close"):
                node.close()
            node.destroy_node()
    if ending.failed or ending.left_out:
        say(ending.sentence())
