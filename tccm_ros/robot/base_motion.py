"""The pose of the base in the odometry frame: from odometry, else from tf, else constant."""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import between2, planar
from tccm_ros.records import Odometry
from tccm_ros.robot.chain import TransformChain
from tccm_ros.robot.frames import FrameTree, ancestors, build_chain, find_path
from tccm_ros.robot.odometry import OdometryFilter
from tccm_ros.robot.tracks import PoseTrack

STANDING_STEP = (0.0005, 0.0005)
"""A base is at rest if its odometry moves by less (m, rad) in a step of about 0.1 s (chosen)."""

PLANAR_SINE = 1e-6
"""Sine of a roll or pitch below which it is zero (chosen: rounding of quaternions)."""


class MotionSource(Enum):
    """Source of the base's motion."""

    ODOMETRY = "odometry"
    TF = "tf"
    STILL = "still"


class BaseMotion:
    """T_odom_base over time, for any base frame.

    Attributes
    ----------
    source
        Source of the motion; None until it is decided.
    odom_frame
        Name of the odometry frame.
    odometry
        Filter that odometry records pass before they are added.
    has_roll_pitch
        Whether odometry has ever contained roll or pitch of the base.
    """

    def __init__(self, config: Config, frames: FrameTree):
        self.source: MotionSource | None = None
        self.odom_frame = config.frames.odom_name
        self._frames = frames
        self.odometry = OdometryFilter()
        self._track = PoseTrack()
        self._chains: dict[str, TransformChain] = {}
        self.has_roll_pitch = False

    def add(self, record: Odometry) -> bool:
        """Add an odometry record; return whether it is newer than the previous one."""
        self.source = MotionSource.ODOMETRY
        self.odom_frame = record.frame_id or self.odom_frame
        self.has_roll_pitch |= max(abs(record.T_odom_base[2, :2]).tolist()) > PLANAR_SINE
        return self._track.append_pose(record.stamp_ns, record.T_odom_base)

    def clear_samples(self) -> None:
        """Clear all time-stamped data, after a jump of the clock."""
        self._track.clear()
        self.odometry.clear()
        self._chains.clear()
        self.has_roll_pitch = False
        if self.source is MotionSource.TF:
            self.source = None

    def decide(self, base: str) -> None:
        """Choose the source without odometry: tf from the odometry frame to the base, or none."""
        frame = self._odom_frame_above(base)
        self.source = MotionSource.STILL if frame is None else MotionSource.TF
        self.odom_frame = frame or self.odom_frame

    def _odom_frame_above(self, base: str) -> str | None:
        """Return the configured odometry frame, or the parent of the first moving transform."""
        above = ancestors(base, dict(self._frames.tf))
        if self.odom_frame in above[1:]:
            return self.odom_frame
        edges = [self._frames.tf[frame] for frame in above[:-1]]
        on_tf = [edge for edge in edges if edge.T_parent_child is None]
        moving = [edge for edge in on_tf if edge.track.has_moved] or on_tf
        return moving[0].parent if moving else None

    def _tf_chain(self, base: str) -> TransformChain:
        """Return the tf chain from the odometry frame to a base."""
        chain = self._chains.get(base)
        if chain is None:
            edges = self._frames.view(urdf=False)
            chain = build_chain(find_path(self.odom_frame, base, edges))
            self._chains[base] = chain
        return chain

    def at(self, stamps_ns: Int64, base: str) -> Float64:
        """Return T_odom_base float64 (K, 4, 4) at stamps int64 (K,) within the samples.

        With odometry, this is the pose of the child frame of odometry.
        """
        if self.source is MotionSource.ODOMETRY:
            return self._track.at(stamps_ns)
        if self.source is MotionSource.TF:
            return self._tf_chain(base).at(stamps_ns)
        return np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4)).copy()

    def step(self, start_ns: int, end_ns: int, max_gap_ns: int) -> Float64 | None:
        """Return the planar motion float64 (3,) between two stamps by odometry.

        Returns
        -------
        m and rad, in the base frame at the first stamp; None without odometry, or where the samples
        around the interval have a gap wider than `max_gap_ns`.
        """
        is_measured = self.source is MotionSource.ODOMETRY
        if not is_measured or not self._track.brackets(start_ns, end_ns, max_gap_ns):
            return None
        a, b = self._track.at(np.array([start_ns, end_ns]))
        return between2(planar(a), planar(b))

    @property
    def latest_ns(self) -> int | None:
        """The newest stamp of odometry; None without odometry."""
        return self._track.latest_ns

    def tracks(self, base: str) -> list[PoseTrack]:
        """Return the tracks that determine the motion; none if the base is constant.

        Raises
        ------
        FrameError
            Where tf has no chain to this base.
        """
        if self.source is MotionSource.ODOMETRY:
            return [self._track]
        if self.source is MotionSource.TF:
            tracks = self._tf_chain(base).tracks
            return [track for track in tracks if isinstance(track, PoseTrack)]
        return []


def is_standing(step: Float64) -> bool:
    """Return whether odometry reports no motion in a step (3,), m and rad."""
    moved, turned = math.hypot(step[0], step[1]), abs(step[2])
    return bool(moved < STANDING_STEP[0] and turned < STANDING_STEP[1])
