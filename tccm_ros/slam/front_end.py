"""Front end: scan-to-submap matching of level scans, in stamp order.

Odometry predicts the pose, a correlative search finds the basin of convergence, and point-to-line
alignment refines the pose with odometry as a prior. The prior adds information in directions that
the map does not constrain: along a corridor, the result and its covariance are those of odometry.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.slam.matching.alignment import Alignment, Prior, agreement, align, seen_through
from tccm_ros.slam.matching.correlation import SEARCH_WEIGHT, correlate
from tccm_ros.slam.matching.level_scan import LevelScan, point_sigma
from tccm_ros.slam.matching.likelihood_grid import LikelihoodGrid, make_likelihood_grid
from tccm_ros.slam.matching.line_map import LineMap, make_line_map
from tccm_ros.slam.matching.visibility import passes_and_hits
from tccm_ros.slam.odometry_model import OdometryScale, gyro_yaw_variance, odometry_covariance
from tccm_ros.slam.se2 import (
    between_se2,
    compose_se2,
    fuse,
    inverse_se2,
    rotate_covariance,
    transform_points,
)

LOOSE_COV = np.diag([0.5**2, 0.5**2, 0.5**2])
"""Covariance of (x, y, yaw), m and rad, of an unknown motion between two scans (chosen)."""

DECAY_TIME = 0.5
"""Time constant (s) of the exponential decay of unobserved motion without odometry (chosen: robots
brake in less)."""

CONTRADICTION_CHI2, CONTRADICTING_SCANS = 16.3, 5
"""Odometry that has never reported a motion is ignored after this number of consecutive scans that
deviate by more than this chi2 (99.9 % of three degrees of freedom): the wheels have no encoders
(chosen)."""

STEADY_COV = np.diag([0.15**2, 0.15**2, 0.15**2])
"""Covariance of (x, y, yaw), m and rad, of the change of motion between two scans without odometry:
the accelerations of robots (chosen)."""

STEADY_TIME = 0.1
"""Time (s) since the last match for which `STEADY_COV` holds; the standard deviation is
proportional to it (10 Hz lasers)."""

MIN_ANGLE_STEP, MAX_ANGLE_STEPS = 0.012, 25
"""Yaw step (rad) of a search, small enough for alignment, and maximum number of steps to either
side (chosen)."""

WINDOW_SIGMAS, MAX_WINDOW = 3.0, (1.0, 0.8)
"""Half width of the search in standard deviations of odometry, and its maximum, m and rad
(chosen)."""

WIDE_WINDOW, MAX_WIDE_WINDOW = (1.0, 0.6), (3.0, 0.8)
"""Half width (m, rad) of the search after a bad match, and its maximum after some time without a
match (chosen)."""

MIN_POINTS = 5
"""Minimum number of points of a scan for matching (chosen)."""

LOCAL_LEVELS = 3
"""Number of levels of the local map's likelihood grid; few, as windows are small (chosen)."""

MIN_INLIERS = 0.7
"""Inlier fraction below which the search for a scan is widened (chosen)."""

MIN_USED_INLIERS = 0.4
"""Inlier fraction below which a match is not used (chosen)."""

UNUSED_INFLATION = 4.0
"""Factor on the covariance of odometry if a match is not used (chosen)."""

CONFIRMING_KEYFRAMES = 3
"""Maps of fewer keyframes have hardly any confirmed surfaces; confirmation is then not required
(chosen)."""

REST_STEP = (0.002, 0.002)
"""A robot is at rest if odometry reports a step of less than this (m, rad) between two scans
(chosen)."""

LOST_TIME = 1.5
"""Kidnapped robot detection at rest. The robot was moved if over this time (s) all its scans
contradict more of the map than they confirm: the fraction of the confirmed surfaces in view that a
scan sees through exceeds its inlier fraction. ``bench/bench_match_statistics.py`` gives both on
recordings of robots that are not lost. The time is chosen: a passer-by occludes surfaces, but none
is seen through. A door that opens before the robot leaves the rest unchanged, and a robot placed
exactly along another stretch of the same corridor cannot be distinguished from that."""

NOTICE_TIME = 0.5
"""Time (s) after which a contradiction is reported (chosen: longer than a passer-by)."""

