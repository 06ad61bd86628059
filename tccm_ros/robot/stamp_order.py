"""Reorder the stamps of a stream: where a gap indicates a missing record, wait for it.

A network may deliver records out of order. If no record is missing before a record, none can be
late, and it is used at once. After a gap it waits until the stream's own stamps have advanced by a
window. An ordered stream thus has no latency, and admission depends on the order within the stream
only, not on the interleaving of streams.
"""

from __future__ import annotations

from bisect import insort
from collections import deque

RECENT = 32
"""Number of recent steps for the shortest step. Chosen: a second of a laser."""

KNOWN = 8
"""Minimum number of steps for the period. Chosen."""

GAP = 1.5
"""A step of more than this multiple of the shortest step may lack a record: one record less makes
two steps."""

LATE, TWICE, ZERO = "out of order", "duplicate stamp", "stamp of 0"
"""Reasons of a refusal."""


class StampOrder:
    """Orders the stamps of one stream.

    Parameters
    ----------
    window_ns
        Maximum delay of a late record, in stamps of the stream; 0 for no reordering.
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
        """The latest stamp added; None before the first."""
        return self._open[-1] if self._open else self._final_ns

    @property
    def period_ns(self) -> int | None:
        """The median step between stamps; None while unknown."""
        steps = sorted(self._steps)
        return steps[len(steps) // 2] if len(steps) >= KNOWN else None

    def add(self, stamp_ns: int) -> str | None:
        """Add a stamp; return why it is refused, None if it is not."""
        if stamp_ns == self._final_ns or stamp_ns in self._open:
            return TWICE if stamp_ns else ZERO
        if self._final_ns is not None and stamp_ns < self._final_ns:
            return LATE
        insort(self._open, stamp_ns)
        while self._open and self._is_sure(self._open[0]):
            self.make_final(self._open[0])
        return None

    def is_final(self, stamp_ns: int) -> bool:
        """Return whether no later addition can precede a stamp that was added."""
        return self._final_ns is not None and stamp_ns <= self._final_ns

    def make_final(self, stamp_ns: int) -> None:
        """Stop waiting for stamps before this one."""
        while self._open and self._open[0] <= stamp_ns:
            next_ns = self._open.pop(0)
            if self._final_ns is not None:
                self._steps.append(next_ns - self._final_ns)
            self._final_ns = next_ns

    def _is_sure(self, stamp_ns: int) -> bool:
        """Return whether no late stamp can belong before the first open stamp."""
        if self._open[-1] - stamp_ns >= self._window_ns:
            return True
        if self._final_ns is None or len(self._steps) < KNOWN:
            return False
        return stamp_ns - self._final_ns < GAP * min(self._steps)
