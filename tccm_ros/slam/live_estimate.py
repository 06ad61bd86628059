"""The live estimate: the newest solution, extrapolated by the motion since.

A solution gives the poses of its newest keyframe and of its walls. Later keyframes are added as in
the graph: by the motion between them, and by observations of those walls (an extended Kalman
filter; Thrun, Burgard and Fox 2005, "Probabilistic robotics", 7.4). This affects published poses
only. A new solution replaces the previous one, and the keyframes after it are added again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import transform2, wrap_angle
from tccm_ros.records import Wall
from tccm_ros.slam.base_attitude import LEVEL, Attitude, with_attitude
from tccm_ros.slam.front_end import GraphKeyframe, TrackedPose
from tccm_ros.slam.se2 import compose_se2, rotate_covariance
from tccm_ros.slam.walls.association import GATE_CHI2, GATE_SIGMAS
from tccm_ros.slam.walls.lines import Lines, line_covariance
from tccm_ros.slam.walls.merging import MAX_DPHI

INNOVATION_CHI2 = 13.8
"""Gate on the squared Mahalanobis distance of a line from its wall: 99.9 % of two degrees of
freedom."""


class LivePose(NamedTuple):
    """The live estimate of the base's pose.

    Attributes
    ----------
    stamp_ns
        Stamp of the newest scan, or of the newest odometry without a level laser; -1 before the
        first.
    pose
        float64 (3,), (x, y, yaw) of base in map.
    map_odom
        float64 (3,), planar pose of the odometry frame in map: ``pose * odom^-1``.
    attitude
        Height, roll and pitch of the base by odometry.
    """

    stamp_ns: int
    pose: Float64
    map_odom: Float64
    attitude: Attitude = LEVEL

    @property
    def T_map_base(self) -> Float64:
        """The pose of the base in map, float64 (4, 4)."""
        return with_attitude(self.pose, self.attitude)


class MapWalls(NamedTuple):
    """Walls of a solution, with the side of observation.

    Attributes
    ----------
    phi, rho
        float64 (W,), rad and m: ``x cos phi + y sin phi = rho``; phi points away from the observer.
    extent
        float64 (W, 2), minimum and maximum position along the tangent (-sin phi, cos phi), m.
    """

    phi: Float64
    rho: Float64
    extent: Float64

    @classmethod
    def of(cls, walls: Sequence[Wall], p_map_walls: Float64) -> MapWalls:
        """Return walls transformed to map.

        Parameters
        ----------
        walls
            Walls in a common frame.
        p_map_walls
            Planar pose (3,) of that frame in map.
        """
        facing = np.array([0.0 if wall.is_seen_from_origin else np.pi for wall in walls])
        phi = np.array([wall.phi for wall in walls]) + facing + p_map_walls[2]
        own = np.array([wall.endpoints for wall in walls]).reshape(-1, 2)
        ends = transform2(p_map_walls, own).reshape(-1, 2, 2)
        normals = np.stack([np.cos(phi), np.sin(phi)], axis=1)
        tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        along = np.einsum("wek,wk->we", ends, tangents)
        rho = np.einsum("wek,wk->we", ends, normals).mean(axis=1)
        return cls(wrap_angle(phi), rho, np.sort(along, axis=1))


class SolvedKeyframe(NamedTuple):
    """The newest keyframe of a solution.

    Attributes
    ----------
    id
        Id of the keyframe.
    pose
        float64 (3,), in map.
    cov
        float64 (3, 3) of (x, y, yaw) in the keyframe's own frame.
    """

    id: int
    pose: Float64
    cov: Float64


NO_WALLS = MapWalls(np.zeros(0), np.zeros(0), np.zeros((0, 2)))


class _Estimate(NamedTuple):
    """Pose (3,) of a keyframe in map, and covariance (3, 3) of (x, y, yaw) along map's axes."""

    pose: Float64
    cov: Float64


