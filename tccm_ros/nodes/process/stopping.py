"""Stop signals of a node: SIGINT, SIGTERM and SIGHUP, once or repeatedly.

The interpreter notes each signal when it arrives, also during a long call, and a thread handles it.
No signal raises an exception during a save, as the handlers of rclpy and Python would.
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
from typing import NoReturn

from tccm_ros.nodes.process.ending import END_S, Ending

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C in a terminal, a process manager, a closed terminal or ssh session."""


def stopping_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that stop this process; under `nohup` without SIGHUP, which it ignores."""
    is_kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return tuple(n for n in SIGNALS if n != signal.SIGHUP or not is_kept)


class StopSignals:
    """Handles the stop signals of this process until its end.

    Parameters
    ----------
    on_first
        Called at the first signal, in a separate thread.

    Attributes
    ----------
    ending
        Deadlines of the shutdown; at the last one the process exits in any case.
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
    def is_asked(self) -> bool:
        """Whether the process was asked to stop."""
        return self.ending.is_asked

    def ignore(self) -> None:
        """Ignore signals from now on, because only the exit is left.

        The interpreter restores the default handlers before it has ended. A signal at that moment
        would kill the process, with an exit status that reports a loss.
        """
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    def _run(self) -> None:
        while numbers := self._reader.recv(16):
            for number in numbers:
                if number in self._numbers:
                    self._take(number)

    def _take(self, number: int) -> None:
        is_first = not self.is_asked
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


def leave(status: int) -> NoReturn:
    """End the process at once, with its threads."""
    with suppress(OSError):
        sys.stdout.flush()
    os._exit(status)


def say(text: str) -> None:
    """Print a line on stderr, which may be closed with the terminal."""
    with suppress(OSError):
        print(f"tccm: {text}", file=sys.stderr, flush=True)


def _leave_terminal() -> None:
    """Redirect stdout and stderr to /dev/null if their terminal is closed; writing would fail."""
    for number in (1, 2):
        with suppress(OSError):
            if stat.S_ISCHR(os.fstat(number).st_mode) and not os.isatty(number):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, number)
                os.close(nowhere)
