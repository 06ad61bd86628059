"""Stamps that can be trusted: message time, outliers, and jumps of the clock.

Message time is the newest stamp on any input. One wrong stamp must not move it: a record far ahead
of its stream is held until the stream's next record tells whether the stream went there. Whether
records are admitted depends on the order within each stream alone, not on how streams interleave.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

MAX_STREAMS = 1024
"""Streams that are distinguished; the records of further ones are refused. Chosen: more
publishers than any robot has."""

MAX_BEHIND = 1000
"""Records of one stream that are held while it is not clear whether the clock went back. Chosen:
10 s at 100 Hz."""

ANOTHER_CLOCK = "another clock"
"""Why the records of a stream are refused that went back while the others went on."""

T = TypeVar("T")


@dataclass(slots=True)
class Admission(Generic[T]):
    """What became of a record and of those held before it.

    Attributes
    ----------
    admitted
        Records to use now, in the order of their stream.
    refused
        Records not to use, each with the reason.
    jumped_ns
        By how much the clock jumped back, 0 where it did not: all samples from before are void,
        `admitted` is what came since.
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
    """Admits records by stamp.

    Parameters
    ----------
    clock_jump_ns
        A step larger than this, forward or backward, is no reordering.
    """

    def __init__(self, clock_jump_ns: int):
        self._jump_ns = clock_jump_ns
        self._streams: dict[Hashable, _Stream[T]] = {}
        self._someone_behind = False

    def admit(
        self, key: Hashable, stamp_ns: int, record: T, *, keeps_time: bool = True
    ) -> Admission[T]:
        """Decide what becomes of one record, and of those that were held before it.

        Parameters
        ----------
        key
            The stream.
        stamp_ns
            Stamp of the record.
        record
            Returned in the admission as it is, now or with a later record of the stream.
        keeps_time
            Whether message time follows this stream.
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
        """Admit a record that nothing has to be weighed for, as nearly all are.

        Returns
        -------
        False where `admit` has to decide on the record; nothing has changed then.
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
        """Return message time as the stream `key` should see it, None before the first record.

        It is the newest stamp of any stream. Of the other streams, a single one that is ahead of
        the rest by more than a clock jump has a clock of its own and does not count.
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
        """Admit what is held: the input has ended."""
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
        """Note that time goes on in one stream, which may be the last that was behind."""
        stream.went_on = stream.keeps_time
        self._someone_behind = any(s.behind for s in self._streams.values())
        if not self._someone_behind:
            for other in self._streams.values():
                other.went_on = False

    def _look_back(self, stream: _Stream[T], result: Admission[T]) -> None:
        """Decide whether all inputs went back, or this stream alone, or nothing yet."""
        # What keeps no time is no witness: our own map -> odom has the stamp of the last scan.
        heard = [s for s in self._streams.values() if s.newest_ns is not None]
        streams = [s for s in heard if s.keeps_time] or heard
        top_ns = max(s.newest_ns for s in streams if s.newest_ns is not None)
        live = [
            s for s in streams if s.newest_ns is not None and s.newest_ns >= top_ns - self._jump_ns
        ]
        records = sum(len(s.behind) for s in streams)
        first_ns, last_ns = stream.behind[0][0], stream.behind[-1][0]
        lasting = abs(last_ns - first_ns) > self._jump_ns or len(stream.behind) >= MAX_BEHIND
        # Who went on and then went back as well is no witness: streams go back one after the other.
        alone = any(s.went_on for s in streams) or not any(s is stream for s in streams)
        if (records > 1 and all(s.behind for s in live)) or (lasting and not alone):
            self._jump(top_ns - last_ns, result)
        elif lasting:
            stream.newest_ns = last_ns
            self._refuse_behind(stream, ANOTHER_CLOCK, result)
            self._someone_behind = any(s.behind for s in self._streams.values())

    def _jump(self, back_ns: int, result: Admission[T]) -> None:
        """Begin again with the records that went back."""
        result.jumped_ns = back_ns
        self._someone_behind = False
        for stream in self._streams.values():
            if stream.ahead is not None:
                result.refused.append((stream.ahead[1], "clock jump"))
            stream.ahead = stream.newest_ns = None
            back, stream.behind, stream.went_on = stream.behind, [], False
            for stamp_ns, record in back:
                self._admit(stream, stamp_ns, record, result)
