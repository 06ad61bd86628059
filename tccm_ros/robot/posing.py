"""Where the base and the laser were while a scan was measured, or what is missing to tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.records import PosedScan, Scan
from tccm_ros.robot import LaserKinematics
from tccm_ros.robot.base_motion import BaseMotion
from tccm_ros.robot.chain import Chain, JointReading
from tccm_ros.robot.tracks import Track

__all__ = ["Posing"]

Int64 = NDArray[np.int64]
Float64 = NDArray[np.float64]


class Posing:
    """Poses scans that odometry and all joints between base and laser bracket.

    Parameters
    ----------
    config
        `sync_timeout` is used: samples further apart than half of it bracket nothing.
    kinematics
        Of the laser.

    Attributes
    ----------
    motion
        Of the base.
    """

    def __init__(self, config: Config, kinematics: LaserKinematics):
        self.kinematics = kinematics
        self.motion = BaseMotion(config, kinematics.frames)
        self._timeout_ns = round(config.sync_timeout * 1e9)
        self._max_gap_ns = self._timeout_ns // 2
        self._late_joints_ns = max(0, round(-config.rig.joint_time_offset * 1e9))
        self._silence: dict[Track, tuple[int, int]] = {}

    def clear_samples(self) -> None:
        """Forget all samples: time began anew."""
        self._silence.clear()
        self.kinematics.clear_samples()
        self.motion.clear_samples()

    def judge(
        self, scan: Scan, now_ns: int | None, *, ended: bool, expects_odometry: bool
    ) -> PosedScan | str | None:
        """Return the posed scan, or why it is dropped, or None while it has to wait.

        Parameters
        ----------
        scan
            The next in stamp order.
        now_ns
            Message time, None where there is none yet.
        ended
            Whether nothing will come any more.
        expects_odometry
            Whether a scan without odometry is dropped.
        """
        start_ns, end_ns = min(scan.stamp_ns, scan.end_ns), max(scan.stamp_ns, scan.end_ns)
        late = ended or now_ns is None or now_ns > end_ns + self._timeout_ns + self._late_joints_ns
        if self.motion.mode is None and (not late or expects_odometry):
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
