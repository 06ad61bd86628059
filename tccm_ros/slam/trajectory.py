"""Poses between keyframes: of each scan, and at any stamp by odometry."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config.slam import OdometryConfig
from tccm_ros.geometry import between2, compose2, planar, wrap_angle
from tccm_ros.robot.tracks import Track, bracket
from tccm_ros.slam.base_attitude import UNBOUNDED_NS
from tccm_ros.slam.chain import AnchoredPose
from tccm_ros.slam.front_end import GraphKeyframe, TrackedPose
from tccm_ros.slam.odometry_model import motion_covariance
from tccm_ros.slam.se2 import between_se2, compose_se2

SCAN_FLOOR = (0.001, 0.0005)
"""Additional standard deviation (m, rad) of a pose at the stamp of a scan (chosen)."""

TILT_MOTION_NS = 500_000_000
"""Half duration of the motion within a view: its scans are registered by odometry over a tilt
cycle, so the odometry error within this time before and after the stamp, together half a tilt cycle
of an ordinary tilting laser, is added (chosen)."""


class OdometryTrack(Track):
    """Planar odometry by stamp, in any order of arrival; the last sample of a stamp is kept.

    Attributes
    ----------
    late_samples
        Number of samples that were not newer than all before them.
    """

    def __init__(self) -> None:
        super().__init__(3, UNBOUNDED_NS)
        self.late_samples = 0

    def add(self, stamp_ns: int, T_odom_base: Float64) -> None:
        """Add a sample; T_odom_base float64 (4, 4)."""
        pose = planar(T_odom_base)
        if self.append(stamp_ns, pose):
            return
        self.late_samples += 1
        i = int(np.searchsorted(self.stamps_ns, stamp_ns))
        if self._stamps[i] == stamp_ns:
            self._values[i] = pose
            return
        self._stamps = np.insert(self.stamps_ns, i, stamp_ns)
        self._values = np.insert(self.values, i, pose, axis=0)
        self._count += 1

    def first(self) -> Float64:
        """Return the pose (3,) of the earliest sample."""
        return self.values[0].copy()

    def at(self, stamp_ns: int) -> Float64 | None:
        """Return the interpolated pose (3,); None if no two samples bracket the stamp."""
        stamps, poses = self.stamps_ns, self.values
        if not len(stamps) or not stamps[0] <= stamp_ns <= stamps[-1]:
            return None
        i, j, fraction = bracket(stamps, stamp_ns)
        return _interpolate(poses[i], poses[j], fraction) if i < j else poses[i].copy()


def _interpolate(a: Float64, b: Float64, fraction: float) -> Float64:
    step = b - a
    step[2] = wrap_angle(step[2])
    mixed = a + fraction * step
    mixed[2] = wrap_angle(mixed[2])
    return mixed


def scan_poses(
    tracked: Sequence[TrackedPose], keyframes: Sequence[GraphKeyframe], poses: Float64
) -> Float64:
    """Return the poses of all scans, given optimised keyframes.

    The change of a step between two keyframes by the optimisation is distributed over the scans
    between them in proportion to time.

    Parameters
    ----------
    tracked
        The scans relative to keyframes.
    keyframes
        Keyframes of all sessions.
    poses
        float64 (K, 3), optimised poses of the keyframes in map.

    Returns
    -------
    float64 (N, 3), planar poses in map
    """
    if not tracked:
        return np.zeros((0, 3))
    index = np.array([p.keyframe for p in tracked], np.int64)
    stamps = np.array([p.stamp_ns for p in tracked], np.int64)
    relative = np.stack([p.pose for p in tracked])
    change, begin, span = _changes(keyframes, poses)
    fraction = np.clip((stamps - begin[index]) / span[index], 0.0, 1.0)
    return compose2(poses[index], relative + fraction[:, None] * change[index])


def _changes(keyframes: Sequence[GraphKeyframe], poses: Float64) -> tuple[Float64, Int64, Float64]:
    """Return the change of each step to the next keyframe, its start and its duration (ns)."""
    begin = np.array([k.scan.stamp_ns for k in keyframes], np.int64)
    span = np.ones(len(keyframes))
    span[:-1] = np.maximum(np.diff(begin), 1)
    change = np.zeros((len(keyframes), 3))
    if len(keyframes) > 1:
        measured = np.stack([k.delta for k in keyframes[1:]])
        change[:-1] = between2(poses[:-1], poses[1:]) - measured
        change[:, 2] = wrap_angle(change[:, 2])
        # There is no step between sessions.
        session = np.array([k.session for k in keyframes])
        change[:-1][np.diff(session) != 0] = 0.0
    return change, begin, span


def poses_at_stamps(
    stamps_ns: Sequence[int],
    tracked: Sequence[TrackedPose],
    keyframes: Sequence[GraphKeyframe],
    odometry: OdometryTrack,
    model: OdometryConfig,
) -> list[AnchoredPose]:
    """Return the level poses at stamps relative to keyframes, by neighbouring scans and odometry.

    Parameters
    ----------
    stamps_ns
        V stamps, in any order.
    tracked
        The scans relative to keyframes.
    keyframes
        Keyframes of all sessions.
    odometry
        Samples by stamp; if empty, poses are interpolated between scans.
    model
        Group ``odometry``.

    Returns
    -------
    list of AnchoredPose
        Each covariance is the sum of those of the previous scan, of the motion since, and of the
        motion during the tilt cycle, which is zero for a base at rest.
    """
    anchored = []
    for stamp in map(int, stamps_ns):
        i = max(bisect_right(tracked, stamp, key=lambda p: p.stamp_ns) - 1, 0)
        here = tracked[i]
        start, now = odometry.at(here.stamp_ns), odometry.at(stamp)
        if start is not None and now is not None:
            pose = compose_se2(here.pose, between_se2(start, now))
        else:
            after = tracked[min(i + 1, len(tracked) - 1)]
            pose = _between_scans(here, after, keyframes, stamp)
        cov = here.cov + motion_covariance(between_se2(here.pose, pose), model, SCAN_FLOOR)
        for end in map(odometry.at, (stamp - TILT_MOTION_NS, stamp + TILT_MOTION_NS)):
            if now is not None and end is not None:
                cov += motion_covariance(between_se2(now, end), model)
        anchored.append(AnchoredPose(here.keyframe, pose, cov))
    return anchored


def _between_scans(
    here: TrackedPose, after: TrackedPose, keyframes: Sequence[GraphKeyframe], stamp: int
) -> Float64:
    """Return the interpolated pose in the keyframe of the previous scan; held outside."""
    is_other = keyframes[after.keyframe].session != keyframes[here.keyframe].session
    if after is here or is_other or stamp <= here.stamp_ns:
        return here.pose
    end = after.pose
    if after.keyframe != here.keyframe:
        end = compose_se2(keyframes[after.keyframe].delta, end)
    return _interpolate(here.pose, end, (stamp - here.stamp_ns) / (after.stamp_ns - here.stamp_ns))