MIN_GAIN, MIN_GAIN_WITHOUT_ODOMETRY = 0.3, 0.1
"""Minimum gain in quality of the wide search over the first match: with odometry, and without
(chosen)."""

EARLY_KEYFRAME_INLIERS = 0.65
"""Inlier fraction below which a scan becomes a keyframe early (chosen)."""

NARROW = 2.0
"""View angle, rad, below which a scan is narrow: cameras have up to 120 deg, lasers 180 or more."""

EARLY_FRACTION = 0.4
"""Minimum motion to an early keyframe, as the sum of `FrontEnd.step_fractions` (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class GraphKeyframe:
    """A keyframe and the motion from the previous keyframe.

    Attributes
    ----------
    id, scan
        Index among the keyframes of all sessions, and the scan.
    pose
        float64 (3,), estimate of the front end, in its own map.
    delta, cov
        Planar pose (3,) in the previous keyframe, and covariance (3, 3) of (x, y, yaw) in this
        keyframe's own frame; zero for the first of a session.
    session
        Number of the session; it has its own map frame until a loop closure localises it.
    systematic
        float64 (3,), (x, y, yaw) in this keyframe's own frame: error of `delta` for an odometry
        scale error of one standard deviation. The scale error is constant over a session.
    """

    id: int
    scan: LevelScan
    pose: Float64
    delta: Float64
    cov: Float64
    session: int = 0
    systematic: Float64 = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPose:
    """The pose of a scan, relative to the newest keyframe at its time.

    Attributes
    ----------
    stamp_ns
        Stamp of the scan.
    keyframe
        Id of the keyframe.
    pose
        float64 (3,), planar pose in the keyframe, m and rad.
    cov
        float64 (3, 3) of (x, y, yaw) in the scan's own frame.
    """

    stamp_ns: int
    keyframe: int
    pose: Float64
    cov: Float64


def decaying_motion(velocity: Float64, seconds: float) -> Float64:
    """Return the motion (3,) of a braking robot in a time (s), from its velocity (3,).

    It is at most the velocity times `DECAY_TIME`.
    """
    return np.asarray(velocity * (-np.expm1(-seconds / DECAY_TIME) * DECAY_TIME))


def decayed(velocity: Float64, seconds: float, information: Float64, prior_cov: Float64) -> Float64:
    """Return a velocity after decay of the components that no scan observes.

    The pose is the mean of prediction and match, weighted by information. The weight of the
    prediction, W = (I + P^-1)^-1 P^-1, gives the unobserved part of the motion. In the norm of
    P^-1, W is symmetric with eigenvalues between 0 and 1: the velocity never grows.

    Parameters
    ----------
    velocity
        float64 (3,), the mean over the interval, m/s and rad/s.
    seconds
        Duration of the interval.
    information
        float64 (3, 3), information of the match alone on (x, y, yaw) in the frame of the pose.
    prior_cov
        float64 (3, 3), P, covariance of the prediction, in the same frame.
    """
    weight = np.linalg.inv(np.eye(3) + prior_cov @ information)
    # Ratio of final to mean velocity in the interval, for exponential decay with `DECAY_TIME`.
    x = seconds / DECAY_TIME
    return np.asarray(velocity - (1.0 - x / np.expm1(x)) * (weight @ velocity))


def _since(since_ns: int | None, scan: LevelScan, holds: bool) -> int | None:
    """Return the stamp since which a condition has held; None if it does not hold (`holds`)."""
    return (scan.stamp_ns if since_ns is None else since_ns) if holds else None


def _prior(pose: Float64, cov: Float64) -> Prior:
    """Return a prior from odometry's covariance (3, 3): diagonal, and isotropic in the plane."""
    return Prior(pose, np.diag(1.0 / np.diag(cov)))


class _StampedPose(NamedTuple):
    stamp_ns: int
    pose: Float64


@dataclass(slots=True)
class _LocalMap:
    lines: LineMap
    grid: LikelihoodGrid


