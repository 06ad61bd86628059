"""Which records of a stream may still be overtaken: where stamps leave a gap, one may be late.

A network may deliver records in another order than they were sent in. Where none is missing before
a record, no late one can belong there, and it is used at once. After a gap it waits until the
stream's own stamps are further by a window. So an orderly stream waits for nothing, and what is
admitted depends on the order within the stream alone, not on how streams interleave.
"""

from __future__ import annotations

from bisect import insort
from collections import deque

RECENT = 32
"""Steps between stamps from which the shortest is taken. Chosen: a second of a laser."""

KNOWN = 8
"""Steps from which the period is known. Chosen."""

GAP = 1.5
"""A step of so many of the shortest steps may miss a record: one more takes two of them."""

LATE, TWICE, ZERO = "out of order", "duplicate stamp", "stamp of 0"
"""Why stamps are refused."""


class StampOrder:
    """Puts the stamps of one stream in order.

    Parameters
    ----------
    window_ns
        Stamps that are later by this much than another are not overtaken by it; 0: by nothing.
    """

    def __init__(self, window_ns: int):
        self._window_ns = window_ns
        self.clear()

    def clear(self) -> None:
        """Forget all stamps."""
        self._final_ns: int | None = None
        self._open: list[int] = []
        self._steps: deque[int] = deque(maxlen=RECENT)

    @property
    def newest_ns(self) -> int | None:
        """The latest stamp that was added, None before the first."""
        return self._open[-1] if self._open else self._final_ns

    @property
    def period_ns(self) -> int | None:
        """The usual step between stamps, None while it is not known."""
        steps = sorted(self._steps)
        return steps[len(steps) // 2] if len(steps) >= KNOWN else None

    def add(self, stamp_ns: int) -> str | None:
        """Add a stamp; return why it is refused, None where it is not."""
        if stamp_ns == self._final_ns or stamp_ns in self._open:
            return TWICE if stamp_ns else ZERO
        if self._final_ns is not None and stamp_ns < self._final_ns:
            return LATE
        insort(self._open, stamp_ns)
        while self._open and self._is_sure(self._open[0]):
            self.make_final(self._open[0])
        return None

    def is_final(self, stamp_ns: int) -> bool:
        """Return whether no stamp that is added later can come before one that was added."""
        return self._final_ns is not None and stamp_ns <= self._final_ns

    def make_final(self, stamp_ns: int) -> None:
        """Wait for nothing before a stamp any more."""
        while self._open and self._open[0] <= stamp_ns:
            next_ns = self._open.pop(0)
            if self._final_ns is not None:
                self._steps.append(next_ns - self._final_ns)
            self._final_ns = next_ns

    def _is_sure(self, stamp_ns: int) -> bool:
        """Return whether none that is late can belong before the first open stamp."""
        if self._open[-1] - stamp_ns >= self._window_ns:
            return True
        if self._final_ns is None or len(self._steps) < KNOWN:
            return False
        return stamp_ns - self._final_ns < GAP * min(self._steps)
