"""One sensor of a robot: its records wait here until they can be posed, and are counted."""

from __future__ import annotations

from collections import Counter, deque
from typing import Any

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.robot.frames import FrameTree
from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.mount import Mount
from tccm_ros.robot.stamp_guard import ANOTHER_CLOCK
from tccm_ros.robot.streams import Stream
from tccm_ros.robot.tracks import Track

MAX_COMPANIONS = 50
"""Companions of a sensor's records that are kept (`Stream.companion`): those of two seconds."""


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
    received, posed
        Records that came, and those that were posed.
    longest_ns
        Longest time span of a record so far.
    awaited
        The track that the oldest record waits for, and how many samples it had heard of then.
    """

    def __init__(self, stream: Stream, config: Config, frames: FrameTree, joints: JointTracks):
        self.stream = stream
        self.mount = Mount(config, stream.mount, frames, joints)
        self.waiting: deque[Any] = deque()
        self.dropped: Counter[str] = Counter()
        self.received = 0
        self.posed = 0
        self.longest_ns = 0
        self.awaited: tuple[Track, int] | None = None
        self._companions: deque[Any] = deque(maxlen=MAX_COMPANIONS)
        self._newest_ns: int | None = None
        self._clock_jump_ns = round(config.clock_jump * 1e9)

    @property
    def problem(self) -> FrameError | None:
        """Why the sensor could not be placed, None where it could."""
        return self.mount.problem

    def add(self, record: Any) -> None:
        """Have a record wait, or drop it: stamps must increase."""
        reason = self.stream.rejection_reason(record) or self._fault_of_stamp(record.stamp_ns)
        if reason is not None:
            self.refuse(reason)
            return
        self.received += 1
        self._newest_ns = record.stamp_ns
        start_ns, end_ns = self.stream.time_span(record)
        self.longest_ns = max(self.longest_ns, end_ns - start_ns)
        self.waiting.append(record)
        if len(self.waiting) > self.stream.max_waiting:
            self.drop("overload")

    def _fault_of_stamp(self, stamp_ns: int) -> str | None:
        """Return why a record with this stamp is refused, None where it is not."""
        if self._newest_ns is None or stamp_ns > self._newest_ns:
            return None
        if stamp_ns == self._newest_ns:
            return "duplicate stamp"
        is_far_back = stamp_ns < self._newest_ns - self._clock_jump_ns
        return ANOTHER_CLOCK if is_far_back else "out of order"

    def add_companion(self, record: Any) -> None:
        """Keep what comes beside the records, in the order of stamps."""
        if not self._companions or record.stamp_ns > self._companions[-1].stamp_ns:
            self._companions.append(record)

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
        self.waiting.popleft()
        self.awaited = None
        self.dropped[reason] += 1

    def clear_samples(self) -> None:
        """Forget everything that has a stamp: the clock jumped."""
        if self.waiting:
            self.dropped["clock jump"] += len(self.waiting)
        self.waiting.clear()
        self._companions.clear()
        self.awaited = self._newest_ns = None
        self.mount.clear_samples()
