"""The originals of the window in one place, so that kernels find any of them by one index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tccm_ros.mapping.part import PartMap

__all__ = ["Originals"]


class Originals:
    """Moments and lengths of all part maps in the window, in a ring that is reused.

    Attributes
    ----------
    moments, lengths
        int64 (M, 10) and int32 (M,): rows of a part map follow each other.
    """

    def __init__(self) -> None:
        self.moments = np.zeros((0, 10), np.int64)
        self.lengths = np.zeros(0, np.int32)
        self._first: dict[int, tuple[int, int]] = {}

    def add(self, part: PartMap, others: Sequence[PartMap]) -> PartMap | None:
        """Take a part map in; `others` are those that stay, oldest first.

        Returns
        -------
        PartMap | None
            The same part map with its moments in the ring, so that they are kept once; None if
            there is no room.
        """
        self._first = {p.cycle: self._first[p.cycle] for p in others}
        row = self._room_for(len(part))
        if row is None:
            return None
        end = row + len(part)
        self.moments[row:end] = part.moments
        np.subtract(part.bounds[:, 1], part.bounds[:, 0], out=self.lengths[row:end])
        self._first[part.cycle] = (row, end)
        return replace(part, moments=self.moments[row:end])

    def adopt(self, parts: Sequence[PartMap]) -> list[PartMap]:
        """Take all part maps of a window in, with room for as many again."""
        rows = 2 * sum(len(p) for p in parts) + 1024
        moments = [np.array(p.moments) for p in parts]
        self.moments, self.lengths = np.zeros((rows, 10), np.int64), np.zeros(rows, np.int32)
        self._first = {}
        taken: list[PartMap] = []
        for part, own in zip(parts, moments, strict=True):
            kept = self.add(replace(part, moments=own), taken)
            assert kept is not None
            taken.append(kept)
        return taken

    def first_rows(self, parts: Sequence[PartMap]) -> NDArray[np.int64]:
        """Return the first row of each cycle, from the oldest part map's on."""
        if not parts:
            return np.zeros(1, np.int64)
        first = np.zeros(parts[-1].cycle - parts[0].cycle + 1, np.int64)
        for part in parts:
            first[part.cycle - parts[0].cycle] = self._first[part.cycle][0]
        return first

    def _room_for(self, rows: int) -> int | None:
        """Return where so many rows fit between the newest and the oldest, None if nowhere."""
        size, spans = len(self.moments), [s for s in self._first.values() if s[1] > s[0]]
        if not spans:
            return 0 if rows <= size else None
        tail, head = spans[0][0], spans[-1][1]
        if head > tail:
            if head + rows <= size:
                return head
            return 0 if rows <= tail else None
        return head if head + rows <= tail else None
