"""What tells a node to stop: SIGINT, SIGTERM and SIGHUP, once or more often.

Each signal is noted where the interpreter receives it, also while a long call runs, and a thread of
its own acts on it. None raises in the midst of a save: rclpy's handlers, and Python's, would.
"""

from __future__ import annotations

import os
import signal
import socket
import stat
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from tccm_ros.nodes.ending import END_S, Ending

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""A terminal's Ctrl-C, a manager, a terminal (ssh session) that is gone."""


def stopping_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that stop this process: not a hang-up under `nohup`, which ignores it."""
    is_kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return tuple(n for n in SIGNALS if n != signal.SIGHUP or not is_kept)


class StopSignals:
    """Takes the signals that tell this process to stop, from now until its end.

    Parameters
    ----------
    on_first
        Called at the first one, in a thread of its own.

    Attributes
    ----------
    ending
        When the process has to end; it ends then, whatever it does.
    """

    def __init__(self, on_first: Callable[[], None]):
        self._on_first = on_first
        self.ending = Ending()
        self._numbers = stopping_signals()
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        for number in self._numbers:
            signal.signal(number, lambda *_: None)
        threading.Thread(target=self._run, name="signals", daemon=True).start()

    @property
    def is_told(self) -> bool:
        """Whether the process was told to stop."""
        return self.ending.is_told

    def ignore(self) -> None:
        """Ignore signals from now on: nothing is left but to end.

        The interpreter restores the default of what it handles before it has ended; a signal in
        that moment would kill the process, with a status that says that something was lost.
        """
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    def _run(self) -> None:
        while numbers := self._reader.recv(16):
            for number in numbers:
                if number in self._numbers:
                    self._take(number)

    def _take(self, number: int) -> None:
        is_first = not self.is_told
        self.ending.note_signal(time.monotonic())
        if number == signal.SIGHUP:
            _leave_terminal()
        if is_first:
            threading.Thread(target=self._end_in_time, name="ending", daemon=True).start()
            self._on_first()

    def _end_in_time(self) -> None:
        while left_s := self.ending.left_s:
            time.sleep(left_s)
        say(f"not done {END_S:g} s after the signal, ended now; {self.ending.sentence()}")
        os._exit(self.ending.status)


def say(text: str) -> None:
    """Print a line for the user, who may be gone with the terminal."""
    with suppress(OSError):
        print(f"tccm: {text}", file=sys.stderr, flush=True)


def _leave_terminal() -> None:
    """Write to nowhere where the terminal is gone: each line would be an error."""
    for number in (1, 2):
        with suppress(OSError):
            if stat.S_ISCHR(os.fstat(number).st_mode) and not os.isatty(number):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, number)
                os.close(nowhere)
