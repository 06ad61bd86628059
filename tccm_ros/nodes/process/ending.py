"""Shutdown of the process: its time limits, and a record of the saves.

The newest solution is saved at once. Then the input received last is processed, solved and saved,
for at most `WORK_S` and until the user signals again. `END_S` after the first signal the process
exits in any case and reports the input that was left out.
"""

from __future__ import annotations

import time

SAME_S = 0.1
"""Signals closer than this are one key press: a terminal signals the whole process group, and
launch passes the same signal on (3 to 20 ms later on two busy cores)."""

IMPATIENT_PRESSES, IMPATIENT_S = 3, 2.0
"""Number of key presses, or time after the first (s), that mean an impatient user. Chosen:
launchers send a second signal within milliseconds or after several seconds."""

WORK_S = 5.0
"""Time to process and solve the input received last. Chosen: the solution of a half-hour drive
takes 3 s."""

END_S = 8.0
"""Time until the process exits. Chosen: launch kills after 45 s, `docker stop` after 10 s."""


class Ending:
    """Deadlines of a shutdown, and the results of its saves.

    Attributes
    ----------
    saved
        Sentences about successful saves, by node name.
    failed
        Reasons of failed saves, by node name.
    left_out
        Input that was not processed, by node name.
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
        """Start the deadline, unless it is running already."""
        if self._start_s is None:
            self._start_s = time.monotonic()
        return self

    def note_signal(self, now_s: float) -> None:
        """Note a stop signal at a time of `time.monotonic`, s."""
        self._start_s = now_s if self._start_s is None else self._start_s
        if not self._presses or now_s - self._last_s > SAME_S:
            self._presses += 1
            is_late = now_s - self._start_s > IMPATIENT_S
            self.is_hurried = self.is_hurried or is_late or self._presses >= IMPATIENT_PRESSES
        self._last_s = now_s

    @property
    def is_asked(self) -> bool:
        """Whether the process was asked to stop."""
        return self._start_s is not None

    @property
    def is_over(self) -> bool:
        """Whether the time to process the input received last is over."""
        return self.is_hurried or self._elapsed_s > WORK_S

    @property
    def left_s(self) -> float:
        """Time until the process exits in any case, s."""
        return max(END_S - self._elapsed_s, 0.0)

    @property
    def _elapsed_s(self) -> float:
        return 0.0 if self._start_s is None else time.monotonic() - self._start_s

    @property
    def why(self) -> str:
        """Reason why the input received last was not processed."""
        return "asked again to stop" if self.is_hurried else f"not done within {WORK_S:g} s"

    @property
    def status(self) -> int:
        """Exit status: 1 if a save failed."""
        return 1 if self.failed else 0

    def sentence(self) -> str:
        """Return the saves, failed saves and omissions as one sentence."""
        parts = [f"saved {text}" for text in self.saved.values()]
        parts += [f"not saved: {text}" for text in self.failed.values()]
        parts += [f"left out: {text}" for text in self.left_out.values()]
        return "; ".join(parts) or "nothing was saved"
