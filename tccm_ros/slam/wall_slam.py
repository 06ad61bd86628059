"""Wall SLAM: level scans and odometry in, a graph of keyframes and walls out (DESIGN section 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.geometry import planar
from tccm_ros.records import Keyframe, Loop, PosedScan, ScanPose
from tccm_ros.slam.chain import Chain, View
from tccm_ros.slam.corners import Corner, corner_factors, find_corners
from tccm_ros.slam.factors import Factor, Key, view_key
from tccm_ros.slam.front_end import FrontEnd, GraphKeyframe
from tccm_ros.slam.graph import GraphSolution
from tccm_ros.slam.landmarks import judge_walls, wall_factors, wall_records
from tccm_ros.slam.level_scan import LevelScan, level_scan
from tccm_ros.slam.lines import Lines, extract_lines
from tccm_ros.slam.loop_proposals import Proposal
from tccm_ros.slam.loop_selection import settle_loops
from tccm_ros.slam.loops import LoopCloser, loop_factor
from tccm_ros.slam.saved_walls import pack_state, unpack_state
from tccm_ros.slam.se2 import between, compose, inverse
from tccm_ros.slam.solution import Solution
from tccm_ros.slam.structure import structure_factors
from tccm_ros.slam.trajectory import OdometryTrack, place_stamps, scan_poses
from tccm_ros.slam.walls import WallTable, associate_walls, confirmations

__all__ = ["LivePose", "WallSlam"]

Float64 = NDArray[np.float64]


USED_TWICE = 2.3
"""Multiplies the reported covariances where walls and matching have used the same beams: the NEES
of simulated rings says how much of the information is the same."""


class LivePose(NamedTuple):
    """Where the base is believed to be now.

    Attributes
    ----------
    stamp_ns
        Of the newest scan, or the newest odometry without a level laser; -1 before the first.
    pose
        float64 (3,), (x, y, yaw) of base in map.
    map_odom
        float64 (3,), planar pose of the odometry frame in map: ``pose * odom^-1``.
    localised
        Whether the pose is in the frame of the map that was loaded (always without one).
    """

    stamp_ns: int
    pose: Float64
    map_odom: Float64
    localised: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class _Settled:
    """What `solve` needs and views do not change."""

    poses: Float64
    loops: list[Proposal]
    records: list[Loop]
    table: WallTable
    corners: list[Corner]
    scale: float


class WallSlam:
    """The processor: add records as they come, solve when a result is wanted."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self._keyframes: list[GraphKeyframe] = []
        self._lines: list[Lines] = []
        self._chain = Chain()
        self._closer = LoopCloser(config, self._keyframes, self._chain)
        self._front = FrontEnd(config)
        self._odometry = OdometryTrack()
        self._live = LivePose(-1, np.zeros(3), np.zeros(3))
        self._settled: tuple[tuple[int, int], _Settled] | None = None

    # -- input ---------------------------------------------------------------------------------

    def add_scan(self, scan: PosedScan) -> ScanPose:
        """Match a level scan; scans must come in the order of their stamps.

        Raises
        ------
        ValueError
            For a scan that is not newer than the one before it.
        """
        if self._front.placed and scan.scan.stamp_ns <= self._front.placed[-1].stamp_ns:
            raise ValueError(f"level scan at {scan.scan.stamp_ns} ns is not newer than the last")
        level = level_scan(scan, self.config)
        placed = self._front.add(level, self._start(level.odom))
        became = self._take_keyframes()
        pose = compose(self._closer.poses[placed.keyframe], placed.pose)
        localised = self._front.session in self._closer.tied
        map_odom = compose(pose, inverse(level.odom))
        self._live = LivePose(level.stamp_ns, pose, map_odom, localised)
        return ScanPose(placed.stamp_ns, pose, became)

    def add_odometry(self, stamp_ns: int, T_odom_base: Float64) -> None:
        """Add an odometry sample, in any order: poses between scans, and all without scans."""
        self._odometry.add(stamp_ns, np.asarray(T_odom_base, float))
        if not self._front.placed and stamp_ns >= self._live.stamp_ns:
            odom = planar(T_odom_base)
            pose = self._start(odom)
            localised = self._front.session in self._closer.tied
            self._live = LivePose(stamp_ns, pose, compose(pose, inverse(odom)), localised)

    def motion_between(self, first_ns: int, last_ns: int) -> Float64 | None:
        """Return the pose (3,) of the base at one stamp in that at another, as known so far.

        None where it is not known well: over keyframes, or without odometry.
        """
        if self._front.placed:
            first, last = self._hang([first_ns, last_ns])
            return between(first.pose, last.pose) if first.keyframe == last.keyframe else None
        if not len(self._odometry):
            return np.zeros(3)
        start, end = self._odometry.at(first_ns), self._odometry.at(last_ns)
        return None if start is None or end is None else between(start, end)

    def current_pose(self) -> LivePose:
        """Return the live estimate."""
        return self._live

    def _start(self, odom: Float64) -> Float64:
        """Return where odometry pose (3,) is in map: the first base pose is the origin."""
        if not len(self._odometry):
            return np.zeros(3)
        return between(self._odometry.first(), odom)

    def _take_keyframes(self) -> int:
        """Take over a keyframe of the front end, if the last scan became one; return its id."""
        done = len(self._keyframes) - self._front.first_id
        for keyframe in self._front.keyframes[done:]:
            scan = keyframe.scan
            self._add_keyframe(keyframe, extract_lines(scan.beams, scan.origin, self.config))
            return keyframe.id
        return -1

    def _add_keyframe(self, keyframe: GraphKeyframe, lines: Lines) -> None:
        self._keyframes.append(keyframe)
        self._lines.append(lines)
        self._chain.add(keyframe, lines.phi)
        self._closer.add(keyframe.id)

    # -- result --------------------------------------------------------------------------------

    def solve(
        self,
        views: Sequence[int] = (),
        factors: Sequence[Factor] = (),
        *,
        every_covariance: bool = True,
    ) -> Solution:
        """Rebuild the graph in stamp order and optimise it as a batch.

        Parameters
        ----------
        views
            Stamps (ns) of surface clouds; each gets a pose of its own, `view_key(index)`.
        factors
            More factors between views, keyframes and landmarks.
        every_covariance
            Whether all keyframes get their covariance, which takes most of the time in a graph
            with many loops, or the newest alone.

        Returns
        -------
        Solution
            The same for the same records, whatever was asked before.
        """
        nothing = not self._front.placed and not self._keyframes
        if nothing and len(self._odometry):
            return self._on_odometry().solve(views, factors, every_covariance=every_covariance)
        if nothing:
            return _empty(len(views))
        settled = self._settle()
        keys, walls = self._chain.keys, self.config.walls.enabled
        hung = self._hang(views)
        graph = self._chain.graph(settled.poses, self._closer.tied, hung)
        graph.add([loop_factor(p, keys) for p in settled.loops])
        if walls:
            graph.add(self._wall_factors(settled))
        graph.add(factors)
        solution = graph.optimise()
        poses = solution.planar_poses(keys)
        view_keys = [view_key(v) for v in range(len(views))]
        return Solution(
            [Keyframe(k.id, k.scan.stamp_ns, pose) for k, pose in zip(self._keyframes, poses)],
            wall_records(settled.table, settled.corners, solution, settled.scale) if walls else [],
            settled.records,
            np.array([p.stamp_ns for p in self._front.placed], np.int64),
            scan_poses(self._front.placed, self._keyframes, poses),
            np.array([solution.pose(key) for key in view_keys]).reshape(-1, 4, 4),
            np.array([solution.covariance(key) for key in view_keys]).reshape(-1, 6, 6),
            np.array([v.keyframe for v in hung], np.int64),
            _covariances(solution, keys, every_covariance) * settled.scale,
            settled.scale,
        )

    def _wall_factors(self, settled: _Settled) -> list[Factor]:
        keys = self._chain.keys
        factors = wall_factors(settled.table, self._lines, keys, self.config)
        factors += corner_factors(settled.corners, settled.table, keys)
        if self.config.walls.structure_prior:
            factors += structure_factors(settled.table)
        return factors

    def _settle(self) -> _Settled:
        """Settle loops and walls; once, as long as no record comes."""
        now = len(self._front.placed), len(self._odometry)
        if self._settled is None or self._settled[0] != now:
            self._settled = now, self._settle_anew()
        return self._settled[1]

    def _settle_anew(self) -> _Settled:
        closer = self._closer
        poses, kept = settle_loops(self._chain, closer.poses, closer.tied, closer.accepted)
        loops = [p for p, ok in zip(closer.accepted, kept) if ok]
        doubted = [p for p, ok in zip(closer.accepted, kept) if not ok]
        doubted = [replace(p, reason="contradicts the other loops") for p in doubted]
        records = [Loop(p.a, p.b, p.delta, True, "consistent") for p in loops]
        for p in [*doubted, *closer.rejected, *closer.unconfirmed]:
            records.append(Loop(p.a, p.b, p.delta, False, p.reason))
        graph = self._chain.graph(poses, closer.tied)
        graph.add([loop_factor(p, self._chain.keys) for p in loops])
        table = associate_walls(poses, self._lines, self.config)
        judgement = judge_walls(table, self._lines, poses, graph, self._chain, self.config)
        scale = judgement.unit_variance * (USED_TWICE if self.config.walls.enabled else 1.0)
        least = confirmations(self.config, len(self._keyframes))
        corners = find_corners(judgement.table, self._lines, least)
        return _Settled(poses, loops, records, judgement.table, corners, scale)

    def _on_odometry(self) -> WallSlam:
        """Return a twin with keyframes on odometry alone."""
        twin = WallSlam(self.config)
        nothing = np.zeros((0, 2))
        twin._odometry = self._odometry
        for stamp, odom in zip(*self._odometry.arrays()):
            scan = LevelScan(int(stamp), odom, nothing, np.zeros(2), nothing, nothing)
            twin._front.add(scan)
            twin._take_keyframes()
        return twin

    def _hang(self, views: Sequence[int]) -> list[View]:
        placed = place_stamps(
            views, self._front.placed, self._keyframes, self._odometry, self.config.odometry
        )
        return [View(int(k), pose, cov) for k, pose, cov in zip(*placed)]

    # -- saved maps ----------------------------------------------------------------------------

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the map as named arrays, for `from_state`.

        It holds the keyframes with their scans and lines, their settled poses, and the loop
        closures; not the trajectory between keyframes.
        """
        if not self._keyframes:
            return pack_state([], [], np.zeros((0, 3)), [])
        poses = np.array([k.pose for k in self.solve().keyframes])
        loops = self._settle().loops
        return pack_state(self._keyframes, self._lines, poses, loops)

    @classmethod
    def from_state(cls, config: Config, state: Mapping[str, NDArray[Any]]) -> WallSlam:
        """Go on with a saved map: the robot may start anywhere in it, or outside.

        Raises
        ------
        MapError
            For arrays that are missing or do not fit each other.
        """
        slam = cls(config)
        keyframes, lines, poses, loops = unpack_state(state)
        for keyframe, x in zip(keyframes, lines):
            slam._keyframes.append(keyframe)
            slam._lines.append(x)
            slam._chain.add(keyframe, x.phi)
        if config.graph.mode == "localisation":
            slam._chain.fixed = dict(enumerate(poses))
        slam._closer.load(poses, loops)
        session = 1 + max((k.session for k in keyframes), default=-1)
        slam._front = FrontEnd(config, first_id=len(keyframes), session=session)
        slam._live = slam._live._replace(localised=not keyframes)
        return slam


def _covariances(solution: GraphSolution, keys: Sequence[Key], every: bool) -> Float64:
    """Return planar covariances (K, 3, 3), NaN where they are not wanted."""
    covs = np.full((len(keys), 3, 3), np.nan)
    for index in range(0 if every else len(keys) - 1, len(keys)):
        covs[index] = solution.planar_covariance(keys[index])
    return covs


def _empty(views: int) -> Solution:
    T = np.broadcast_to(np.eye(4), (views, 4, 4)).copy()
    none = np.zeros(0, np.int64)
    zeros = np.zeros((views, 6, 6))
    return Solution(
        [], [], [], none, np.zeros((0, 3)), T, zeros, np.zeros(views, np.int64), np.zeros((0, 3, 3))
    )
