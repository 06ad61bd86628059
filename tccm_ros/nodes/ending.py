"""The end of a process that was told to stop: how long it may take, and what was saved in it.

The newest solution is saved at once, whatever happens. Then what came last is worked on, solved and
saved, for `WORK_S` and no longer than until the process is told again; `END_S` after the first
signal the process ends in any case, and says what it left out.
"""

from __future__ import annotations

import time

SAME_S = 0.1
"""Signals within this time of the one before are one press: a terminal signals the whole process
group, and launch passes the same on (3 to 20 ms after it on two busy cores)."""

HASTE, HASTE_S = 3, 2.0
"""The third press, or one so long (s) after the first, is of a user who is in a hurry: those who
start a node send a second signal within milliseconds, or after seconds; chosen."""

WORK_S = 5.0
"""Time for what came last to be worked on and solved. Chosen: a drive of half an hour is solved in
3 s."""

END_S = 8.0
"""Time for everything. Chosen: launch kills after 45 s, `docker stop` after 10 s."""


class Ending:
    """When the process has to end, and how its saves went.

    Attributes
    ----------
    saved
        What was saved, a sentence by the name of the node.
    failed
        Why a save failed, by the name of the node.
    left_out
        What was not worked on, by the name of the node.
    """

    def __init__(self) -> None:
        self._start_s: float | None = None
        self._last_s = 0.0
        self._presses = 0
        self.is_hurried = False
        self.saved: dict[str, str] = {}
        self.failed: dict[str, str] = {}
        self.left_out: dict[str, str] = {}

    def begin(self) -> Ending:
        """Count the time from now on, unless it is counted already."""
        if self._start_s is None:
            self._start_s = time.monotonic()
        return self

    def note_signal(self, now_s: float) -> None:
        """Note that the process was told to stop, at a time of `time.monotonic`."""
        self._start_s = now_s if self._start_s is None else self._start_s
        if not self._presses or now_s - self._last_s > SAME_S:
            self._presses += 1
            is_late = now_s - self._start_s > HASTE_S
            self.is_hurried = self.is_hurried or is_late or self._presses >= HASTE
        self._last_s = now_s

    @property
    def is_told(self) -> bool:
        """Whether the process was told to stop."""
        return self._start_s is not None

    @property
    def is_over(self) -> bool:
        """Whether what came last is not waited for any more."""
        return self.is_hurried or self._elapsed_s > WORK_S

    @property
    def left_s(self) -> float:
        """Time until the process ends in any case, s."""
        return max(END_S - self._elapsed_s, 0.0)

    @property
    def _elapsed_s(self) -> float:
        return 0.0 if self._start_s is None else time.monotonic() - self._start_s

    @property
    def why(self) -> str:
        """Why what came last was not waited for."""
        return "told again to stop" if self.is_hurried else f"not done within {WORK_S:g} s"

    @property
    def status(self) -> int:
        """The exit status: 1 where a save failed."""
        return 1 if self.failed else 0

    def sentence(self) -> str:
        """Return what was saved, what not, and what was left out."""
        parts = [f"saved {text}" for text in self.saved.values()]
        parts += [f"not saved: {text}" for text in self.failed.values()]
        parts += [f"left out: {text}" for text in self.left_out.values()]
        return "; ".join(parts) or "nothing was saved"
