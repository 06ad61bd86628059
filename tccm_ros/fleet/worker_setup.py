"""Setup of a local worker, called by Dask's `distributed.worker.preload`."""

from __future__ import annotations

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Ignore interrupts from the terminal, which reach all processes.

    The main process ends its workers itself; an interrupted worker would print a traceback.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
