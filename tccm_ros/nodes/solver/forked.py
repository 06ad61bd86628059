"""The solver process, forked from the node before the node has threads.

Both import the same libraries. Pages that neither writes are in memory once: a process that is
started later has 100 MB of its own.
"""

from __future__ import annotations

import gc
import os
import select
import signal
import subprocess
import sys
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection

from tccm_ros.nodes.process.stopping import SIGNALS

COMMON = "tccm_ros.nodes.solver.solver"
"""Module whose imports the node and the solver process both need. None of them is rclpy, whose
libraries start threads."""

PROCESS = "tccm_ros.nodes.solver.process"
"""Module that the process runs. The node does not import it: gtsam alone takes 39 MB."""


class ForkedProcess:
    """A forked child process, with the methods of `subprocess.Popen` that `Solver` and `end` call.

    Parameters
    ----------
    pid
        Id of the process.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._handle = os.pidfd_open(pid)
        self._is_over = False

    def wait(self, timeout: float | None = None) -> None:
        """Return when the process has ended; raise TimeoutExpired after a timeout, s."""
        if self._is_over:
            return
        if not select.select([self._handle], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(PROCESS, timeout or 0.0)
        os.waitpid(self.pid, 0)
        os.close(self._handle)
        self._is_over = True

    def kill(self) -> None:
        """Kill the process."""
        if not self._is_over:
            signal.pidfd_send_signal(self._handle, signal.SIGKILL)


_prepared: list[tuple[ForkedProcess, Connection]] = []


def prepare() -> None:
    """Fork the process for the first `Solver` of this process; there must be no threads yet."""
    import_module(COMMON)
    ours, theirs = Pipe()
    gc.collect()
    gc.freeze()  # so that no collection writes to pages of both
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        theirs.close()
        _prepared.append((ForkedProcess(pid), ours))
        return
    try:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        os.setpgid(0, 0)  # Ctrl-C in a terminal is for the node
        ours.close()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        import_module(PROCESS).serve(theirs)
    finally:
        os._exit(1)


def take_prepared() -> tuple[ForkedProcess, Connection] | None:
    """Return the forked process and the connection to it, once; None if there is none."""
    return _prepared.pop() if _prepared else None
