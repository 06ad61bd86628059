"""What tells a node to stop: SIGINT and SIGTERM, once or more often.

Each signal is noted where the interpreter receives it, also while a long call runs, and a thread of
its own acts on it. None raises in the midst of a save: rclpy's handlers, and Python's, would.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable

SIGNALS = (signal.SIGINT, signal.SIGTERM)

HASTE = 3
"""So many signals within `HASTE_S` end the process at once."""

HASTE_S = 2.0
"""Those who start a node send a second signal within milliseconds, or after seconds; chosen."""


class StopSignals:
    """Counts the signals that tell this process to stop, from now until its end.

    Parameters
    ----------
    on_first
        Called at the first one, in a thread of its own.
    note
        Returns what has been saved, a sentence; empty: nothing.
    """

    def __init__(self, on_first: Callable[[], None], note: Callable[[], str]):
        self._on_first, self._note = on_first, note
        self._times: list[float] = []
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        for number in SIGNALS:
            signal.signal(number, lambda *_: None)
        threading.Thread(target=self._run, name="signals", daemon=True).start()

    @property
    def is_told(self) -> bool:
        """Whether the process was told to stop."""
        return bool(self._times)

    @property
    def is_pressed(self) -> bool:
        """Whether the process was told again, later than those do who send a signal twice."""
        return bool(self._times) and self._times[-1] - self._times[0] > HASTE_S

    def ignore(self) -> None:
        """Ignore signals from now on: nothing is left but to end.

        The interpreter restores the default of what it handles before it has ended; a signal in
        that moment would kill the process, with a status that says that something was lost.
        """
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)

    def _run(self) -> None:
        while numbers := self._reader.recv(16):
            for number in numbers:
                if number in SIGNALS:
                    self._count()

    def _count(self) -> None:
        self._times.append(time.monotonic())
        if len(self._times) == 1:
            self._on_first()
        recent = self._times[-HASTE:]
        if len(recent) == HASTE and recent[-1] - recent[0] <= HASTE_S:
            note = self._note()
            end = f"what was saved is an earlier state: {note}" if note else "nothing was saved"
            print(f"tccm: ended by the {HASTE}rd signal, {end}", file=sys.stderr, flush=True)
            os._exit(1)
