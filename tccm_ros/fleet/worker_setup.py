"""What a worker of this machine does when it starts, by Dask's `distributed.worker.preload`."""

from __future__ import annotations

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Leave an interrupt of the terminal, which all processes get, to the process that asked.

    It ends its workers itself; one that is interrupted prints a traceback.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
