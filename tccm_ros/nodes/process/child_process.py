"""Child processes of a node, each at the other end of a pipe."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Protocol

from tccm_ros.nodes.process.stopping import SIGNALS

NICENESS = 5
"""Priority below tracking, for machines with fewer cores than processes. Chosen."""

EXIT_S = 0.5
"""Time for a process to exit on its own, s. Chosen: it holds no data that could be lost."""


class Process(Protocol):
    """A child process, as of `subprocess.Popen`."""

    def wait(self, timeout: float | None = None) -> object:
        """Wait for the exit, or raise `subprocess.TimeoutExpired`."""

    def kill(self) -> None:
        """Kill the process."""


def spawn(module: str) -> tuple[subprocess.Popen[bytes], Connection]:
    """Run a module with the descriptor of a pipe; return the process and the node's end."""
    ours, theirs = Pipe()
    # A process group of its own, because Ctrl-C in a terminal is for the node. It stays in the
    # node's session: schedulers that group by session weigh its lower priority against the node.
    process = subprocess.Popen(
        [sys.executable, "-m", module, str(theirs.fileno())],
        pass_fds=[theirs.fileno()],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdin=subprocess.DEVNULL,
        process_group=0,
    )
    theirs.close()
    return process, ours


def end(process: Process) -> None:
    """Wait for the exit of a process whose pipe was shut down; kill it after `EXIT_S`."""
    try:
        process.wait(EXIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def yield_to_node() -> None:
    """In the child: ignore stop signals, which are for the node, and run at a lower priority."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    os.nice(NICENESS)
