"""Processes that solve, forked from one that has imported their libraries and loaded kernels.

Each slam_node has such a process. One that is started anew imports and loads for two seconds of
processor time; here a worker of the tests does that once.
"""

import gc
import os
import signal
import subprocess
import sys
import tempfile
from functools import cache
from multiprocessing import Pipe, reduction
from multiprocessing.connection import Connection

from tccm_ros.config import Config
from tccm_ros.nodes.process.stopping import SIGNALS
from tccm_ros.nodes.solver.forked import ForkedProcess
from tccm_ros.warm_up.compilation import compile_kernels


class ProcessOfAnother(ForkedProcess):
    """A process that another process has forked, and reaps."""

    def wait(self, timeout: float | None = None) -> None:
        try:
            super().wait(timeout)
        except ChildProcessError:
            os.close(self._handle)
            self._is_over = True


@cache
def _parent() -> tuple[subprocess.Popen, Connection]:
    """Start the process that forks; it ends with this one."""
    compile_kernels(["slam"], Config())  # once for all workers, which wait for it
    ours, theirs = Pipe()
    path = os.pathsep.join(filter(None, sys.path))
    process = subprocess.Popen(
        [sys.executable, __file__, str(theirs.fileno())], pass_fds=[theirs.fileno()],
        env={**os.environ, "PYTHONPATH": path}, stdin=subprocess.DEVNULL, process_group=0,
    )  # fmt: skip
    theirs.close()
    return process, ours


def fork_solver() -> tuple[ForkedProcess, Connection]:
    """Return a process that solves, and the connection to it."""
    process, parent = _parent()
    ours, theirs = Pipe()
    parent.send(dict(os.environ))
    reduction.send_handle(parent, theirs.fileno(), process.pid)
    theirs.close()
    return ProcessOfAnother(parent.recv()), ours


def _fork_on_request(requests: Connection) -> None:
    """Fork a process for each connection that is sent, until the other end is closed."""
    from tccm_ros.bags.typestore import TypestoreMessages
    from tccm_ros.nodes.solver.process import serve
    from tccm_ros.warm_up import drive

    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # reaps
    drive.warm_up(Config())
    TypestoreMessages()  # imports the message definitions
    gc.collect()
    gc.freeze()
    while True:
        try:
            environment, handle = requests.recv(), reduction.recv_handle(requests)
        except (EOFError, OSError):
            return
        pid = os.fork()
        if not pid:
            requests.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.setpgid(0, 0)
            os.environ.clear()
            os.environ.update(environment)
            tempfile.tempdir = None
            serve(Connection(handle))
        os.close(handle)
        requests.send(pid)


if __name__ == "__main__":
    _fork_on_request(Connection(int(sys.argv[1])))
