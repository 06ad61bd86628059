"""One sensor of a robot: its records wait here until they can be posed, and are counted."""

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
"""Companions of a sensor's records that are kept (`Stream.companion`): those of two seconds."""

TOO_LONG = "lasts longer than the time between stamps: look at the unit of its times"
"""Why records are dropped whose time_increment, or whose times of points, are in another unit."""

TOO_SHORT = "times of points span less than 1 % of the time between stamps: look at their unit"
"""What is said of records whose times may be in another unit."""

PERIODS = 4.0, 0.01
"""A record lasts at most and at least so many times the step between stamps: units of times differ
by 1000."""


class Sensor:
    """The records of one stream, in the order of their stamps.

    Parameters
    ----------
    stream
        What the records are.
    config, frames, joints
        What its mount is made of.

    Attributes
    ----------
    mount
        Where the sensor is on the robot.
    waiting
        Records that are not posed yet.
    dropped
        Records that were not posed, by reason.
    remarks
        Records that were taken though something about them is unusual, by what it is.
    received, posed
        Records that came, and those that were posed.
    longest_ns
        Longest time span of a record so far.
    awaited
        The track that the oldest record waits for, and how many samples it had heard of then.
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
        self._companions: deque[Any] = deque()
        self._order = StampOrder(round(config.reorder_window * 1e9))
        self._clock_jump_ns = round(config.clock_jump * 1e9)

    @property
    def problem(self) -> FrameError | None:
        """Why the sensor could not be placed, None where it could."""
        return self.mount.problem

    def add(self, record: Any) -> None:
        """Have a record wait in the order of stamps, or drop it."""
        reason = self.stream.rejection_reason(record) or self._fault_of_stamp(record.stamp_ns)
        if reason is not None:
            self.refuse(reason)
            return
        self.received += 1
        remark = self.stream.remark(record)
        if remark is not None:
            self.remarks[remark] += 1
        start_ns, end_ns = self.stream.time_span(record)
        if self.lasts_too_long(end_ns - start_ns):
            self.dropped[TOO_LONG] += 1
            return
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
        """Return why a record with this stamp is refused, None where it is not."""
        newest_ns, reason = self._order.newest_ns, self._order.add(stamp_ns)
        if reason is None or newest_ns is None:
            return None
        is_far_back = reason == LATE and stamp_ns < newest_ns - self._clock_jump_ns
        return ANOTHER_CLOCK if is_far_back else reason

    def lasts_too_long(self, span_ns: int) -> bool:
        """Return whether a record lasts longer than the steps between stamps leave it time to.

        One that came before the steps were known does not count for `longest_ns` any more.
        """
        period_ns = self._order.period_ns
        if period_ns is None or span_ns <= PERIODS[0] * period_ns:
            return False
        self.longest_ns = min(self.longest_ns, round(PERIODS[0] * period_ns))
        return True

    @property
    def is_next_overtaken(self) -> bool:
        """Whether a record that is late may still come before the oldest that waits."""
        return not self._order.is_final(self.waiting[0].stamp_ns)

    @property
    def awaits_nothing_new(self) -> bool:
        """Whether the track that the oldest record waits for has heard of nothing since."""
        return self.awaited is not None and self.awaited[0].heard == self.awaited[1]

    def pop(self) -> Any:
        """Return the oldest record that waits; it waits no more."""
        record = self.waiting.popleft()
        self._order.make_final(record.stamp_ns)
        self.awaited = None
        return record

    def add_companion(self, record: Any) -> None:
        """Keep what comes beside the records, in the order of stamps; one of each stamp."""
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
        """Give the oldest record that waits what it needs of its companions.

        Returns
        -------
        Why it is dropped, ``""`` where it has to wait, None where it has all that it needs.
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
        """Count a record that does not even wait."""
        self.received += 1
        self.dropped[reason] += 1

    def drop(self, reason: str) -> None:
        """Drop the oldest record that waits."""
        self.pop()
        self.dropped[reason] += 1

    def clear_samples(self) -> None:
        """Forget everything that has a stamp: the clock jumped."""
        if self.waiting:
            self.dropped["clock jump"] += len(self.waiting)
        self.waiting.clear()
        # The newest stays, as older than all that comes: it may have been published once.
        newest = [replace(record, stamp_ns=0) for record in (*self._companions,)[-1:]]
        self._companions = deque(newest)
        self._order.clear()
        self.awaited = None
        self.mount.clear_samples()
