"""Run nodes until a stop signal: exit status 0, no half-written files."""

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
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.process.stopping import StopSignals, leave, say
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.start import leave_at_a_signal

RCLError = rclpy_implementation.RCLError
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError
ARGUMENT_ERRORS = (RCLError, rclpy_implementation.RCLInvalidROSArgsError)

USAGE = (
    "usage: NODE [--ros-args [-p group.key:=value] [--params-file FILE] [-r from:=to] "
    "[-r __ns:=/robot1]]; `tccm parameters` prints every parameter"
)


def run(*factories: Callable[[], Node], usage: str = USAGE) -> None:
    """Spin the nodes in one executor until SIGINT, SIGTERM, SIGHUP or an error.

    A signal before all nodes are created ends the process at once. The exit status is 1 after an
    error, which is printed in one line, and after a failed save at the end.

    Parameters
    ----------
    factories
        Create the nodes after rclpy is initialised. If a node has a `close` method, it is called
        before the node is destroyed. If it has `interrupt`, that is called at the first signal, in
        another thread. The run ends when all nodes have `is_done` set.
    usage
        Help text, for ``--help`` and wrong arguments.
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
            # A multi-threaded executor takes 0.5 ms more for each callback and has no benefit here.
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
    status = max(status, ending.status)
    if any(isinstance(node, SensorNode) and node.is_loading for node in nodes):
        leave(status)  # the thread would go on compiling, or crash the interpreter
    sys.exit(status)


def _init(usage: str) -> None:
    """Initialise rclpy; exit with one line if an argument or a parameter file is wrong.

    rclpy ignores unknown arguments: ``--help`` or a typing error would start a node.
    """
    try:
        words = remove_ros_args(sys.argv)[1:]
        if words:
            _explain(words[0], usage)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except UnknownROSArgsError as error:  # its text is a list of the unknown arguments
        _explain(str(error).strip("[]").partition(",")[0].strip("'"), usage)
    except ARGUMENT_ERRORS as error:
        reason = str(error).removeprefix("failed to initialize rcl: ").partition(", at /")[0]
        print(f"tccm: {' '.join(reason.split())}; {_first_line(usage)}", file=sys.stderr)
        sys.exit(1)


def _first_line(usage: str) -> str:
    return usage.partition("\n")[0]


def _explain(word: str, usage: str) -> NoReturn:
    """Exit with the usage, because of an argument that is not a ROS argument."""
    if word in ("-h", "--help"):
        print(usage)
        sys.exit(0)
    print(f"tccm: {word!r} is no argument of a node; {_first_line(usage)}", file=sys.stderr)
    sys.exit(2)


def _handle_signals(nodes: Sequence[Node], executor: SingleThreadedExecutor) -> StopSignals:
    """Install signal handlers that end the spinning; from now on there is data to save.

    The context stays valid, so that closing the nodes in order does not fail half-way.
    """

    def wake() -> None:
        for node in nodes:
            if hasattr(node, "interrupt"):
                node.interrupt()
        executor.wake()

    return StopSignals(wake)


def _forget_start() -> None:
    """Exclude the objects of modules and compiled kernels from garbage collection.

    They live until the end, and each collection of them would take 0.1 s during a cycle.
    """
    gc.collect()
    gc.freeze()


def _spin(nodes: Sequence[Node], executor: SingleThreadedExecutor, signals: StopSignals) -> None:
    for node in nodes:
        executor.add_node(node)
    is_running = executor.context.ok
    while is_running() and not signals.is_asked:
        if all(getattr(node, "is_done", False) for node in nodes):
            return
        try:
            executor.spin_once(timeout_sec=1.0)
        except RCLError:
            if is_running():
                raise


def _close(nodes: Sequence[Node], ending: Ending) -> None:
    """Save the newest results of all nodes, then process their last input and close them."""
    for node in nodes:
        if isinstance(node, SensorNode):
            node.save_quickly(ending)
    for node in nodes:
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            if isinstance(node, SensorNode):
                node.close(ending)
                if node.is_loading:
                    continue
            elif hasattr(node, "close"):
                node.close()
            node.destroy_node()
    if ending.failed or ending.left_out:
        say(ending.sentence())
