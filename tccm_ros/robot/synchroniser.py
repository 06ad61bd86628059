"""Scans in stamp order: records are admitted, scans wait until they can be posed."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.records import (
    JointSample,
    Odometry,
    PosedScan,
    RobotDescription,
    Scan,
    TransformSample,
)
from tccm_ros.robot import LaserKinematics
from tccm_ros.robot.base_motion import BaseMotion
from tccm_ros.robot.posing import Posing
from tccm_ros.robot.stamp_guard import StampGuard

__all__ = ["MAX_WAITING", "SyncRecord", "Synchroniser"]

#: Scans that wait at one time; the oldest is dropped when there are more.
MAX_WAITING = 1000

#: A scan that takes longer than this is malformed, s.
MAX_SCAN_TIME = 60.0

#: Key of the scans among the streams.
SCAN_STREAM = "scan"

SyncRecord = RobotDescription | JointSample | TransformSample | Odometry | Scan

Float64 = NDArray[np.float64]


class Synchroniser:
    """Gives the scans of one laser their poses.

    Parameters
    ----------
    config
        `sync_timeout` and `clock_jump` are used.
    kinematics
        Of the same laser; the synchroniser feeds it.
    expects_odometry
        Whether there is an odometry topic: scans without odometry are then dropped. Otherwise,
        where no odometry has come within `sync_timeout` of the first scan, the base moves as tf
        says or, without tf, stands still.

    Attributes
    ----------
    dropped
        Scans by reason.
    counts
        ``scans`` received, ``posed``, and refused samples as ``samples: <reason>``.
    odometry
        What the last call admitted of the odometry, in order.
    longest_scan_ns
        Longest duration of a scan so far.
    jumps
        Times that poses began anew: the clock went back, or odometry came after all. The owner
        compares it and resets its map.
    """

    def __init__(
        self, config: Config, kinematics: LaserKinematics, *, expects_odometry: bool = False
    ):
        self.dropped: Counter[str] = Counter()
        self.counts: Counter[str] = Counter()
        self.jumps = 0
        self.odometry: list[Odometry] = []
        self.longest_scan_ns = 0
        self.kinematics = kinematics
        self.expects_odometry = expects_odometry
        self._posing = Posing(config, kinematics)
        self._guard: StampGuard[Scan | JointSample | TransformSample | Odometry] = StampGuard(
            round(config.clock_jump * 1e9)
        )
        self._waiting: list[tuple[int, int, Scan]] = []
        self._order = 0
        self._newest_scan_ns: int | None = None

    @property
    def motion(self) -> BaseMotion:
        """How the base moves."""
        return self._posing.motion

    @property
    def problem(self) -> FrameError | None:
        """Why the laser could not be placed, None where it could."""
        return self.kinematics.problem

    @property
    def message_ns(self) -> int | None:
        """Message time: the newest stamp that can be trusted, None before the first record."""
        return self._guard.now(SCAN_STREAM)

    def add(self, record: SyncRecord) -> list[PosedScan]:
        """Take one record; return the scans that are posed now, in stamp order.

        Raises
        ------
        UrdfError
            For a robot description that cannot be read.
        """
        self.odometry = []
        if isinstance(record, RobotDescription):
            self.kinematics.add(record)
            return self._release()
        if not _usable(record):
            self._refuse(record, "malformed")
            return self._release()
        if isinstance(record, TransformSample) and record.is_static:
            self.kinematics.add(record)
            return self._release()
        stream = _stream(record)
        if self._guard.passes(stream, record.stamp_ns):
            self._take(record)
            return self._release()
        admission = self._guard.admit(
            stream,
            record.stamp_ns,
            record,
            keeps_time=not isinstance(record, TransformSample),
        )
        if admission.jumped:
            self._start_again()
        for refused, reason in admission.refused:
            self._refuse(refused, reason)
        for admitted in admission.admitted:
            self._take(admitted)
        return self._release()

    def flush(self) -> list[PosedScan]:
        """Give what can be posed; drop the rest. The input has ended."""
        self.odometry = []
        admission = self._guard.flush()
        for refused, reason in admission.refused:
            self._refuse(refused, reason)
        for admitted in admission.admitted:
            self._take(admitted)
        return self._release(ended=True)

    def tilt_samples(self) -> list[tuple[int, float]]:
        """Return the new tilt samples; see `LaserKinematics.tilt_samples`."""
        return self.kinematics.tilt_samples()

    def _take(self, record: Scan | JointSample | TransformSample | Odometry) -> None:
        if isinstance(record, Scan):
            self._take_scan(record)
            return
        late = self.kinematics.add(record)
        if isinstance(record, Odometry):
            if self.motion.mode in ("tf", "still"):
                self.jumps += 1
                self.kinematics.forget_base()
            late = not self.motion.add(record)
            self.odometry.append(record)
        if late:
            self.counts["samples: out of order"] += late

    def _take_scan(self, scan: Scan) -> None:
        self.counts["scans"] += 1
        reason = _malformed(scan)
        if reason is None and self._newest_scan_ns is not None:
            if scan.stamp_ns == self._newest_scan_ns:
                reason = "duplicate stamp"
            elif scan.stamp_ns < self._newest_scan_ns:
                reason = "out of order"
        if reason is not None:
            self.dropped[reason] += 1
            return
        self._newest_scan_ns = scan.stamp_ns
        self.longest_scan_ns = max(self.longest_scan_ns, abs(scan.end_ns - scan.stamp_ns))
        self._order += 1
        heapq.heappush(self._waiting, (scan.stamp_ns, self._order, scan))
        if len(self._waiting) > MAX_WAITING:
            heapq.heappop(self._waiting)
            self.dropped["overload"] += 1

    def _refuse(self, record: Scan | JointSample | TransformSample | Odometry, reason: str) -> None:
        if isinstance(record, Scan):
            self.counts["scans"] += 1
            self.dropped[reason] += 1
        else:
            self.counts[f"samples: {reason}"] += 1

    def _start_again(self) -> None:
        self.jumps += 1
        self.dropped["clock jump"] += len(self._waiting)
        self._waiting.clear()
        self._newest_scan_ns = None
        self._posing.clear_samples()

    def _release(self, *, ended: bool = False) -> list[PosedScan]:
        posed: list[PosedScan] = []
        while self._waiting:
            outcome = self._posing.judge(
                self._waiting[0][2],
                self._guard.now(SCAN_STREAM),
                ended=ended,
                expects_odometry=self.expects_odometry,
            )
            if outcome is None:
                break
            heapq.heappop(self._waiting)
            if isinstance(outcome, str):
                self.dropped[outcome] += 1
            else:
                self.counts["posed"] += 1
                posed.append(outcome)
        return posed

    def T_odom_base(self, stamp_ns: int) -> Float64 | None:
        """Return T_odom_base float64 (4, 4) at a stamp, None where nothing brackets it."""
        return self._posing.T_odom_base(stamp_ns)


def _stream(record: Scan | JointSample | TransformSample | Odometry) -> Hashable:
    if isinstance(record, JointSample):
        return ("joints", record.names)
    if isinstance(record, TransformSample):
        return ("tf", record.child)
    return SCAN_STREAM if isinstance(record, Scan) else "odometry"


def _usable(record: Scan | JointSample | TransformSample | Odometry) -> bool:
    """Return whether a pose is a number (joint positions are looked at one by one)."""
    if isinstance(record, TransformSample):
        numbers = record.T_parent_child.ravel()
    elif isinstance(record, Odometry):
        numbers = record.T_odom_base.ravel()
    else:
        return True
    return math.isfinite(numbers.dot(numbers))


def _malformed(scan: Scan) -> str | None:
    if len(scan.ranges) == 0:
        return "empty"
    numbers = (scan.angle_min, scan.angle_increment, scan.time_increment)
    if not all(math.isfinite(number) for number in numbers):
        return "malformed"
    if abs(scan.time_increment) * len(scan.ranges) > MAX_SCAN_TIME:
        return "malformed"
    return None
