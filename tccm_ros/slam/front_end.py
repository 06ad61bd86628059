"""The front end: each level scan against the local map, in stamp order.

Odometry predicts, a correlative search finds the neighbourhood of the answer, point-to-line
alignment refines it with odometry as a prior. What the prior adds is information in directions the
map does not constrain: along a corridor the result is odometry's, and its covariance says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.slam.alignment import Alignment, Prior, agreement, align
from tccm_ros.slam.correlation import correlate
from tccm_ros.slam.level_scan import LevelScan
from tccm_ros.slam.likelihood_grid import LikelihoodGrid, make_likelihood_grid
from tccm_ros.slam.line_map import LineMap, make_line_map
from tccm_ros.slam.odometry_model import OdometryScale, odometry_covariance
from tccm_ros.slam.se2 import between, compose, fuse, rotate_covariance

__all__ = ["FrontEnd", "GraphKeyframe", "Placed"]


LOOSE_COV = np.diag([0.5**2, 0.5**2, 0.5**2])
"""Covariance of (x, y, yaw) of a motion that odometry does not tell, between two scans."""

NEAR_STEP, MOST_TURNS = 0.012, 25
"""Angle (rad) between the turns of a search, which alignment bridges; turns to a side at most."""

DOUBTED_INLIERS = 0.7
"""Below this share of matched points a scan is looked for further away, too."""

LOST_INLIERS = 0.25
"""Below this share of matched points a match says nothing."""

CONFIRMING_KEYFRAMES = 3
"""In a map of fewer, hardly anything has been seen twice."""

AGAINST_ODOMETRY, AGAINST_NOTHING = 0.3, 0.1
"""A pose that odometry rules out, or where there is none, needs this much more evidence."""

NEW_GROUND = 0.65
"""Below this share of matched points a scan becomes a keyframe early: it sees something new."""


@dataclass(frozen=True, slots=True, eq=False)
class GraphKeyframe:
    """A keyframe and how it was reached.

    Attributes
    ----------
    id, scan
        Index among the keyframes of all sessions; its scan.
    pose
        float64 (3,), where the front end put it, in its own map.
    delta, cov
        Planar pose (3,) in the keyframe before and covariance (3, 3) of (x, y, yaw) in this
        keyframe's own frame; zero for the first of a session.
    session
        A run of the robot; each has a map frame of its own until a loop ties it to another.
    """

    id: int
    scan: LevelScan
    pose: Float64
    delta: Float64
    cov: Float64
    session: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A scan's place in the keyframe `keyframe`, the newest at its time.

    `pose` is float64 (3,), `cov` float64 (3, 3) of (x, y, yaw) in the scan's own frame.
    """

    stamp_ns: int
    keyframe: int
    pose: Float64
    cov: Float64


@dataclass(slots=True)
class _LocalMap:
    lines: LineMap
    grid: LikelihoodGrid