@dataclass(slots=True)
class FrontEnd:
    """Scan-to-submap matching; deterministic for a given order of scans.

    Attributes
    ----------
    config
        Groups ``matching``, ``odometry``, ``graph`` and ``sensors``.
    first_id
        Id of the first keyframe of this session.
    session
        Number of this session; a lost robot begins a new one.
    keyframes
        Keyframes of all sessions since the start.
    is_lost
        Whether the newest scans match nothing; the next scan then begins a new session.
    tracked
        Poses of all scans.
    pose
        float64 (3,), pose of the newest scan in the front end's map.
    """

    config: Config
    first_id: int = 0
    session: int = 0
    keyframes: list[GraphKeyframe] = field(default_factory=list)
    tracked: list[TrackedPose] = field(default_factory=list)
    pose: Float64 = field(default_factory=lambda: np.zeros(3))
    is_lost: bool = False
    # Pose of the last used match; stamps since which the pose is unknown, and since which scans see
    # through surfaces of the map.
    _matched: _StampedPose | None = None
    _unmatched_ns: int | None = None
    _seen_through_ns: int | None = None
    _map: _LocalMap | None = None
    _last: LevelScan | None = None
    # Mean velocity of the newest motion, (m/s, m/s, rad/s), in the frame of the previous pose.
    _velocity: Float64 = field(default_factory=lambda: np.zeros(3))
    _has_moved: bool = False
    _was_at_rest: bool = False
    _disagreeing_scans: int = 0
    _scale: OdometryScale = field(default_factory=OdometryScale)
    _information: Float64 | None = None
    _odometry_pose: Float64 = field(default_factory=lambda: np.zeros(3))
    _anchor_odom: Float64 = field(default_factory=lambda: np.zeros(3))
    _anchor_cov: Float64 = field(default_factory=lambda: np.zeros((3, 3)))
    # Time since the anchor with yaw from the gyroscope only, s; None if wheels gave yaw.
    _gyro_s: float | None = 0.0

    def __post_init__(self) -> None:
        self._scale.error_variance = self.config.odometry.sigma_scale**2

    def add(self, scan: LevelScan, start: Float64 | None = None) -> TrackedPose:
        """Estimate the pose of a scan; `start` (3,) is the first pose in the front end's map."""
        if self.is_lost:
            self.begin_session()
        if self._last is None:
            if scan.has_odometry or not self.keyframes:
                self.pose = np.zeros(3) if start is None else np.asarray(start, float)
            self._add_keyframe(scan, np.zeros((3, 3)), np.zeros(3))
            self._matched = _StampedPose(scan.stamp_ns, self.pose.copy())
            cov = np.zeros((3, 3))
        else:
            cov = self._track(scan)
        self._last = scan
        keyframe = self.keyframes[-1]
        tracked = TrackedPose(
            scan.stamp_ns, keyframe.id, between_se2(keyframe.pose, self.pose), cov
        )
        self.tracked.append(tracked)
        return tracked

    def step_fractions(self, moved: Float64) -> tuple[float, float]:
        """Return a motion (3,) as fractions of the distance and the angle between keyframes."""
        graph = self.config.graph
        distance, yaw = float(np.hypot(moved[0], moved[1])), abs(float(moved[2]))
        return distance / graph.keyframe_distance, yaw / graph.keyframe_angle

    def begin_session(self) -> None:
        """Begin a new session; the next scan is at an unrelated place."""
        if self._last is not None:
            self.session += 1
        self.is_lost, self._unmatched_ns, self._seen_through_ns = False, None, None
        self._map = self._last = self._information = None
        self._velocity, self._disagreeing_scans = np.zeros(3), 0

    def is_pose_unknown(self, stamp_ns: int) -> bool:
        """Return whether the pose was unknown for `NOTICE_TIME` before a stamp.

        Scans contradict odometry, or without odometry they match nothing.
        """
        since_ns = self._unmatched_ns
        return since_ns is not None and stamp_ns - since_ns > NOTICE_TIME * 1e9

    def forget(self) -> None:
        """Delete keyframes and poses that matching does not need any more."""
        needed = max(self.config.matching.submap_keyframes, CONFIRMING_KEYFRAMES)
        gone = max(len(self.keyframes) - needed, 0)
        self.first_id += gone
        del self.keyframes[:gone], self.tracked[:-1]

    def _track(self, scan: LevelScan) -> Float64:
        """Estimate the pose of a scan; return its covariance (3, 3) relative to its keyframe."""
        assert self._last is not None
        before, keyframe = self.pose, self.keyframes[-1]
        predicted, prior, prior_cov = self._predict(scan)
        self.pose, cov, inliers = self._match(scan, predicted, _prior(prior, prior_cov), prior_cov)
        self._count_disagreeing_scans(scan, prior, prior_cov)
        self._check_lost(scan, inliers)
        self._update_velocity(scan, before, prior_cov)
        moved = between_se2(keyframe.pose, self.pose)
        fractions = self.step_fractions(moved)
        is_early = inliers < EARLY_KEYFRAME_INLIERS and sum(fractions) > EARLY_FRACTION
        is_due = max(fractions) > 1.0 or is_early
        # A scan of another place must not enter the map that has to detect the change.
        if is_due and not self._is_place_in_doubt() and not self._is_occluded(scan, inliers):
            systematic = self._systematic(scan, cov)
            self._learn_scale(scan, moved)
            self._add_keyframe(scan, cov, systematic)
            return np.zeros((3, 3))
        return cov

    def _update_velocity(self, scan: LevelScan, before: Float64, prior_cov: Float64) -> None:
        """Update the velocity of the motion to a scan, from the previous or last known pose."""
        assert self._matched is not None
        observed, seconds = self._information is not None, self._seconds_to(scan)
        if observed:
            before, seconds = self._matched.pose, (scan.stamp_ns - self._matched.stamp_ns) * 1e-9
        self._velocity = between_se2(before, self.pose) / seconds
        if not self._believes_odometry(scan):
            information = np.zeros((3, 3)) if self._information is None else self._information
            information = rotate_covariance(information, -float(self.pose[2]))
            self._velocity = decayed(self._velocity, seconds, information, prior_cov)
        if observed:
            self._matched = _StampedPose(scan.stamp_ns, self.pose.copy())

    def _systematic(self, scan: LevelScan, cov: Float64) -> Float64:
        """Return the motion of a scan since its keyframe by one sigma of odometry's scale error.

        Matching corrects the observed components: the pose is the mean of prediction and match,
        weighted by information.
        """
        if not self._believes_odometry(scan):
            return np.zeros(3)
        # The translation since the anchor, along the axes of the scan.
        shift = -inverse_se2(between_se2(self._anchor_odom, scan.odom)) * np.array([1.0, 1.0, 0.0])
        shift *= self._scale.error_variance**0.5
        if self._information is None:
            return shift
        information = rotate_covariance(self._information, -float(self.pose[2]))
        return np.asarray(shift - cov @ information @ shift)

    def _learn_scale(self, scan: LevelScan, moved: Float64) -> None:
        keyframe = self.keyframes[-1]
        if self._information is None or self._anchor_cov.any():
            return
        odometry = between_se2(keyframe.scan.odom, scan.odom)
        information = rotate_covariance(self._information, -float(keyframe.pose[2]))
        noise = odometry_covariance(odometry, self.config.odometry)
        self._scale.update(odometry, moved, information, noise)

    def _predict(self, scan: LevelScan) -> tuple[Float64, Float64, Float64]:
        """Return the predicted pose, the pose by odometry since the last keyframe, and covariance.

        Odometry's position is integrated from the last keyframe, not from scan to scan: people who
        walk along bias each match slightly, and these errors would accumulate. Its heading is used
        from scan to scan while the robot moves, also for the direction of its steps: wheels slip in
        heading, and walls determine heading nearly everywhere.
        """
        assert self._last is not None
        assert self._matched is not None
        step = self._scale.corrected(between_se2(self._last.odom, scan.odom))
        since = self._scale.corrected(between_se2(self._anchor_odom, scan.odom))
        if step.any():
            self._has_moved, self._disagreeing_scans = True, 0
        if not self._believes_odometry(scan):
            expected = compose_se2(
                self.pose, decaying_motion(self._velocity, self._seconds_to(scan))
            )
            unknown_s = (scan.stamp_ns - self._matched.stamp_ns) * 1e-9
            return expected, expected, STEADY_COV * max(1.0, unknown_s / STEADY_TIME) ** 2
        if step.any():
            self._use_gyro(scan, step)
        expected = compose_se2(self.pose, step)
        self._odometry_pose[:2] += expected[:2] - self.pose[:2]
        # Matching must not accumulate heading errors of a robot at rest. Late odometry looks like
        # rest for one scan.
        if step.any() or not self._was_at_rest:
            self._odometry_pose[2] = expected[2]
        self._was_at_rest = not step.any()
        prior = self._odometry_pose.copy()
        cov = odometry_covariance(since, self.config.odometry)
        if self._gyro_s:
            cov[2, 2] = gyro_yaw_variance(float(since[2]), self._gyro_s)
        return expected, prior, self._anchor_cov + cov

    def _use_gyro(self, scan: LevelScan, step: Float64) -> None:
        """Replace the yaw of an odometry step by the gyroscope's, if both scans have one.

        Wheels slip in turns, a gyroscope does not. Whether the robot moves while the wheels stand
        is decided by scans.
        """
        assert self._last is not None
        if scan.heading is None or self._last.heading is None:
            self._gyro_s = None
            return
        step[2] = scan.heading - self._last.heading
        if self._gyro_s is not None:
            self._gyro_s += (scan.stamp_ns - self._last.stamp_ns) * 1e-9

    def _seconds_to(self, scan: LevelScan) -> float:
        """Return the time (s) from the previous scan to a scan."""
        assert self._last is not None
        return (scan.stamp_ns - self._last.stamp_ns) * 1e-9

    def _believes_odometry(self, scan: LevelScan) -> bool:
        return scan.has_odometry and self._disagreeing_scans < CONTRADICTING_SCANS

    def _count_disagreeing_scans(self, scan: LevelScan, prior: Float64, prior_cov: Float64) -> None:
        """Count consecutive scans that observe a motion while odometry reports rest."""
        assert self._last is not None
        if not scan.has_odometry or between_se2(self._last.odom, scan.odom).any():
            return
        if self._believes_odometry(scan):
            disagrees = self._disagrees_with_odometry(scan, prior, prior_cov)
            self._disagreeing_scans = self._disagreeing_scans + 1 if disagrees else 0
        if not self._believes_odometry(scan):
            # Odometry is integrated from here if it recovers.
            self._anchor_odometry(scan, self.pose, STEADY_COV)

    def _check_lost(self, scan: LevelScan, inliers: float) -> None:
        """Update how long the pose has been unknown, and whether the robot is elsewhere.

        With odometry, scans contradict its report of rest: a robot carried by a lift sees another
        floor as the door opens, and drives off at once. Without odometry, a scan that matches
        nothing leaves the pose unknown. People who occlude the map do not make it transparent: the
        place is the same, and the search for it continues.
        """
        unknown = (
            self._map is not None
            and self.config.matching.enabled
            and self._information is None
            and not self._believes_odometry(scan)
        )
        is_seen_through = (
            self._map is not None
            and (unknown or self._is_at_rest(scan) or self._is_place_in_doubt())
            and seen_through(self.pose, scan, self._map.lines) > inliers
        )
        self._unmatched_ns = _since(self._unmatched_ns, scan, unknown or is_seen_through)
        self._seen_through_ns = _since(self._seen_through_ns, scan, is_seen_through)
        since_ns = self._seen_through_ns
        self.is_lost = since_ns is not None and scan.stamp_ns - since_ns > LOST_TIME * 1e9

    def _is_place_in_doubt(self) -> bool:
        """Return whether the place of the newest scans in the map is in doubt."""
        return self._unmatched_ns is not None

    def _is_accidental(self, scan: LevelScan, result: Alignment, prior: Prior) -> bool:
        """Return whether a match without odometry is accidental.

        It is further from the prediction than robots drive; or it is a relocalisation with fewer
        inliers than the limit below which the search is widened.
        """
        if self._believes_odometry(scan):
            return False
        deviation = between_se2(prior.pose, result.pose)
        is_far = deviation @ prior.information @ deviation > CONTRADICTION_CHI2
        return bool(is_far) or (self._is_place_in_doubt() and result.inliers < MIN_INLIERS)

    def _is_occluded(self, scan: LevelScan, inliers: float) -> bool:
        """Return whether people occlude the map in a scan without odometry.

        Most of its outliers are where the map's scans had free space, so they are no new surfaces.
        With such a scan in the map, the next ones would follow the passers-by.
        """
        if inliers >= EARLY_KEYFRAME_INLIERS or self._believes_odometry(scan):
            return False
        recent = self._recent_keyframes(self.config.matching.submap_keyframes)
        ends = [transform_points(k.pose, k.scan.points) for k in recent]
        passes, hits = passes_and_hits(
            transform_points(self.pose, scan.points),
            np.concatenate([transform_points(k.pose, k.scan.origin[None]) for k in recent]),
            np.array([len(x) for x in ends]),
            np.concatenate(ends),
        )
        return float(np.mean(passes > hits)) > 0.5 * (1.0 - inliers)

    def _is_at_rest(self, scan: LevelScan) -> bool:
        """Return whether odometry, which has reported motion before, reports rest."""
        if self._last is None or not self._has_moved or not self._believes_odometry(scan):
            return False
        step = between_se2(self._last.odom, scan.odom)
        moved, turned = float(np.hypot(step[0], step[1])), abs(float(step[2]))
        return moved < REST_STEP[0] and turned < REST_STEP[1]

    def _disagrees_with_odometry(self, scan: LevelScan, prior: Float64, prior_cov: Float64) -> bool:
        """Return whether matching alone deviates from odometry that has never reported a motion."""
        if self._information is None or self._has_moved:
            return False
        loose = _prior(prior, STEADY_COV)
        free = self._align_near(scan, self.pose, loose, self._window(STEADY_COV))
        information = free.information / self.config.matching.correlated_beams
        total = np.linalg.inv(information + np.linalg.inv(prior_cov))
        deviation = between_se2(prior, free.pose)
        # Odometry's covariance is isotropic; the information is along the map's axes.
        deviation[:2] = free.pose[:2] - prior[:2]
        weight = information - information @ total @ information
        return bool(deviation @ weight @ deviation > CONTRADICTION_CHI2)

    def _match(
        self, scan: LevelScan, predicted: Float64, prior: Prior, prior_cov: Float64
    ) -> tuple[Float64, Float64, float]:
        """Return the pose, its covariance in its own frame and the inlier fraction."""
        self._information = None
        if self._map is None or not self.config.matching.enabled or len(scan.points) < MIN_POINTS:
            return predicted, prior_cov, 1.0
        result = self._align_near(scan, predicted, prior, self._window(prior_cov))
        if result.inliers < MIN_INLIERS and self._may_contradict_odometry(scan):
            wide = self._search_wide(scan, predicted, prior_cov, result)
            if wide is not result:
                # Odometry was wrong by more than its model: it is not used for this motion.
                result, prior_cov = wide, LOOSE_COV
                self._anchor_odometry(scan, wide.pose, LOOSE_COV)
        if result.inliers < MIN_USED_INLIERS or self._is_accidental(scan, result, prior):
            return predicted, UNUSED_INFLATION * prior_cov, result.inliers
        self._information = information = result.information / self.config.matching.correlated_beams
        cov = fuse(information, float(result.pose[2]), prior_cov)
        return result.pose, cov, result.inliers

    def _may_contradict_odometry(self, scan: LevelScan) -> bool:
        """Return whether few matches of a scan may mean that odometry is wrong.

        A camera that turns sees new surfaces, and low furniture leaves its view as it approaches:
        neither contradicts odometry, and a short arc of furniture nearly always fits elsewhere.
        """
        bearings = np.sort(np.arctan2(*(scan.points - scan.origin).T[::-1]))
        gaps = np.diff(bearings, append=bearings[0] + 2.0 * np.pi)
        is_narrow = bool(2.0 * np.pi - gaps.max() < NARROW)
        return not (self._is_at_rest(scan) or (is_narrow and self._believes_odometry(scan)))

    def _window(self, prior_cov: Float64) -> tuple[float, float]:
        matching, sigmas = self.config.matching, np.sqrt(np.diag(prior_cov)).tolist()
        return (
            max(matching.search_distance, min(MAX_WINDOW[0], WINDOW_SIGMAS * sigmas[0])),
            max(matching.search_angle, min(MAX_WINDOW[1], WINDOW_SIGMAS * sigmas[2])),
        )

    @property
    def _weight_of_priors(self) -> float:
        """Factor on priors in an alignment, which counts all beams of a scan as independent.

        So are the ranges of a laser; the depths of an image have errors in common.
        """
        is_depth = self.config.sensors.level_from == "depth"
        return self.config.matching.correlated_beams if is_depth else 1.0

    def _align_near(
        self, scan: LevelScan, centre: Float64, prior: Prior, window: tuple[float, float]
    ) -> Alignment:
        assert self._map is not None
        step = max(MIN_ANGLE_STEP, window[1] / MAX_ANGLE_STEPS)
        weight = SEARCH_WEIGHT * np.diag(prior.information)
        penalty = float(weight[0]), float(weight[2])
        start = correlate(
            self._map.grid, scan.search_points, centre, window, angle_step=step, penalty=penalty
        )
        return align(
            self._map.lines,
            scan.points,
            scan.normals,
            start.pose if start.score > 0.0 else centre,
            point_sigma(self.config),
            Prior(prior.pose, self._weight_of_priors * prior.information),
        )

    def _search_wide(
        self, scan: LevelScan, predicted: Float64, prior_cov: Float64, near: Alignment
    ) -> Alignment:
        """Search around the predicted and the last pose: odometry may have jumped."""
        window, min_quality = WIDE_WINDOW, -np.inf
        if not self._believes_odometry(scan):
            # Limit the search to plausible motion: an occlusion of the map must not move the robot.
            sigma, min_quality = float(prior_cov[0, 0] ** 0.5), MIN_USED_INLIERS
            low = self._window(STEADY_COV)[0], WIDE_WINDOW[1]
            window = (
                min(max(low[0], sigma), MAX_WIDE_WINDOW[0]),
                min(max(low[1], sigma), MAX_WIDE_WINDOW[1]),
            )
        centres = [predicted, self.pose]
        if self._believes_odometry(scan):
            # Without odometry, this is the predicted pose.
            moved = decaying_motion(self._velocity, self._seconds_to(scan))
            centres.append(compose_se2(self.pose, moved))
        found = [self._align_near(scan, c, _prior(c, LOOSE_COV), window) for c in centres]
        min_gain = MIN_GAIN if self._believes_odometry(scan) else MIN_GAIN_WITHOUT_ODOMETRY
        # No match is an alternative as well; its quality is 0.
        limit = max(self._match_quality(scan, near) + min_gain, 0.0, min_quality)
        qualities = [self._match_quality(scan, f) for f in found]
        best = int(np.argmax(qualities))
        return found[best] if qualities[best] > limit else near

    def _match_quality(self, scan: LevelScan, alignment: Alignment) -> float:
        assert self._map is not None
        if len(self._recent_keyframes(CONFIRMING_KEYFRAMES)) < CONFIRMING_KEYFRAMES:
            return alignment.inliers
        return agreement(alignment, scan, self._map.lines)

    def _add_keyframe(self, scan: LevelScan, cov: Float64, systematic: Float64) -> None:
        first = not self.keyframes or self.keyframes[-1].session != self.session
        delta = np.zeros(3) if first else between_se2(self.keyframes[-1].pose, self.pose)
        number, pose = self.first_id + len(self.keyframes), self.pose.copy()
        keyframe = GraphKeyframe(number, scan, pose, delta, cov, self.session, systematic)
        self.keyframes.append(keyframe)
        self._anchor_odometry(scan, pose, np.zeros((3, 3)))
        self._rebuild_map()

    def _anchor_odometry(self, scan: LevelScan, pose: Float64, cov: Float64) -> None:
        """Integrate odometry from the pose (3,) of a scan on, which has the covariance (3, 3)."""
        self._odometry_pose, self._anchor_odom = pose.copy(), scan.odom
        self._anchor_cov, self._gyro_s = cov, 0.0

    def _recent_keyframes(self, count: int) -> list[GraphKeyframe]:
        """Return the keyframes of this session among the newest `count` ones."""
        return [k for k in self.keyframes[-count:] if k.session == self.session]

    def _rebuild_map(self) -> None:
        recent = self._recent_keyframes(self.config.matching.submap_keyframes)
        poses = np.stack([k.pose for k in recent])
        lines = make_line_map(poses, [k.scan for k in recent])
        self._map = _LocalMap(lines, make_likelihood_grid(lines.points, LOCAL_LEVELS))