class LiveEstimate:
    """The pose of the newest keyframe in the map of the newest solution.

    Parameters
    ----------
    config
        Group `walls`.
    """

    def __init__(self, config: Config):
        self._config = config
        self._since: deque[tuple[GraphKeyframe, Lines]] = deque()
        self._solved: SolvedKeyframe | None = None
        self._walls = NO_WALLS
        self._newest: _Estimate | None = None
        self._session = -1

    def add(self, keyframe: GraphKeyframe, lines: Lines, start: Float64 | None = None) -> None:
        """Add the next keyframe of the front end, and its lines in its own frame.

        Parameters
        ----------
        keyframe, lines
            The keyframe and its lines.
        start
            float64 (3,), pose in map of the first keyframe of a session, if known.
        """
        if keyframe.session != self._session:  # the robot was lost: its place is unknown
            self._since.clear()
            self._session, self._newest, self._solved, self._walls = (
                keyframe.session, None, None, NO_WALLS,
            )  # fmt: skip
        self._since.append((keyframe, lines))
        self._newest = self._after(self._newest, keyframe, lines)
        if start is not None:
            self._newest = _Estimate(start, np.zeros((3, 3)))

    def take(self, solved: SolvedKeyframe, walls: MapWalls) -> bool:
        """Continue from a solution; return whether its newest keyframe is of this session.

        Parameters
        ----------
        solved
            The newest keyframe of the solution.
        walls
            The solution's walls, in map.
        """
        if not self._since or not self._since[0][0].id <= solved.id <= self._since[-1][0].id:
            return False
        while self._since[0][0].id < solved.id:
            self._since.popleft()
        self._solved, self._walls = solved, walls
        self._newest = _Estimate(solved.pose, np.zeros((3, 3)))
        for keyframe, lines in list(self._since)[1:]:
            self._newest = self._after(self._newest, keyframe, lines)
        return True

    def pose(self, tracked: TrackedPose) -> Float64:
        """Return the pose float64 (3,) in map of a scan that is relative to the newest keyframe."""
        assert self._newest is not None
        return compose_se2(self._newest.pose, tracked.pose)

    def covariance(self, tracked: TrackedPose) -> Float64:
        """Return the covariance float64 (3, 3) of (x, y, yaw) in map of such a pose.

        The covariance of the solution's newest keyframe, whose yaw error acts over the distance
        driven since, plus the covariance of the motion since.
        """
        assert self._newest is not None
        pose = self.pose(tracked)
        cov = moved_covariance(self._newest.cov, self._newest.pose, pose)
        cov += rotate_covariance(tracked.cov, float(pose[2]))
        if self._solved is not None:
            start = self._solved.pose
            cov += moved_covariance(
                rotate_covariance(self._solved.cov, float(start[2])), start, pose
            )
        return cov

    def _after(self, before: _Estimate | None, keyframe: GraphKeyframe, lines: Lines) -> _Estimate:
        """Return the estimate of a keyframe from that of the previous one."""
        if before is None:
            return _Estimate(keyframe.pose.copy(), np.zeros((3, 3)))
        pose = compose_se2(before.pose, keyframe.delta)
        cov = moved_covariance(before.cov, before.pose, pose)
        estimate = _Estimate(pose, cov + rotate_covariance(keyframe.cov, float(pose[2])))
        if not len(self._walls.phi):
            return estimate
        for i in range(len(lines)):
            w = self._wall_of(lines, i, estimate.pose)
            if w >= 0:
                estimate = self._updated(estimate, lines, i, w)
        return estimate

    def _wall_of(self, lines: Lines, i: int, pose: Float64) -> int:
        """Return the nearest wall of a line within the association gates, -1 for none."""
        walls, gates = self._walls, self._config.walls
        ends = transform2(pose, lines.endpoints[i])
        dphi = wrap_angle(lines.phi[i] + pose[2] - walls.phi)
        normals = np.stack([np.cos(walls.phi), np.sin(walls.phi)])
        along = ends @ np.stack([-normals[1], normals[0]])
        low, high = along.min(axis=0), along.max(axis=0)
        away = ends.mean(axis=0) @ normals - walls.rho
        variance = (gates.gate_angle / GATE_SIGMAS) ** 2 + lines.cov[i, 0, 0]
        chi2 = dphi**2 / variance + (away * GATE_SIGMAS / gates.gate_distance) ** 2
        is_beyond = (low > walls.extent[:, 1] + gates.max_gap) | (
            high < walls.extent[:, 0] - gates.max_gap
        )
        chi2[is_beyond | (np.abs(dphi) > MAX_DPHI)] = np.inf
        nearest = int(np.argmin(chi2))
        return nearest if chi2[nearest] < GATE_CHI2 else -1

    def _updated(self, estimate: _Estimate, lines: Lines, i: int, w: int) -> _Estimate:
        """Return an estimate updated by line i of wall w; covariance in Joseph form."""
        phi, rho = float(self._walls.phi[w]), float(self._walls.rho[w])
        x, y, yaw = estimate.pose
        c, s = np.cos(phi), np.sin(phi)
        innovation = np.array(
            [wrap_angle(lines.phi[i] - (phi - yaw)), lines.rho[i] - (rho - x * c - y * s)]
        )
        H = np.array([[0.0, 0.0, -1.0], [-c, -s, 0.0]])
        R = line_covariance(lines, i, self._config)
        S = H @ estimate.cov @ H.T + R
        if innovation @ np.linalg.solve(S, innovation) > INNOVATION_CHI2:
            return estimate
        K = np.linalg.solve(S, H @ estimate.cov).T
        pose = estimate.pose + K @ innovation
        pose[2] = wrap_angle(pose[2])
        left = np.eye(3) - K @ H
        return _Estimate(pose, left @ estimate.cov @ left.T + K @ R @ K.T)


def moved_covariance(cov: Float64, start: Float64, end: Float64) -> Float64:
    """Return the covariance in map of a pose relative to another, with the lever of its yaw error.

    Parameters
    ----------
    cov
        float64 (3, 3) of (x, y, yaw) of `start`, along map's axes.
    start, end
        float64 (3,), planar poses in map.
    """
    lever = np.eye(3)
    lever[:2, 2] = start[1] - end[1], end[0] - start[0]
    moved: Float64 = lever @ cov @ lever.T
    return moved
