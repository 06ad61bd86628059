"""One sensor of a robot: queues its records until they can be posed, and counts them."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace
from typing import Any

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.robot.frames import FrameTree
from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.mount import Mount
from tccm_ros.robot.stamp_guard import ANOTHER_CLOCK
from tccm_ros.robot.stamp_order import LATE, StampOrder
from tccm_ros.robot.streams import Stream
from tccm_ros.robot.tracks import Track

MAX_COMPANIONS = 50
"""Maximum number of stored companions (`Stream.companion`): those of two seconds."""

TOO_LONG = "lasts longer than the time between stamps: look at the unit of its times"
"""Reason of a drop: time_increment, or the times of points, are in a wrong unit."""

AT_ONCE = "times of points are ignored: they are far from the stamp for the time between stamps"
"""Remark on records of which all measurements are taken to be at the stamp."""

TOO_SHORT = "times of points span less than 1 % of the time between stamps: look at their unit"
"""Remark on records whose times may be in a wrong unit."""

PERIODS = 4.0, 0.01
"""Maximum and minimum duration of a record as multiples of the step between stamps; wrong units are
off by 1000."""


class Sensor:
    """A queue of the records of one stream, in stamp order.

    Parameters
    ----------
    stream
        The stream.
    config, frames, joints
        Configuration and robot data for the mount.

    Attributes
    ----------
    mount
        Pose of the sensor on the robot.
    waiting
        Records that are not posed yet.
    dropped
        Number of records that were not posed, by reason.
    remarks
        Number of used but unusual records, by remark.
    received, posed
        Number of records received and posed.
    longest_ns
        Longest duration of a record so far.
    awaited
        The track that the oldest record waits for, and its number of samples at that time.
    """

    def __init__(self, stream: Stream, config: Config, frames: FrameTree, joints: JointTracks):
        self.stream = stream
        self.mount = Mount(config, stream.mount, frames, joints, can_be_base=stream.can_be_base)
        self.waiting: deque[Any] = deque()
        self.dropped: Counter[str] = Counter()
        self.remarks: Counter[str] = Counter()
        self.received = 0
        self.posed = 0
        self.longest_ns = 0
        self.awaited: tuple[Track, int] | None = None
        self._clean = stream.make_cleaner()
        self._companions: deque[Any] = deque()
        self._order = StampOrder(round(config.reorder_window * 1e9))
        self._clock_jump_ns = round(config.clock_jump * 1e9)

    @property
    def problem(self) -> FrameError | None:
        """Error of the sensor's mount; None if there is none."""
        return self.mount.problem

    def add(self, record: Any) -> None:
        """Queue a record in stamp order, or drop it."""
        record, cleaned = self._clean(record)
        reason = self.stream.rejection_reason(record) or self._fault_of_stamp(record.stamp_ns)
        if reason is not None:
            self.refuse(reason)
            return
        self.received += 1
        self.remarks.update(r for r in (cleaned, self.stream.remark(record)) if r is not None)
        in_time = self._in_time(record)
        if in_time is None:
            self.dropped[TOO_LONG] += 1
            return
        record = in_time
        start_ns, end_ns = self.stream.time_span(record)
        period_ns = self._order.period_ns
        if period_ns is not None and 0 < end_ns - start_ns < PERIODS[1] * period_ns:
            self.remarks[TOO_SHORT] += 1
        self.longest_ns = max(self.longest_ns, end_ns - start_ns)
        place = len(self.waiting)
        while place and self.waiting[place - 1].stamp_ns > record.stamp_ns:
            place -= 1
        self.waiting.insert(place, record)
        self.awaited = self.awaited if place else None
        if len(self.waiting) > self.stream.max_waiting:
            self.drop("overload")

    def _fault_of_stamp(self, stamp_ns: int) -> str | None:
        """Return why a record with this stamp is refused; None if it is not."""
        newest_ns, reason = self._order.newest_ns, self._order.add(stamp_ns)
        if reason is None or newest_ns is None:
            return None
        is_far_back = reason == LATE and stamp_ns < newest_ns - self._clock_jump_ns
        return ANOTHER_CLOCK if is_far_back else reason

    def _in_time(self, record: Any) -> Any | None:
        """Return a record whose measurements are as near its stamp as the steps between stamps say.

        Where they are not, all are taken to be at the stamp, or None is returned. `longest_ns` is
        then corrected for such records from before the steps were known.
        """
        start_ns, end_ns = self.stream.time_span(record)
        span_ns = max(end_ns, record.stamp_ns) - min(start_ns, record.stamp_ns)
        period_ns = self._order.period_ns
        if period_ns is None or span_ns <= PERIODS[0] * period_ns:
            return record
        self.longest_ns = min(self.longest_ns, round(PERIODS[0] * period_ns))
        if self.stream.at_once is None:
            return None
        self.remarks[AT_ONCE] += 1
        return self.stream.at_once(record)

    def check_times(self) -> bool:
        """Return whether the oldest waiting record can be used, now that more stamps are known."""
        record = self._in_time(self.waiting[0])
        if record is None:
            return False
        self.waiting[0] = record
        return True

    @property
    def is_next_overtaken(self) -> bool:
        """Whether a late record may still precede the oldest waiting one."""
        return not self._order.is_final(self.waiting[0].stamp_ns)

    @property
    def awaits_nothing_new(self) -> bool:
        """Whether the track that the oldest record waits for has had no sample since."""
        return self.awaited is not None and self.awaited[0].heard == self.awaited[1]

    def pop(self) -> Any:
        """Remove and return the oldest waiting record."""
        record = self.waiting.popleft()
        self._order.make_final(record.stamp_ns)
        self.awaited = None
        return record

    def add_companion(self, record: Any) -> None:
        """Store a companion record in stamp order; one per stamp."""
        kept = self._companions
        place = len(kept)
        while place and kept[place - 1].stamp_ns > record.stamp_ns:
            place -= 1
        if place and kept[place - 1].stamp_ns == record.stamp_ns:
            return
        kept.insert(place, record)
        if len(kept) > MAX_COMPANIONS:
            kept.popleft()

    def join(self, *, is_last: bool) -> str | None:
        """Join the oldest waiting record with its companion.

        Returns
        -------
        Reason of a drop, ``""`` while it has to wait, None if it is complete.
        """
        companion = self.stream.companion
        if companion is None:
            return None
        joined = companion.join(self.waiting[0], tuple(self._companions), is_last)
        if joined is None or isinstance(joined, str):
            return joined or ""
        self.waiting[0] = joined
        return None

    def refuse(self, reason: str) -> None:
        """Count a record that is dropped before the queue."""
        self.received += 1
        self.dropped[reason] += 1

    def drop(self, reason: str) -> None:
        """Drop the oldest waiting record."""
        self.pop()
        self.dropped[reason] += 1

    def clear_samples(self) -> None:
        """Clear all time-stamped data after a jump of the clock."""
        if self.waiting:
            self.dropped["clock jump"] += len(self.waiting)
        self.waiting.clear()
        # The newest companion stays, as the oldest: it may have been published only once.
        newest = [replace(record, stamp_ns=0) for record in (*self._companions,)[-1:]]
        self._companions = deque(newest)
        self._order.clear()
        self.awaited = None
        self.mount.clear_samples()
