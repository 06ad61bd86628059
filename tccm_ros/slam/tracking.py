"""Tracking: where the base is now, by matching alone.

The graph with its walls and loop closures is solved in another process; what it finds corrects what
is published, and never enters matching. So a step of tracking is short however long the drive is,
and its memory does not grow.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import planar
from tccm_ros.records import (
    LandmarkObservation,
    MapReset,
    Odometry,
    PosedScan,
    SurfaceCloud,
    ViewIntervals,
)
from tccm_ros.sensors.registry import roles_of
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.level_scan import make_level_scan
from tccm_ros.slam.se2 import between, compose, inverse
from tccm_ros.slam.wall_slam import LivePose

COUNTED = {SurfaceCloud: "clouds", ViewIntervals: "views", MapReset: "resets"}
"""Events that are counted here and used by the solution alone."""


class Tracker:
    """Follows the base from scan to scan as `WallSlam` does, in the frame of the front end's map.

    Parameters
    ----------
    config
        Groups ``matching``, ``odometry`` and ``graph``.
    first_keyframe
        Id of the first keyframe, and number of the session (`WallSlam.first_keyframe`).

    Attributes
    ----------
    counts
        ``level scans`` matched, ``keyframes`` made of them, ``clouds`` and ``views`` received,
        ``resets``.
    odom_frame
        Name of the odometry frame.
    """

    def __init__(self, config: Config, first_keyframe: tuple[int, int] = (0, 0)):
        self._config = config
        self.counts: Counter[str] = Counter()
        self.odom_frame = config.frames.odom_name
        self._begin(first_keyframe)

    def _begin(self, first_keyframe: tuple[int, int]) -> None:
        self._first_keyframe = first_keyframe
        self._front = FrontEnd(self._config, *first_keyframe)
        self._first_odometry: tuple[int, Float64] | None = None
        self._newest_keyframe = -1
        self._live = LivePose(-1, np.zeros(3), np.zeros(3))

    def takes(self, event: Any) -> bool:
        """Return whether an event is for the SLAM processor."""
        kinds = (PosedScan, Odometry, LandmarkObservation, *COUNTED)
        return type(event) in kinds and getattr(event, "role", None) in {None, *roles_of("slam")}

    def add(self, event: Any) -> None:
        """Process one event, which `takes` let through."""
        if isinstance(event, PosedScan):
            self._add_scan(event)
        elif isinstance(event, Odometry):
            self._add_odometry(event)
        elif type(event) in COUNTED:
            self.counts[COUNTED[type(event)]] += 1
            if isinstance(event, MapReset):
                self._begin(self._first_keyframe)

    def current_pose(self) -> LivePose:
        """Return the live estimate, in the frame of the front end's map."""
        return self._live

    def _add_scan(self, posed: PosedScan) -> None:
        self.odom_frame = posed.odom_frame
        self.counts["level scans"] += 1
        level = make_level_scan(posed, self._config)
        keyframe = self._front.add(level, self._start(level.odom)).keyframe
        self.counts["keyframes"] += keyframe != self._newest_keyframe
        self._newest_keyframe = keyframe
        self._front.forget()
        pose = self._front.pose.copy()
        self._live = LivePose(level.stamp_ns, pose, compose(pose, inverse(level.odom)))

    def _add_odometry(self, record: Odometry) -> None:
        self.odom_frame = record.frame_id or self.odom_frame
        odom = planar(record.T_odom_base)
        if self._first_odometry is None or record.stamp_ns < self._first_odometry[0]:
            self._first_odometry = record.stamp_ns, odom
        if not self._front.tracked and record.stamp_ns >= self._live.stamp_ns:
            pose = self._start(odom)
            self._live = LivePose(record.stamp_ns, pose, compose(pose, inverse(odom)))

    def _start(self, odom: Float64) -> Float64:
        """Return the pose (3,) by odometry alone: the first base pose is the origin."""
        if self._first_odometry is None:
            return np.zeros(3)
        return between(self._first_odometry[1], odom)