@dataclass(slots=True)
class FrontEnd:
    """Scan-to-submap matching; deterministic in the order of the scans."""

    config: Config
    first_id: int = 0
    session: int = 0
    keyframes: list[GraphKeyframe] = field(default_factory=list)
    placed: list[Placed] = field(default_factory=list)
    pose: Float64 = field(default_factory=lambda: np.zeros(3))
    _map: _LocalMap | None = None
    _last: LevelScan | None = None
    _step: Float64 = field(default_factory=lambda: np.zeros(3))
    _moving: bool = False
    _scale: OdometryScale = field(default_factory=OdometryScale)
    _information: Float64 | None = None
    _by_odometry: Float64 = field(default_factory=lambda: np.zeros(3))
    _anchor_odom: Float64 = field(default_factory=lambda: np.zeros(3))
    _anchor_cov: Float64 = field(default_factory=lambda: np.zeros((3, 3)))

    def add(self, scan: LevelScan, start: Float64 | None = None) -> Placed:
        """Place a scan; `start` (3,) is the first one's pose in the front end's map."""
        if self._last is None:
            self.pose = np.zeros(3) if start is None else np.asarray(start, float)
            self._add_keyframe(scan, np.zeros((3, 3)))
            cov = np.zeros((3, 3))
        else:
            cov = self._track(scan)
        self._last = scan
        keyframe = self.keyframes[-1]
        placed = Placed(scan.stamp_ns, keyframe.id, between(keyframe.pose, self.pose), cov)
        self.placed.append(placed)
        return placed

    def _track(self, scan: LevelScan) -> Float64:
        """Follow the robot to a scan; return the covariance (3, 3) of its place in its keyframe."""
        before, keyframe = self.pose, self.keyframes[-1]
        predicted, prior, prior_cov = self._predict(scan)
        self.pose, cov, inliers = self._match(scan, predicted, prior, prior_cov)
        self._step = between(before, self.pose)
        moved = between(keyframe.pose, self.pose)
        distance, turn = float(np.hypot(moved[0], moved[1])), abs(float(moved[2]))
        graph = self.config.graph
        far = distance > graph.keyframe_distance or turn > graph.keyframe_angle
        early = inliers < NEW_GROUND and distance + turn > 0.4 * graph.keyframe_distance
        if far or early:
            self._learn_scale(scan, moved)
            self._add_keyframe(scan, cov)
            return np.zeros((3, 3))
        return cov

    def _learn_scale(self, scan: LevelScan, moved: Float64) -> None:
        keyframe = self.keyframes[-1]
        if self._information is None or self._anchor_cov.any():
            return
        odometry = between(keyframe.scan.odom, scan.odom)
        information = rotate_covariance(self._information, -float(keyframe.pose[2]))
        noise = odometry_covariance(odometry, self.config.odometry)
        self._scale.update(odometry, moved, information, noise)

    def _predict(self, scan: LevelScan) -> tuple[Float64, Float64, Float64]:
        """Return where the robot is by the last scan, by odometry since the anchor, and the
        covariance of odometry.

        Odometry's position counts from the last keyframe, and not from scan to scan: people who
        walk along pull each scan back a little, and would meet no resistance. Its heading counts
        from scan to scan, also for the direction of its steps: that is where wheels slip, and
        walls tell it everywhere.
        """
        assert self._last is not None
        step = self._scale.corrected(between(self._last.odom, scan.odom))
        since = self._scale.corrected(between(self._anchor_odom, scan.odom))
        self._moving = self._moving or bool(abs(step[0]) + abs(step[1]) + abs(step[2]) > 1e-9)
        if not self._moving:
            # No odometry: the robot goes on as it went, within what robots accelerate.
            expected = compose(self.pose, self._step)
            return expected, expected, np.diag([0.15**2, 0.15**2, 0.15**2])
        expected = compose(self.pose, step)
        self._by_odometry[:2] += expected[:2] - self.pose[:2]
        prior = np.array([self._by_odometry[0], self._by_odometry[1], expected[2]])
        cov = self._anchor_cov + odometry_covariance(since, self.config.odometry)
        return expected, prior, cov

    def _match(
        self, scan: LevelScan, predicted: Float64, prior: Float64, prior_cov: Float64
    ) -> tuple[Float64, Float64, float]:
        """Return the pose, its covariance in its own frame and the share of inliers."""
        self._information = None
        if self._map is None or not self.config.matching.enabled or len(scan.points) < 5:
            return predicted, prior_cov, 1.0
        result = self._align_near(scan, predicted, prior, prior_cov, self._window(prior_cov))
        if result.inliers < DOUBTED_INLIERS:
            wide = self._search_wide(scan, predicted, result)
            if wide is not result:
                # Odometry was wrong by more than its model: it says nothing about this motion.
                result, prior_cov = wide, LOOSE_COV
                self._by_odometry, self._anchor_odom = wide.pose.copy(), scan.odom
                self._anchor_cov = LOOSE_COV
        if result.inliers < LOST_INLIERS:
            return predicted, 4.0 * prior_cov, result.inliers
        self._information = information = result.information / self.config.matching.correlated_beams
        cov = fuse(information, float(result.pose[2]), prior_cov)
        return result.pose, cov, result.inliers

    def _window(self, prior_cov: Float64) -> tuple[float, float]:
        matching = self.config.matching
        return (
            max(matching.search_distance, min(1.0, 3.0 * float(np.sqrt(prior_cov[0, 0])))),
            max(matching.search_angle, min(0.8, 3.0 * float(np.sqrt(prior_cov[2, 2])))),
        )

    def _align_near(
        self,
        scan: LevelScan,
        centre: Float64,
        prior: Float64,
        prior_cov: Float64,
        window: tuple[float, float],
    ) -> Alignment:
        assert self._map is not None
        sigma_xy, sigma_yaw = float(prior_cov[0, 0] ** 0.5), float(prior_cov[2, 2] ** 0.5)
        step = max(NEAR_STEP, window[1] / MOST_TURNS)
        penalty = (0.01 / sigma_xy**2, 0.01 / sigma_yaw**2)
        start = correlate(
            self._map.grid, scan.search_points, centre, window, angle_step=step, penalty=penalty
        )
        # Odometry's covariance is diagonal, and the same along any two axes of the plane.
        known = Prior(prior, np.diag(1.0 / np.diag(prior_cov)))
        return align(
            self._map.lines,
            scan.points,
            scan.normals,
            start.pose if start.score > 0.0 else centre,
            self.config.matching.range_sigma,
            known,
        )

    def _search_wide(self, scan: LevelScan, predicted: Float64, near: Alignment) -> Alignment:
        """Odometry may have jumped: look around where the robot was and where it should be."""
        found = [
            self._align_near(scan, centre, centre, LOOSE_COV, (1.0, 0.6))
            for centre in (predicted, self.pose, compose(self.pose, self._step))
        ]
        evidence = [self._evidence(scan, alignment) for alignment in (near, *found)]
        best = int(np.argmax(evidence[1:]))
        against = AGAINST_ODOMETRY if self._moving else AGAINST_NOTHING
        return found[best] if evidence[1 + best] > evidence[0] + against else near

    def _evidence(self, scan: LevelScan, alignment: Alignment) -> float:
        assert self._map is not None
        if len(self.keyframes) < CONFIRMING_KEYFRAMES:
            return alignment.inliers
        return agreement(alignment, scan, self._map.lines)

    def _add_keyframe(self, scan: LevelScan, cov: Float64) -> None:
        first = not self.keyframes
        delta = np.zeros(3) if first else between(self.keyframes[-1].pose, self.pose)
        keyframe = GraphKeyframe(
            self.first_id + len(self.keyframes), scan, self.pose.copy(), delta, cov, self.session
        )
        self.keyframes.append(keyframe)
        self._by_odometry, self._anchor_odom = keyframe.pose.copy(), scan.odom
        self._anchor_cov = np.zeros((3, 3))
        self._rebuild_map()

    def _rebuild_map(self) -> None:
        recent = self.keyframes[-self.config.matching.submap_keyframes :]
        poses = np.stack([k.pose for k in recent])
        lines = make_line_map(poses, [k.scan for k in recent])
        self._map = _LocalMap(lines, make_likelihood_grid(lines.points, 3))
