"""Check stamps: message time, outliers, and jumps of the clock.

Message time is the newest stamp on any input. A single wrong stamp must not advance it: a record
far ahead of its stream is held until the stream's next record confirms or refutes it. Admission
depends on the order within each stream only, not on the interleaving of streams.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

MAX_STREAMS = 1024
"""Maximum number of streams; records of further ones are refused. Chosen: more publishers than any
robot has."""

MAX_BEHIND = 1000
"""Maximum number of held records of a stream while it is unclear whether the clock went back.
Chosen: 10 s at 100 Hz."""

ANOTHER_CLOCK = "another clock"
"""Reason of a refusal: this stream went back in time while the others went on."""

T = TypeVar("T")


@dataclass(slots=True)
class Admission(Generic[T]):
    """Decision on a record and on those held before it.

    Attributes
    ----------
    admitted
        Records to use now, in stream order.
    refused
        Records to drop, each with the reason.
    jumped_ns
        Size of a backward jump of the clock, 0 for none: all earlier samples are invalid, and
        `admitted` contains the records after the jump.
    """

    admitted: list[T] = field(default_factory=list)
    refused: list[tuple[T, str]] = field(default_factory=list)
    jumped_ns: int = 0


@dataclass(slots=True)
class _Stream(Generic[T]):
    newest_ns: int | None = None
    ahead: tuple[int, T] | None = None
    behind: list[tuple[int, T]] = field(default_factory=list)
    went_on: bool = False
    keeps_time: bool = True


class StampGuard(Generic[T]):
    """Admits records by their stamps.

    Parameters
    ----------
    clock_jump_ns
        Threshold of a step, forward or backward, above which it is no reordering.
    """

    def __init__(self, clock_jump_ns: int):
        self._jump_ns = clock_jump_ns
        self._streams: dict[Hashable, _Stream[T]] = {}
        self._someone_behind = False

    def admit(
        self, key: Hashable, stamp_ns: int, record: T, *, keeps_time: bool = True
    ) -> Admission[T]:
        """Decide on one record, and on those that were held before it.

        Parameters
        ----------
        key
            Key of the stream.
        stamp_ns
            Stamp of the record.
        record
            Returned unchanged in the admission, now or with a later record of the stream.
        keeps_time
            Whether this stream advances message time.
        """
        result: Admission[T] = Admission()
        stream = self._streams.get(key)
        if stream is None:
            if len(self._streams) >= MAX_STREAMS:
                result.refused.append((record, "too many streams"))
                return result
            stream = self._streams[key] = _Stream(keeps_time=keeps_time)
        self._decide(stream, stamp_ns, record, result)
        return result

    def passes(self, key: Hashable, stamp_ns: int) -> bool:
        """Admit a record without further checks where possible, as for nearly all records.

        Returns
        -------
        False where `admit` has to decide; the state is then unchanged.
        """
        stream = self._streams.get(key)
        if stream is None or stream.ahead is not None or self._someone_behind:
            return False
        newest_ns, jump_ns = stream.newest_ns, self._jump_ns
        if newest_ns is None or not newest_ns - jump_ns <= stamp_ns <= newest_ns + jump_ns:
            return False
        if stamp_ns > newest_ns:
            stream.newest_ns = stamp_ns
        return True

    def now(self, key: Hashable) -> int | None:
        """Return message time for the stream `key`; None before the first record.

        It is the newest stamp of any stream. A single other stream that is ahead of the rest by
        more than a clock jump has another clock, and is ignored.
        """
        own = self._streams.get(key)
        first = second = None
        for stream in self._streams.values():
            newest_ns = stream.newest_ns
            if newest_ns is None or not stream.keeps_time or stream is own:
                continue
            if first is None or newest_ns > first:
                first, second = newest_ns, first
            elif second is None or newest_ns > second:
                second = newest_ns
        if first is not None and second is not None and first > second + self._jump_ns:
            first = second
        if own is None or own.newest_ns is None:
            return first
        return own.newest_ns if first is None else max(first, own.newest_ns)

    def flush(self) -> Admission[T]:
        """Admit held records ahead and refuse those behind, at the end of the input."""
        result: Admission[T] = Admission()
        for stream in self._streams.values():
            if stream.ahead is not None:
                self._admit(stream, *stream.ahead, result)
                stream.ahead = None
            self._refuse_behind(stream, "out of order", result)
        return result

    def _decide(self, stream: _Stream[T], stamp_ns: int, record: T, result: Admission[T]) -> None:
        if stream.ahead is not None:
            held_ns, held = stream.ahead
            stream.ahead = None
            if stamp_ns >= held_ns - self._jump_ns:
                self._admit(stream, held_ns, held, result)
            else:
                result.refused.append((held, "future stamp"))
        if stream.newest_ns is None or stamp_ns > stream.newest_ns + self._jump_ns:
            stream.ahead = (stamp_ns, record)
        elif stamp_ns < stream.newest_ns - self._jump_ns:
            stream.behind.append((stamp_ns, record))
            stream.went_on = False
            self._someone_behind = True
            self._look_back(stream, result)
        else:
            if self._someone_behind:
                self._refuse_behind(stream, "out of order", result)
                self._note_going_on(stream)
            self._admit(stream, stamp_ns, record, result)

    def _admit(self, stream: _Stream[T], stamp_ns: int, record: T, result: Admission[T]) -> None:
        result.admitted.append(record)
        if stream.newest_ns is None or stamp_ns > stream.newest_ns:
            stream.newest_ns = stamp_ns

    def _refuse_behind(self, stream: _Stream[T], reason: str, result: Admission[T]) -> None:
        result.refused.extend((record, reason) for _, record in stream.behind)
        stream.behind.clear()

    def _note_going_on(self, stream: _Stream[T]) -> None:
        """Note that one stream advances, which may have been the last one behind."""
        stream.went_on = stream.keeps_time
        self._someone_behind = any(s.behind for s in self._streams.values())
        if not self._someone_behind:
            for other in self._streams.values():
                other.went_on = False

    def _look_back(self, stream: _Stream[T], result: Admission[T]) -> None:
        """Decide whether all inputs went back, only this stream, or neither yet."""
        # Streams that do not keep time do not count: our own map -> odom repeats the last stamp.
        heard = [s for s in self._streams.values() if s.newest_ns is not None]
        streams = [s for s in heard if s.keeps_time] or heard
        top_ns = max(s.newest_ns for s in streams if s.newest_ns is not None)
        live = [
            s for s in streams if s.newest_ns is not None and s.newest_ns >= top_ns - self._jump_ns
        ]
        records = sum(len(s.behind) for s in streams)
        first_ns, last_ns = stream.behind[0][0], stream.behind[-1][0]
        lasting = abs(last_ns - first_ns) > self._jump_ns or len(stream.behind) >= MAX_BEHIND
        # Streams go back one after the other: one that advanced and then also went back is neutral.
        alone = any(s.went_on for s in streams) or not any(s is stream for s in streams)
        if (records > 1 and all(s.behind for s in live)) or (lasting and not alone):
            self._jump(top_ns - last_ns, result)
        elif lasting:
            stream.newest_ns = last_ns
            self._refuse_behind(stream, ANOTHER_CLOCK, result)
            self._someone_behind = any(s.behind for s in self._streams.values())

    def _jump(self, back_ns: int, result: Admission[T]) -> None:
        """Restart with the records after a backward jump."""
        result.jumped_ns = back_ns
        self._someone_behind = False
        for stream in self._streams.values():
            if stream.ahead is not None:
                result.refused.append((stream.ahead[1], "clock jump"))
            stream.ahead = stream.newest_ns = None
            back, stream.behind, stream.went_on = stream.behind, [], False
            for stamp_ns, record in back:
                self._admit(stream, stamp_ns, record, result)
