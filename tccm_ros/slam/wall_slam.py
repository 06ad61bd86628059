"""Wall SLAM: level scans and odometry in, a graph of keyframes and walls out (DESIGN section 7)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import planar
from tccm_ros.records import Keyframe, LandmarkObservation, PosedScan, ScanPose
from tccm_ros.slam.chain import Chain, HungPose
from tccm_ros.slam.corners import corner_factors
from tccm_ros.slam.factors import Factor, Key, landmark_class, view_key
from tccm_ros.slam.front_end import FrontEnd, GraphKeyframe
from tccm_ros.slam.graph import GraphSolution
from tccm_ros.slam.inliers import Inliers, select_inliers
from tccm_ros.slam.landmarks import Sighting, landmark_factors, landmark_records
from tccm_ros.slam.level_scan import LevelScan, level_scan
from tccm_ros.slam.lines import LabelBeams, Lines, extract_lines, label_by_splitting
from tccm_ros.slam.loops import LoopCloser
from tccm_ros.slam.saved_walls import SavedWalls, pack_state, unpack_state
from tccm_ros.slam.se2 import between, compose, inverse
from tccm_ros.slam.solution import Solution, empty_solution
from tccm_ros.slam.trajectory import OdometryTrack, place_stamps, scan_poses
from tccm_ros.slam.wall_landmarks import structure_factors, wall_factors, wall_records

__all__ = ["LivePose", "WallSlam"]


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


class WallSlam:
    """Estimate the trajectory and the walls: add records as they come, solve for a result.

    Parameters
    ----------
    config
        All groups but those of the TCCM and the surfaces.
    label
        Assigns the beams of a level scan to line segments (see `extract_lines`).
    """

    def __init__(self, config: Config, label: LabelBeams = label_by_splitting) -> None:
        self.config = config
        self._label = label
        self._lines: list[Lines] = []
        self._chain = Chain()
        self._closer = LoopCloser(config, self._chain)
        self._front = FrontEnd(config)
        self._odometry = OdometryTrack()
        self._live = LivePose(-1, np.zeros(3), np.zeros(3))
        # Landmarks: seen in earlier sessions, in this one, and not yet hung on its keyframes.
        self._saved_sightings: Sequence[Sighting] = ()
        self._observed: list[LandmarkObservation] = []
        self._unhung: list[LandmarkObservation] = []
        self._selected: tuple[tuple[int, ...], Inliers] | None = None

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

    def add_landmark(self, observation: LandmarkObservation) -> None:
        """Add an observation of a landmark, in any order.

        The live estimate takes it with the keyframe after it. An observation that comes later than
        that keyframe counts as much in a solution, but the search for loops did not know it yet.

        Raises
        ------
        ValueError
            For a kind that is not registered.
        """
        landmark_class(observation.kind)
        self._observed.append(observation)
        self._unhung.append(observation)

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
        done = len(self._chain.keyframes) - self._front.first_id
        for keyframe in self._front.keyframes[done:]:
            scan = keyframe.scan
            lines = extract_lines(scan.beams, scan.origin, self.config, self._label)
            self._add_keyframe(keyframe, lines)
            return keyframe.id
        return -1

    def _add_keyframe(self, keyframe: GraphKeyframe, lines: Lines) -> None:
        self._lines.append(lines)
        self._chain.add(keyframe, lines.phi)
        stamp = keyframe.scan.stamp_ns
        seen = _by_stamp(o for o in self._unhung if o.stamp_ns <= stamp)
        self._unhung = [o for o in self._unhung if o.stamp_ns > stamp]
        self._closer.add(keyframe.id, self._hang_sightings(seen))

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
        nothing = not self._front.placed and not self._chain.keyframes
        if nothing and len(self._odometry):
            return self._on_odometry().solve(views, factors, every_covariance=every_covariance)
        if nothing:
            return empty_solution(len(views))
        used, keys = self._inliers(), self._chain.keys
        hung = self._hang(views)
        view_keys = [view_key(v) for v in range(len(views))]
        seen = landmark_factors(used.sightings, unit_variance=used.scale)
        poses_hung = {**dict(zip(view_keys, hung)), **seen.hung}
        graph = self._chain.graph(used.poses, self._closer.tied, poses_hung)
        graph.add([p.factor(keys) for p in used.loops])
        if self.config.walls.enabled:
            graph.add(self._wall_factors(used))
        graph.add(factors)
        graph.add(seen.factors)
        solution = graph.optimise()
        poses, keyframes = solution.planar_poses(keys), self._chain.keyframes
        return Solution(
            [Keyframe(k.id, k.scan.stamp_ns, pose) for k, pose in zip(keyframes, poses)],
            wall_records(used.walls, used.corners, solution, used.scale),
            used.records,
            np.array([p.stamp_ns for p in self._front.placed], np.int64),
            scan_poses(self._front.placed, keyframes, poses),
            np.array([solution.pose(key) for key in view_keys]).reshape(-1, 4, 4),
            np.array([solution.covariance(key) for key in view_keys]).reshape(-1, 6, 6),
            np.array([v.keyframe for v in hung], np.int64),
            _covariances(solution, keys, every_covariance) * used.scale,
            used.scale,
            landmark_records(used.sightings, solution, used.scale),
        )

    def _wall_factors(self, used: Inliers) -> list[Factor]:
        keys = self._chain.keys
        factors = wall_factors(used.walls, self._lines, keys, self.config)
        factors += corner_factors(used.corners, used.walls, keys)
        if self.config.walls.structure_prior:
            factors += structure_factors(used.walls)
        return factors

    def _inliers(self) -> Inliers:
        """Select inliers; once, as long as no record comes."""
        now = len(self._front.placed), len(self._odometry), len(self._observed)
        if self._selected is None or self._selected[0] != now:
            inliers = select_inliers(
                self._closer, self._chain, self._lines, self._sightings(), self.config
            )
            self._selected = now, inliers
        return self._selected[1]

    def _on_odometry(self) -> WallSlam:
        """Return a twin with keyframes on odometry alone."""
        twin = WallSlam(self.config, self._label)
        nothing = np.zeros((0, 2))
        twin._odometry = self._odometry
        for observation in self._observed:
            twin.add_landmark(observation)
        for stamp, odom in zip(*self._odometry.arrays()):
            scan = LevelScan(int(stamp), odom, nothing, np.zeros(2), nothing, nothing)
            twin._front.add(scan)
            twin._take_keyframes()
        return twin

    def _hang(self, stamps_ns: Sequence[int]) -> list[HungPose]:
        placed = place_stamps(
            stamps_ns,
            self._front.placed,
            self._chain.keyframes,
            self._odometry,
            self.config.odometry,
        )
        return [HungPose(int(k), pose, cov) for k, pose, cov in zip(*placed)]

    def _hang_sightings(self, seen: Sequence[LandmarkObservation]) -> list[Sighting]:
        hung = self._hang([o.stamp_ns for o in seen])
        return [Sighting(o, h) for o, h in zip(seen, hung)]

    def _sightings(self) -> list[Sighting]:
        """Return the sightings of all sessions in the map's frame, this one's by their stamps."""
        seen = _by_stamp(self._observed)
        if not self._front.placed or self._front.session not in self._closer.tied:
            seen = []
        return [*self._saved_sightings, *self._hang_sightings(seen)]

    # -- saved maps ----------------------------------------------------------------------------

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the map as named arrays, for `from_state`.

        It holds the keyframes with their scans and lines, their settled poses, the loop closures
        and the observations of landmarks; not the trajectory between keyframes.
        """
        if not self._chain.keyframes:
            return pack_state(SavedWalls([], [], np.zeros((0, 3)), [], []))
        poses = np.array([k.pose for k in self.solve().keyframes])
        used, keyframes = self._inliers(), self._chain.keyframes
        return pack_state(SavedWalls(keyframes, self._lines, poses, used.loops, used.sightings))

    @classmethod
    def from_state(
        cls,
        config: Config,
        state: Mapping[str, NDArray[Any]],
        label: LabelBeams = label_by_splitting,
    ) -> WallSlam:
        """Go on with a saved map: the robot may start anywhere in it, or outside.

        Parameters
        ----------
        config, label
            As for the constructor.
        state
            What `state` returned.

        Raises
        ------
        MapError
            For arrays that are missing or do not fit each other.
        """
        slam = cls(config, label)
        saved = unpack_state(state)
        for keyframe, lines in zip(saved.keyframes, saved.lines):
            slam._lines.append(lines)
            slam._chain.add(keyframe, lines.phi)
        if config.graph.mode == "localisation":
            slam._chain.fixed = dict(enumerate(saved.poses))
        slam._saved_sightings = saved.sightings
        slam._closer.load(saved.poses, saved.loops, saved.sightings)
        keyframes = saved.keyframes
        session = 1 + max((k.session for k in keyframes), default=-1)
        slam._front = FrontEnd(config, first_id=len(keyframes), session=session)
        slam._live = slam._live._replace(localised=not keyframes)
        return slam


def _by_stamp(seen: Iterable[LandmarkObservation]) -> list[LandmarkObservation]:
    return sorted(seen, key=lambda o: (o.stamp_ns, o.kind, o.id))


def _covariances(solution: GraphSolution, keys: Sequence[Key], every: bool) -> Float64:
    """Return planar covariances (K, 3, 3), NaN where they are not wanted."""
    covs = np.full((len(keys), 3, 3), np.nan)
    for index in range(0 if every else len(keys) - 1, len(keys)):
        covs[index] = solution.planar_covariance(keys[index])
    return covs
