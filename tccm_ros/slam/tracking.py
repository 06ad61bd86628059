"""Tracking: the live pose, by matching since the newest solution.

Another process solves the graph with walls and loop closures. Its solution corrects the published
pose, and never enters matching. The time of a tracking step is therefore independent of the length
of the drive, and memory is constant.
"""

from __future__ import annotations

from collections import Counter
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import planar
from tccm_ros.records import (
    LandmarkObservation,
    MapOdom,
    MapReset,
    ObjectBoxes,
    Odometry,
    PoseCovariance,
    PosedScan,
    PoseGuess,
    RollPitch,
    SurfaceCloud,
    ViewIntervals,
)
from tccm_ros.sensors.registry import roles_of
from tccm_ros.signs.measurement import SignMeasurement
from tccm_ros.slam.base_attitude import LEVEL, Attitude, attitude_of
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.live_estimate import (
    LiveEstimate,
    LivePose,
    MapWalls,
    SolvedKeyframe,
    moved_covariance,
)
from tccm_ros.slam.matching.level_scan import LevelScan, make_level_scan
from tccm_ros.slam.odometry_model import odometry_covariance
from tccm_ros.slam.se2 import between_se2, compose_se2, inverse_se2, rotate_covariance
from tccm_ros.slam.walls.lines import extract_lines

COUNTED = {
    SurfaceCloud: "clouds", ViewIntervals: "views", ObjectBoxes: "boxes", SignMeasurement: "signs",
    MapReset: "resets",
}  # fmt: skip
"""Events that are only counted here, and used by the solver."""


USED = (
    PosedScan, Odometry, MapOdom, PoseCovariance, RollPitch, LandmarkObservation, PoseGuess,
    *COUNTED,
)  # fmt: skip
"""Events for the SLAM processor."""


class LocalisationState(IntEnum):
    """State of the localisation; the numbers of tccm_interfaces/Localisation."""

    UNKNOWN = 0
    TRACKING = 1
    SEARCHING = 2
    LOST = 3


class SolvedMap(NamedTuple):
    """Pose of the robot and walls of the map in a solution.

    Attributes
    ----------
    p_map_tracking
        float64 (3,), pose in map of the tracking frame: the front end's own map.
    keyframe
        The newest keyframe; None without keyframes.
    walls
        Walls in map.
    is_localised
        Whether the place of this session in the map is known.
    placed_by_sign
        Id of the sign by which it was localised; -1 for none.
    is_unjoined
        Whether the session is on a trajectory beside the map, with an unknown place in the map.
    """

    p_map_tracking: Float64
    keyframe: SolvedKeyframe | None
    walls: MapWalls
    is_localised: bool = True
    placed_by_sign: int = -1
    is_unjoined: bool = False


