"""Scans with their poses, in stamp order, however the topics interleave.

A scan is given as soon as odometry and all joints between base and laser bracket it; samples
further apart than half of `sync_timeout` do not. Until then it waits in message time: at least
`sync_timeout`, and longer only while what it waits for is late but still comes. What cannot be
posed is dropped whole and counted by reason; nothing is extrapolated. So topics may arrive
`sync_timeout / 2` apart, and it does not show in what is given.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.kinematics import LaserKinematics
from tccm_ros.kinematics.base_motion import BaseMotion
from tccm_ros.kinematics.chain import Chain, JointReading
from tccm_ros.kinematics.tracks import Track
from tccm_ros.records import (
    JointSample,
    Odometry,
    PosedScan,
    RobotDescription,
    Scan,
    TransformSample,
)
from tccm_ros.stamps import StampGuard

__all__ = ["MAX_WAITING", "SyncRecord", "Synchroniser"]

#: Scans that wait at one time; the oldest is dropped when there are more.
MAX_WAITING = 1000

#: A scan that takes longer than this is malformed, s.
MAX_SCAN_TIME = 60.0

#: Key of the scans among the streams.
SCAN_STREAM = "scan"

SyncRecord = RobotDescription | JointSample | TransformSample | Odometry | Scan

Int64 = NDArray[np.int64]
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
        self.motion = BaseMotion(config, kinematics.frames)
        self._timeout_ns = round(config.sync_timeout * 1e9)
        self._max_gap_ns = self._timeout_ns // 2
        self._late_joints_ns = max(0, round(-config.rig.joint_time_offset * 1e9))
        self._guard: StampGuard[Scan | JointSample | TransformSample | Odometry] = StampGuard(
            round(config.clock_jump * 1e9)
        )
        self._waiting: list[tuple[int, int, Scan]] = []
        self._order = 0
        self._newest_scan_ns: int | None = None
        self._silence: dict[Track, tuple[int, int]] = {}

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
        self._silence.clear()
        self._newest_scan_ns = None
        self.kinematics.clear_samples()
        self.motion.clear_samples()

    def _release(self, *, ended: bool = False) -> list[PosedScan]:
        posed: list[PosedScan] = []
        while self._waiting:
            outcome = self._judge(self._waiting[0][2], ended)
            if outcome is None:
                break
            heapq.heappop(self._waiting)
            if isinstance(outcome, str):
                self.dropped[outcome] += 1
            else:
                self.counts["posed"] += 1
                posed.append(outcome)
        return posed

    def _judge(self, scan: Scan, ended: bool) -> PosedScan | str | None:
        """Return the posed scan, or why it is dropped, or None while it has to wait."""
        start_ns, end_ns = min(scan.stamp_ns, scan.end_ns), max(scan.stamp_ns, scan.end_ns)
        now_ns = self._guard.now(SCAN_STREAM)
        late = ended or now_ns is None or now_ns > end_ns + self._timeout_ns + self._late_joints_ns
        if self.motion.mode is None and (not late or self.expects_odometry):
            return "no odometry" if late else None
        try:
            chain = self.kinematics.find(scan.frame_id, final=late)
        except FrameError:
            return "no way from base to laser"
        if chain is None:
            return None
        if self.motion.mode is None:
            self.motion.decide(self.kinematics.base or "")
        for reason, track in self._needs(chain):
            if track.brackets(start_ns, end_ns, self._max_gap_ns):
                continue
            hopeless = self._has_no_more(track, end_ns, now_ns or 0)
            given_up = ended or (late and hopeless)
            if given_up and reason == "no joint samples":
                self.kinematics.explain_missing(chain)
            return reason if given_up else None
        knots = self.kinematics.knots(
            chain, start_ns, end_ns, *self.motion.stamps_within(start_ns, end_ns)
        )
        return PosedScan(scan, knots, self._base_poses(knots), chain.at(knots))

    def _needs(self, chain: Chain) -> list[tuple[str, Track]]:
        """Return the tracks that must bracket a scan, and what is missing where one does not."""
        needs: list[tuple[str, Track]] = [("no odometry", track) for track in self.motion.tracks]
        between = self.kinematics.odometry_chain
        for part, _ in (*chain.parts, *(between.parts if between is not None else ())):
            by_joint = isinstance(part, JointReading)
            needs.append(("no joint samples" if by_joint else "no transform", part.track))
        return needs

    def _has_no_more(self, track: Track, end_ns: int, now_ns: int) -> bool:
        """Return whether no sample can be hoped for that would bracket a scan.

        The track has passed the scan's end, or none of its samples came while message time went on
        by `sync_timeout`: a stream that is late but comes is waited for.
        """
        if len(track) and track.stamps_ns[-1] >= end_ns:
            return True
        heard, since_ns = self._silence.get(track, (-1, 0))
        if heard != track.heard:
            self._silence[track] = (track.heard, now_ns)
            return False
        return now_ns - since_ns > self._timeout_ns

    def _base_poses(self, knots_ns: Int64) -> Float64:
        """Return T_odom_base (K, 4, 4), where odometry may follow another frame of the robot."""
        T = self.motion.at(knots_ns)
        between = self.kinematics.odometry_chain
        if between is None or self.motion.mode != "odometry":
            return T
        return T @ between.at(knots_ns)

    def T_odom_base(self, stamp_ns: int) -> Float64 | None:
        """Return T_odom_base float64 (4, 4) at a stamp, None where nothing brackets it."""
        between = self.kinematics.odometry_chain
        tracks: list[Track] = [*self.motion.tracks, *(between.tracks if between else ())]
        if self.motion.mode is None or not all(
            track.brackets(stamp_ns, stamp_ns, self._max_gap_ns) for track in tracks
        ):
            return None
        return self._base_poses(np.array([stamp_ns], np.int64))[0]


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
