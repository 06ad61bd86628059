"""Wall SLAM: a graph of keyframes and walls from level scans and odometry.

The method is described in docs/design/wall_slam.md.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import (
    Keyframe,
    LandmarkObservation,
    MapOdom,
    PoseCovariance,
    PosedScan,
    PoseGuess,
    RollPitch,
    ScanPose,
)
from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement
from tccm_ros.slam.base_attitude import attitude_of
from tccm_ros.slam.chain import AnchoredPose, KeyframeChain
from tccm_ros.slam.external_poses import reweigh
from tccm_ros.slam.factors.factor import Factor, by_variables
from tccm_ros.slam.factors.keys import Key, view_key
from tccm_ros.slam.factors.landmarks import landmark_class
from tccm_ros.slam.factors.views import BetweenViews
from tccm_ros.slam.front_end import FrontEnd, GraphKeyframe
from tccm_ros.slam.graph.pose_graph import GraphSolution, PoseGraph
from tccm_ros.slam.growth import MIN_KEYFRAMES, Growth
from tccm_ros.slam.inliers import Inliers, select_inliers
from tccm_ros.slam.landmarks import AnchoredObservation, landmark_factors, landmark_records
from tccm_ros.slam.live_estimate import SolvedKeyframe
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.matching.level_scan import LevelScan, make_level_scan
from tccm_ros.slam.measurements import Measurements
from tccm_ros.slam.odometry_front_end import OdometryFrontEnd
from tccm_ros.slam.saved_walls import SavedWalls, pack_walls, unpack_walls
from tccm_ros.slam.se2 import between_se2, compose_se2, inverse_se2
from tccm_ros.slam.signs.landmarks import sign_factors, sign_observations, sign_records
from tccm_ros.slam.signs.views import PictureView, SignView, sign_order
from tccm_ros.slam.solution import Solution, empty_solution
from tccm_ros.slam.systematic import systematic_covariances
from tccm_ros.slam.trajectory import poses_at_stamps, scan_poses
from tccm_ros.slam.walls.corners import corner_factors, uses_corners
from tccm_ros.slam.walls.known_poses import walls_at
from tccm_ros.slam.walls.landmarks import wall_factors, wall_records
from tccm_ros.slam.walls.lines import NO_LINES, LabelBeams, Lines, extract_lines, label_by_splitting

SIGN_DELAY_NS = 1_000_000_000
"""Delay after which a sign measurement is used in the search for loop closures. Chosen: reading a
picture takes up to 0.15 s, so that the result does not depend on the processing time."""


Seen = TypeVar("Seen", AnchoredObservation, SignView)
Record = TypeVar("Record", LandmarkObservation, SignMeasurement, SearchedPicture)
Anchored = TypeVar("Anchored")


class _ChangingContent(NamedTuple):
    """The content of the graph beside keyframes, loop closures and lines.

    Attributes
    ----------
    views
        The views, anchored to keyframes, by variable.
    observations
        Observations of landmarks and signs.
    starts, anchors
        Start values (4, 4) of the poses of views and observations, and their factors by name.
    others
        All other factors by name.
    """

    views: Mapping[Key, AnchoredPose]
    observations: list[AnchoredObservation]
    starts: Mapping[Key, Float64]
    anchors: dict[Hashable, Factor]
    others: dict[Hashable, Factor]

    @property
    def factors(self) -> dict[Hashable, Factor]:
        """All factors by name."""
        return self.anchors | self.others


class WallSlam:
    """Estimates the trajectory and the walls: add records, then solve.

    Parameters
    ----------
    config
        All groups except those of the TCCM and the surfaces.
    label
        Function that assigns the beams of a level scan to line segments (see `extract_lines`).
    measurements
        Measurements beside the level scans, which the methods add to; none by default.
    front_end
        Tracks scans and makes keyframes; by default a new one, by matching.
    """

    def __init__(
        self,
        config: Config,
        label: LabelBeams = label_by_splitting,
        measurements: Measurements | None = None,
        front_end: FrontEnd | None = None,
    ) -> None:
        self.config = config
        self.label = label
        self._lines: list[Lines] = []
        self._chain = KeyframeChain()
        is_mapping = config.graph.mode == "mapping"
        self._closer = LoopCloser(config, self._chain, begins_trajectories=is_mapping)
        self._front = front_end or FrontEnd(config)
        self._first_session = 0
        self._measured = measurements or Measurements()
        self._odometry_front = OdometryFrontEnd(config)
        self._newest: LevelScan | None = None
        # Stamps and lines of level scans whose walls do not move the poses.
        self._wall_scans: list[tuple[int, Lines]] = []
        self._is_pose_given = False
        # Landmark observations of earlier sessions, and those not yet anchored.
        self._saved_observations: Sequence[AnchoredObservation] = ()
        self._unanchored = list(self._measured.landmarks)
        # Door signs of earlier sessions, and those not yet used in the search for loop closures.
        self._saved_signs: Sequence[SignView] = ()
        self._unread: list[SignMeasurement] = []
        self._selected: tuple[tuple[int, ...], Inliers] | None = None
        # The continued graph of the last batch, the number of signs in it, and the additional
        # factors of the last solution.
        self._growth: Growth | None = None
        self._solved_signs = 0
        self._between: Sequence[Factor] = ()

    # -- input ---------------------------------------------------------------------------------

    def add_scan(self, scan: PosedScan) -> ScanPose:
        """Match a level scan and return its pose; scans must be added in stamp order.

        Raises
        ------
        ValueError
            For a scan that is not newer than the previous one.
        """
        if self._front.tracked and scan.scan.stamp_ns <= self._front.tracked[-1].stamp_ns:
            raise ValueError(f"level scan at {scan.scan.stamp_ns} ns is not newer than the last")
        level = make_level_scan(scan, self.config)
        self._expect(level)
        tracked = self._front.add(level, self._start(level.odom))
        self._newest = level
        if not len(self._measured.odometry):  # the base pose is from tf, or unknown
            self._measured.attitudes.add(level.stamp_ns, level.attitude)
        keyframe_id = self._take_keyframe()
        if keyframe_id < 0:
            self._closer.relocalise(level, tracked)
        pose = compose_se2(self._closer.poses[tracked.keyframe], tracked.pose)
        return ScanPose(tracked.stamp_ns, pose, keyframe_id)

    def add_scan_of_walls(self, scan: PosedScan) -> None:
        """Keep the lines of a level scan, in stamp order, for walls that do not move the poses.

        One scan is kept for each motion of a keyframe.
        """
        level = make_level_scan(scan, self.config)
        newest = self._newest
        if newest and max(self._front.step_fractions(between_se2(newest.odom, level.odom))) <= 1.0:
            return
        self._newest = level
        lines = extract_lines(level.beams, level.origin, self.config, self.label)
        self._wall_scans.append((level.stamp_ns, lines))

    def add_odometry(self, stamp_ns: int, T_odom_base: Float64) -> None:
        """Add an odometry sample, in any order; used between scans, or without scans."""
        self._measured.odometry.add(stamp_ns, np.asarray(T_odom_base, float))
        self._measured.attitudes.add(stamp_ns, attitude_of(T_odom_base))

    def add_map_odom(self, map_odom: MapOdom) -> None:
        """Add a pose of the odometry frame by an external localisation."""
        self._measured.map_odom.add(map_odom)

    def add_pose_covariance(self, record: PoseCovariance) -> None:
        """Add the covariance of a pose by an external localisation."""
        self._measured.map_odom.add_covariance(record)

    @property
    def waits_for_external_pose(self) -> bool:
        """Whether the external localisation is configured, but has given no pose yet."""
        return self.config.localisation.is_external and not len(self._measured.map_odom)

    def add_roll_pitch(self, sample: RollPitch) -> None:
        """Add roll and pitch of the base, in stamp order; used for views."""
        self._measured.roll_pitch.add(sample)

    def add_landmark(self, observation: LandmarkObservation) -> None:
        """Add an observation of a landmark, in any order.

        It is used in the live estimate from the next keyframe on. An observation that arrives later
        is used in solutions, but was missing in the search for loop closures.

        Raises
        ------
        ValueError
            For a kind that is not registered.
        """
        landmark_class(observation.kind)
        self._measured.landmarks.append(observation)
        self._unanchored.append(observation)

    def add_sign(self, sign: SignMeasurement) -> None:
        """Add a measurement of a door sign, in any order.

        It is used in the search for loop closures after `SIGN_DELAY_NS`; one that arrives later is
        used in solutions only.
        """
        self._measured.signs.append(sign)
        self._unread.append(sign)

    def add_picture(self, picture: SearchedPicture) -> None:
        """Add a picture that was searched for signs, in any order.

        A miss of a sign that it should show reduces the probability of that sign.
        """
        self._measured.pictures.append(picture)

    def add_guess(self, guess: PoseGuess) -> None:
        """Begin a session with the next scan, and relocalise around a user-supplied pose.

        The place is accepted once a scan fits the map there, and better than at the place expected
        by tracking; otherwise that one is kept.
        """
        self._front.is_lost = self._is_pose_given = bool(self._front.tracked)
        self._closer.relocalise_around(guess)

    def _expect(self, level: LevelScan) -> None:
        """Set the expected place of the first scan of a session, from tracking."""
        is_pose_given, self._is_pose_given = self._is_pose_given, False
        if is_pose_given and self._newest is not None and self.is_located:
            last = self._front.tracked[-1]
            step = compose_se2(last.pose, between_se2(self._newest.odom, level.odom))
            self._closer.set_expected(compose_se2(self._closer.poses[last.keyframe], step))

    def motion_between(self, first_ns: int, last_ns: int) -> Float64 | None:
        """Return the live estimate of the motion of the base between two stamps, float64 (3,).

        None if it is inaccurate: over several keyframes, or without odometry.
        """
        if self._front.tracked:
            first, last = self._anchor([first_ns, last_ns])
            return between_se2(first.pose, last.pose) if first.keyframe == last.keyframe else None
        if not len(self._measured.odometry):
            return np.zeros(3)
        start, end = self._measured.odometry.at(first_ns), self._measured.odometry.at(last_ns)
        return None if start is None or end is None else between_se2(start, end)

    def _start(self, odom: Float64) -> Float64:
        """Return the pose (3,) in map by odometry alone, with the first base pose as origin.

        With an external localisation, the pose is in its map.
        """
        if len(self._measured.map_odom):
            return compose_se2(self._measured.map_odom.newest(), odom)
        if not len(self._measured.odometry):
            return np.zeros(3)
        return between_se2(self._measured.odometry.first(), odom)

    def _take_keyframe(self) -> int:
        """Add the last scan if it became a keyframe; return its id, or -1."""
        done = len(self._chain.keyframes) - self._front.first_id
        for keyframe in self._front.keyframes[done:]:
            scan = keyframe.scan
            lines = extract_lines(scan.beams, scan.origin, self.config, self.label)
            self._add_keyframe(keyframe, lines)
            return keyframe.id
        return -1

    def _add_keyframe(self, keyframe: GraphKeyframe, lines: Lines) -> None:
        self._lines.append(lines)
        self._chain.add(keyframe, lines.phi)
        stamp = keyframe.scan.stamp_ns
        seen = _by_stamp(o for o in self._unanchored if o.stamp_ns <= stamp)
        self._unanchored = [o for o in self._unanchored if o.stamp_ns > stamp]
        poses = self._anchor([o.stamp_ns for o in seen])
        observations = [AnchoredObservation(o, pose) for o, pose in zip(seen, poses)]
        self._closer.add(keyframe.id, observations, self._sign_views_until(stamp))

    def _sign_views_until(self, stamp_ns: int) -> list[SignView]:
        """Return the views of signs up to `SIGN_DELAY_NS` before a stamp, in order."""
        until = stamp_ns - SIGN_DELAY_NS
        seen = sorted((m for m in self._unread if m.stamp_ns <= until), key=sign_order)
        self._unread = [m for m in self._unread if m.stamp_ns > until]
        return [SignView(m, a) for m, a in zip(seen, self._anchor([m.stamp_ns for m in seen]))]

    # -- a lost robot --------------------------------------------------------------------------

    @property
    def is_lost(self) -> bool:
        """Whether the robot was lost, and is not relocalised yet."""
        return self._front.is_lost or self._is_detached(self._front.session)

    @property
    def is_located(self) -> bool:
        """Whether the newest session is located in the map."""
        return self._front.session in self._closer.in_map

    @property
    def session(self) -> int:
        """Number of the newest session."""
        return self._front.session

    @property
    def is_at_given_pose(self) -> bool:
        """Whether the newest session is at a user-supplied pose."""
        return self._front.session in self._closer.placed_by_guess

    @property
    def waits_for(self) -> str:
        """Reason why the newest session is not located in the map yet; empty if it is."""
        return self._closer.waits_for

    @property
    def is_first_session_placed(self) -> bool:
        """Whether the first session of this run is on a trajectory; True without a saved map."""
        return self._first_session in self._closer.on_trajectory

    @property
    def is_unjoined(self) -> bool:
        """Whether the newest session is on a trajectory beside the map, not joined to it yet."""
        return self._front.session in self._closer.unjoined

    @property
    def unjoined_trajectories(self) -> int:
        """Number of trajectories that are not joined to the map."""
        return len(set(self._closer.unjoined.values()))

    @property
    def placed_by_sign(self) -> int:
        """Id of the sign by which this session was localised in the map; -1 for none."""
        return self._closer.placed_by_sign.get(self._front.session, -1)

    def _is_detached(self, session: int) -> bool:
        """Return whether a session began with a lost robot, and is on no trajectory yet."""
        return session > self._first_session and session not in self._closer.on_trajectory

    def _is_in_map(self, k: int) -> bool:
        return not self._is_detached(self._chain.keyframes[k].session)

    def kept_keyframes(self) -> dict[int, int]:
        """Return the indices in a saved map of the keyframes with a place in the map, by id."""
        kept = [k.id for k in self._chain.keyframes if not self._is_detached(k.session)]
        return {k: n for n, k in enumerate(kept)}

    # -- result --------------------------------------------------------------------------------

    def solve(
        self,
        views: Sequence[int] = (),
        factors: Sequence[Factor] | None = (),
        *,
        is_final: bool = True,
    ) -> Solution:
        """Rebuild the graph in stamp order and optimise it as a batch, or continue the last one.

        Parameters
        ----------
        views
            Stamps (ns) of surface clouds, all different; each gets its own pose, `view_key`.
        factors
            Additional factors between views, keyframes and landmarks. None: those of the previous
            solution if this one continues it, else none.
        is_final
            Whether to force a batch. Otherwise, a large graph is continued from the previous
            solution (`growth`), and only the newest keyframe gets its covariance.

        Returns
        -------
        Solution
            The result of a batch is a function of the records, independent of earlier calls.
        """
        nothing = not self._front.tracked and not self._chain.keyframes
        if nothing and len(self._measured.odometry):
            return self._solve_by_odometry(views, factors)
        if nothing:
            return empty_solution(len(views))
        grown = None if is_final else self._grow(views, factors)
        if grown is not None:
            return grown
        self._growth = None
        used, keys = self._inliers(), self._chain.keys
        self._between = factors or ()
        content = self._changing_content(used, used.poses, views)
        fixed_starts = self._closer.fixed_starts(used.loops, used.observations)
        lines = wall_factors(used.walls, self._lines, keys, self.config)
        graph_factors = by_variables(self._chain.factors(fixed_starts))
        graph_factors |= content.anchors
        graph_factors |= {p: p.factor(keys) for p in used.loops}
        graph_factors |= by_variables(lines) | content.others
        starts = {**dict(zip(keys, used.poses)), **content.starts}
        solution = PoseGraph(graph_factors.values(), starts).optimise()
        covs = np.array([solution.planar_covariance(key) for key in keys]) * used.scale
        covs += systematic_covariances(solution, self._chain)
        is_in_map = {k.session for k in self._chain.keyframes} <= self._closer.in_map
        if not is_final and len(keys) >= MIN_KEYFRAMES and is_in_map:
            self._solved_signs = len(self._measured.signs)
            self._growth = Growth(
                solution, graph_factors, content.factors, content.starts, used,
                self._chain, self._closer, self._lines, self.config,
            )  # fmt: skip
        return self._result(used, solution, content, covs)

    def _result(
        self,
        used: Inliers,
        solution: GraphSolution,
        content: _ChangingContent,
        cov_keyframes: Float64,
    ) -> Solution:
        """Return the result of an optimised graph."""
        poses, keyframes = solution.planar_poses(self._chain.keys), self._chain.keyframes
        tracked = [p for p in self._front.tracked if self._is_in_map(p.keyframe)]
        views = content.views
        landmarks = landmark_records(content.observations, solution, used.scale)
        has_others = used.loops or landmarks or self._chain.external_poses
        stamps_ns = np.array([p.stamp_ns for p in tracked], np.int64)
        attitudes = self._measured.attitudes.at(stamps_ns)
        return Solution(
            keyframes=[Keyframe(k.id, k.scan.stamp_ns, p) for k, p in zip(keyframes, poses)],
            walls=wall_records(used.walls, used.corners, solution, used.scale),
            loops=used.records,
            stamps_ns=stamps_ns,
            poses=scan_poses(tracked, keyframes, poses),
            T_map_views=np.array([solution.pose(key) for key in views]).reshape(-1, 4, 4),
            cov_views=np.array([solution.covariance(key) for key in views]).reshape(-1, 6, 6),
            view_keyframes=np.array([v.keyframe for v in views.values()], np.int64),
            cov_keyframes=cov_keyframes,
            unit_variance=used.scale,
            landmarks=landmarks,
            signs=sign_records(used.signs, landmarks, solution, used.walls.whole_numbers()),
            refused_signs=tuple(used.refused_signs),
            attitudes=attitudes if attitudes.any() else attitudes[:0],
            is_chain=not (has_others or len(used.walls)),
        )

    def _grow(self, views: Sequence[int], factors: Sequence[Factor] | None) -> Solution | None:
        """Return a continuation of the previous solution; None if a batch is needed."""
        growth, has_new_signs = self._growth, len(self._measured.signs) != self._solved_signs
        if growth is None or has_new_signs or not growth.extend():
            return None
        growth.used = replace(growth.used, observations=self._all_observations())
        self._between = self._between if factors is None else factors
        content = self._changing_content(growth.used, growth.poses, views)
        solution = growth.solve(content.starts, content.factors)
        if solution is None:
            return None
        covs = np.full((len(self._chain.keys), 3, 3), np.nan)
        covs[-1] = growth.newest_covariance(solution)
        return replace(self._result(growth.used, solution, content, covs), is_batch=False)

    def _changing_content(
        self, used: Inliers, poses: Float64, views: Sequence[int]
    ) -> _ChangingContent:
        """Return the content of the graph that each solution may change.

        Parameters
        ----------
        used
            The inliers.
        poses
            float64 (K, 3), start values of the keyframes.
        views
            Stamps (ns) of the views.
        """
        keys = self._chain.keys
        anchored = dict(zip(map(view_key, views), self._anchor_views(views)))
        observations = [*used.observations, *sign_observations(used.signs)]
        seen = landmark_factors(observations, unit_variance=used.scale)
        starts, anchors = self._chain.anchor({**anchored, **seen.anchored}, poses)
        between_views = [
            f
            for f in self._between
            if not isinstance(f, BetweenViews) or {f.i, f.j} <= anchored.keys()
        ]
        others = [*between_views, *sign_factors(used.signs, used.scale), *seen.factors]
        if uses_corners(self.config):
            others += corner_factors(used.corners, used.walls, keys, self.config)
        names = by_variables(anchors), by_variables(others, "beside")
        return _ChangingContent(anchored, observations, starts, *names)

    def _inliers(self) -> Inliers:
        """Return the inliers; they are selected again only after new records."""
        m = self._measured
        counted = self._front.tracked, m.odometry, m.landmarks, m.signs, m.pictures
        now = tuple(len(records) for records in counted)
        if self._selected is None or self._selected[0] != now:
            # Lines at unknown places are no observations of walls of the map.
            lines = [x if self._is_in_map(k) else NO_LINES for k, x in enumerate(self._lines)]
            inliers = select_inliers(
                self._closer,
                self._chain,
                lines,
                self._all_observations(),
                [*self._saved_signs, *self._in_map(sorted(m.signs, key=sign_order), SignView)],
                self._in_map(sorted(m.pictures, key=lambda x: x.key), PictureView),
                self.config,
            )
            self._selected = now, inliers
        return self._selected[1]

    def _solve_by_odometry(
        self, views: Sequence[int], factors: Sequence[Factor] | None
    ) -> Solution:
        """Return the solution without matching; lines of level scans give walls at its poses."""
        solver = self._by_odometry()
        solution = solver.solve(views, factors or ())
        if not self._wall_scans:
            return solution
        stamps, lines = zip(*self._wall_scans)
        return replace(solution, walls=walls_at(solution.pose_at(stamps), lines, self.config))

    def _by_odometry(self) -> WallSlam:
        """Return a processor of the same measurements with keyframes from odometry alone."""
        measured, start = self._measured, np.zeros(3)
        if len(measured.map_odom):
            first_ns = int(measured.odometry.stamps_ns[0])
            before = measured.map_odom.before(first_ns)
            start = compose_se2(before, measured.odometry.first())
        front = self._odometry_front.update(measured.odometry, start)
        odometry_slam = WallSlam(self.config, self.label, measured, front)
        while odometry_slam._take_keyframe() >= 0:
            pass
        if len(measured.map_odom):
            sigma = self.config.localisation.sigma
            chain = odometry_slam._chain
            chain.external_poses = measured.map_odom.poses_of(chain.keyframes, sigma)
            reweigh(chain)
        return odometry_slam

    def _anchor(self, stamps_ns: Sequence[int]) -> list[AnchoredPose]:
        tracked, keyframes, model = self._front.tracked, self._chain.keyframes, self.config.odometry
        level = poses_at_stamps(stamps_ns, tracked, keyframes, self._measured.odometry, model)
        attitudes = self._measured.attitudes.at(stamps_ns).tolist()
        return [replace(x, attitude=(z, a, b)) for x, (z, a, b) in zip(level, attitudes)]

    def _anchor_views(self, stamps_ns: Sequence[int]) -> list[AnchoredPose]:
        """Return the anchored poses of views, including roll and pitch of the base by its IMU."""
        by_imu = self._measured.roll_pitch.at(stamps_ns).tolist()
        rows = [(*x.attitude, *by, x) for x, by in zip(self._anchor(stamps_ns), by_imu)]
        return [replace(x, attitude=(z, a + roll, b + pitch)) for z, a, b, roll, pitch, x in rows]

    def _in_map(
        self, records: Sequence[Record], anchored: Callable[[Record, AnchoredPose], Anchored]
    ) -> list[Anchored]:
        """Return records of sessions in the map's frame, anchored to their keyframes."""
        poses = self._anchor([x.stamp_ns for x in records]) if self._front.tracked else []
        keyframes, localised = self._chain.keyframes, self._closer.in_map
        pairs = zip(records, poses)
        return [anchored(x, a) for x, a in pairs if keyframes[a.keyframe].session in localised]

    def _all_observations(self) -> list[AnchoredObservation]:
        """Return the observations of all sessions in the map's frame, in order."""
        seen = self._in_map(_by_stamp(self._measured.landmarks), AnchoredObservation)
        return [*self._saved_observations, *seen]

    # -- saved maps ----------------------------------------------------------------------------

    def saved(self, solution: Solution | None = None) -> dict[str, NDArray[Any]]:
        """Return the map of the newest solution (None: solved now) as arrays, for `from_saved`.

        It contains keyframes with scans and lines, their optimised poses, loop closures, landmark
        observations and views of signs; not the trajectory between keyframes.
        """
        if not self._chain.keyframes:
            return pack_walls(SavedWalls([], [], np.zeros((0, 3)), [], [], []))
        poses = np.array([k.pose for k in (solution or self.solve()).keyframes])
        used = self._inliers() if self._growth is None else self._growth.used
        number = self.kept_keyframes()
        kept = list(number)
        views = [replace(view, sign=sign.id) for sign in used.signs for view in sign.views]
        return pack_walls(
            SavedWalls(
                [self._chain.keyframes[k] for k in kept],
                [self._lines[k] for k in kept],
                poses[kept],
                [replace(p, a=number[p.a], b=number[p.b]) for p in used.loops],
                _renumbered(used.observations, number),
                _renumbered(views, number),
                self._closer.unjoined,
            )
        )

    def correction(self, solution: Solution) -> Float64:
        """Return the planar pose (3,) of the front end's own map in a solution's map.

        It is computed from the newest keyframe; the identity before the first one of a session.
        """
        if not self._front.keyframes:
            return np.zeros(3)
        return self.map_from_tracking(solution.keyframes[self._front.keyframes[-1].id].pose)

    def map_from_tracking(self, newest: Float64) -> Float64:
        """Return the pose of the front end's own map, from the pose (3,) of the newest keyframe."""
        return compose_se2(newest, inverse_se2(self._front.keyframes[-1].pose))

    def placed_keyframe(self) -> SolvedKeyframe | None:
        """Return the newest keyframe in the map, before it is solved; None without a place."""
        if not self._front.keyframes or self._front.session not in self._closer.on_trajectory:
            return None
        keyframe = self._front.keyframes[-1]
        near = [p for p in self._closer.accepted if p.b == keyframe.id]
        cov = near[-1].cov if near else keyframe.cov
        return SolvedKeyframe(keyframe.id, self._closer.poses[keyframe.id], cov)

    @property
    def first_keyframe(self) -> tuple[int, int]:
        """Id of the first keyframe of this session, and its number."""
        return self._front.first_id, self._front.session

    @classmethod
    def from_saved(
        cls,
        config: Config,
        arrays: Mapping[str, NDArray[Any]],
        label: LabelBeams = label_by_splitting,
    ) -> WallSlam:
        """Return a processor that continues a saved map; the robot may start anywhere.

        Parameters
        ----------
        config, label
            As in the constructor.
        arrays
            Arrays returned by `saved`.

        Raises
        ------
        MapError
            For missing or inconsistent arrays.
        """
        slam = cls(config, label)
        saved = unpack_walls(arrays)
        for keyframe, lines in zip(saved.keyframes, saved.lines):
            slam._lines.append(lines)
            slam._chain.add(keyframe, lines.phi)
        if config.graph.mode == "localisation":
            slam._chain.fixed = dict(enumerate(saved.poses))
        slam._saved_observations = saved.observations
        slam._saved_signs = saved.sign_views
        slam._closer.load(*saved[2:])
        keyframes = saved.keyframes
        session = 1 + max((k.session for k in keyframes), default=-1)
        slam._front = FrontEnd(config, first_id=len(keyframes), session=session)
        slam._first_session = session
        return slam


def _renumbered(seen: Iterable[Seen], number: Mapping[int, int]) -> list[Seen]:
    """Return observations with renumbered keyframes; drop those of removed keyframes."""
    return [
        replace(x, anchored=replace(x.anchored, keyframe=number[x.anchored.keyframe]))
        for x in seen
        if x.anchored.keyframe in number
    ]


def _by_stamp(seen: Iterable[LandmarkObservation]) -> list[LandmarkObservation]:
    return sorted(seen, key=lambda o: (o.stamp_ns, o.kind, o.id))