class Tracker:
    """Tracks the base from scan to scan like `WallSlam`, and applies solutions.

    Before the first solution, the map frame is that of the front end's own map.

    Parameters
    ----------
    config
        Groups ``matching``, ``odometry``, ``graph``, ``lines`` and ``walls``.
    first_keyframe
        Id of the first keyframe, and number of the session (`WallSlam.first_keyframe`).
    is_localised
        Whether the place of the session in the map is known; False for a loaded map.

    Attributes
    ----------
    counts
        Numbers of ``level scans`` matched, ``keyframes``, ``clouds``, ``views``, ``boxes`` and
        ``signs`` received, ``resets``, and times that the robot was ``lost``.
    odom_frame
        Name of the odometry frame.
    """

    def __init__(
        self, config: Config, first_keyframe: tuple[int, int] = (0, 0), *, is_localised: bool = True
    ):
        self._config = config
        self._is_external = config.localisation.is_external
        self._roles = {None, *roles_of("slam", config)}
        self._starts_localised = is_localised
        self.counts: Counter[str] = Counter()
        self.odom_frame = config.frames.odom_name
        self._begin(first_keyframe)

    def _begin(self, first_keyframe: tuple[int, int]) -> None:
        self._first_keyframe = first_keyframe
        self._front = FrontEnd(self._config, *first_keyframe)
        self._first_odometry: tuple[int, Float64] | None = None
        self._newest_keyframe = -1
        self._estimate = LiveEstimate(self._config)
        self._solved: SolvedMap | None = None
        self._stamp_ns, self._odom, self._attitude = -1, np.zeros(3), LEVEL
        self._odometry_attitude: Attitude = LEVEL
        self._before: tuple[Float64, Float64] | None = None
        self._map_odom: Float64 | None = None
        self._external_cov: Float64 | None = None
        self._is_localised = self._starts_localised
        self._session = first_keyframe[1]

    def takes(self, event: Any) -> bool:
        """Return whether an event is for the SLAM processor."""
        return type(event) in USED and getattr(event, "role", None) in self._roles

    def add(self, event: Any) -> None:
        """Process one event accepted by `takes`."""
        if isinstance(event, PosedScan):
            self._add_scan(event)
        elif isinstance(event, Odometry):
            self._add_odometry(event)
        elif isinstance(event, MapOdom):
            self._map_odom = planar(event.T_map_odom)
        elif isinstance(event, PoseCovariance):
            self._external_cov = event.cov
        elif isinstance(event, PoseGuess):
            self._front.is_lost = bool(self._front.tracked)
            # Keep the known pose until a solution confirms the user-supplied one.
            if self._front.is_lost and self._is_localised:
                self._before = self._pose(), self._odom
        elif type(event) in COUNTED:
            self.counts[COUNTED[type(event)]] += 1
            if isinstance(event, MapReset):
                self._begin(self._first_keyframe)

    def take(self, solved: SolvedMap) -> Float64:
        """Continue from a solution; return the correction (3,) that precedes the live pose."""
        before = self._pose()
        is_ours = solved.keyframe is None or self._estimate.take(solved.keyframe, solved.walls)
        if is_ours or not self._front.tracked:
            self._solved, self._is_localised = solved, solved.is_localised
        return compose_se2(self._pose(), inverse_se2(before))

    @property
    def state(self) -> LocalisationState:
        """State of the live pose relative to the map."""
        if self._stamp_ns < 0:
            return LocalisationState.UNKNOWN
        if self._front.is_pose_unknown(self._stamp_ns):
            return LocalisationState.LOST
        is_in_map = self.is_localised and not self.is_unjoined
        return LocalisationState.TRACKING if is_in_map else LocalisationState.SEARCHING

    @property
    def is_unjoined(self) -> bool:
        """Whether the pose is on a trajectory beside the map that is not joined to it."""
        return self._solved is not None and self._solved.is_unjoined

    @property
    def solved_keyframe(self) -> int:
        """Id of the newest keyframe in the newest accepted solution; -1 without one."""
        solved = self._solved
        return -1 if solved is None or solved.keyframe is None else solved.keyframe.id

    @property
    def placed_by_sign(self) -> int:
        """Id of the sign by which this session was localised in the map; -1 for none."""
        return -1 if self._solved is None else self._solved.placed_by_sign

    @property
    def is_localised(self) -> bool:
        """Whether this session has a place in the map, or beside it (`is_unjoined`)."""
        return self._map_odom is not None if self._is_external else self._is_localised

    def current_pose(self) -> LivePose:
        """Return the live estimate, in the map of the newest solution."""
        if self._stamp_ns < 0:
            return LivePose(-1, np.zeros(3), np.zeros(3))
        pose = self._pose()
        map_odom = compose_se2(pose, inverse_se2(self._odom))
        return LivePose(self._stamp_ns, pose, map_odom, attitude=self._attitude)

    def current_covariance(self) -> Float64:
        """Return the covariance float64 (3, 3) of (x, y, yaw) in map of the live estimate."""
        if self._external_cov is not None:
            return self._external_cov
        if self._is_external:
            position, yaw = self._config.localisation.sigma
            return np.diag(np.square([position, position, yaw]))
        if self._front.tracked:
            return self._estimate.covariance(self._front.tracked[-1])
        solved = None if self._solved is None else self._solved.keyframe
        pose, start = self._pose(), np.zeros(3) if solved is None else solved.pose
        step = odometry_covariance(between_se2(start, pose), self._config.odometry)
        cov = rotate_covariance(step, float(pose[2]))
        if solved is not None:
            known = rotate_covariance(solved.cov, float(start[2]))
            cov += moved_covariance(known, start, pose)
        return cov

    def _pose(self) -> Float64:
        if self._map_odom is not None:
            return compose_se2(self._map_odom, self._odom)
        if self._front.tracked:
            return self._estimate.pose(self._front.tracked[-1])
        pose = self._start(self._odom)
        return pose if self._solved is None else compose_se2(self._solved.p_map_tracking, pose)

    def _add_scan(self, posed: PosedScan) -> None:
        self.odom_frame = posed.odom_frame
        self.counts["level scans"] += 1
        if self._is_external:
            return
        level = make_level_scan(posed, self._config)
        keyframe = self._front.add(level, self._start(level.odom)).keyframe
        if keyframe != self._newest_keyframe:
            self._newest_keyframe = keyframe
            self._add_keyframe(level)
        self._front.forget()
        self._stamp_ns, self._odom, self._attitude = level.stamp_ns, level.odom, level.attitude
        if self._first_odometry is not None:  # a scan's also has roll and pitch by the IMU
            self._attitude = level.attitude[0], *self._odometry_attitude[1:]

    def _add_keyframe(self, level: LevelScan) -> None:
        self.counts["keyframes"] += 1
        start = None
        if self._front.session != self._session:  # the robot was lost, or given a pose by a user
            before, self._before = self._before, None
            self._session, self._is_localised = self._front.session, before is not None
            if before is None:
                self.counts["lost"] += 1
            else:
                start = compose_se2(before[0], between_se2(before[1], level.odom))
        lines = extract_lines(level.beams, level.origin, self._config)
        self._estimate.add(self._front.keyframes[-1], lines, start)

    def _add_odometry(self, record: Odometry) -> None:
        self.odom_frame = record.frame_id or self.odom_frame
        odom = planar(record.T_odom_base)
        self._odometry_attitude = attitude_of(record.T_odom_base)
        if self._first_odometry is None or record.stamp_ns < self._first_odometry[0]:
            self._first_odometry = record.stamp_ns, odom
        if not self._front.tracked and record.stamp_ns >= self._stamp_ns:
            self._stamp_ns, self._odom = record.stamp_ns, odom
            self._attitude = self._odometry_attitude

    def _start(self, odom: Float64) -> Float64:
        """Return the pose (3,) by odometry alone: the first base pose is the origin."""
        if self._first_odometry is None:
            return np.zeros(3)
        return between_se2(self._first_odometry[1], odom)
