"""Poses of the robot's frames, known to a node from tf, URDF, joints and odometry."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.errors import FrameError, suggest
from tccm_ros.geometry import planar
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.robot import MountKind
from tccm_ros.robot.chain_finder import ChainFinder
from tccm_ros.robot.frames import build_chain, find_path, frames_of

STANDING_NS = 500_000_000
"""The base is at rest if it has not moved for this time, ns. Chosen."""

STANDING_M, STANDING_RAD = 0.01, np.deg2rad(0.25)
"""Maximum motion of a base at rest within `STANDING_NS`: speeds of 0.02 m/s and 0.5 deg/s, as for
still views."""


class KnownFrames:
    """Returns the current poses of frames, and whether the base is at rest.

    Parameters
    ----------
    robot
        The robot, with its frames, joints and odometry.
    config
        Groups `frames` and `rig`.
    """

    def __init__(self, robot: SharedRobot, config: Config):
        self._robot, self._config = robot, config

    @property
    def odom_frame(self) -> str:
        """Name of the odometry frame."""
        return self._robot.robot.motion.odom_frame

    @property
    def base(self) -> str:
        """Name of the base frame; raises FrameError if nothing is known of the robot."""
        with self._robot.lock:
            return self._base()

    def T_odom_frame(self, frame: str) -> Float64:
        """Return the newest pose (4, 4) of a frame in the odometry frame.

        Raises
        ------
        FrameError
            If the frame is unknown, or if a joint or the odometry that moves it has no data.
        """
        frame = frame.lstrip("/")
        if frame == self.odom_frame:
            return self._robot.robot.motion.odometry.T_near_odom
        with self._robot.lock:
            base = self._base()
            return self._T_odom_base(base) @ self._T_base_frame(base, frame)

    def base_pose(self) -> Float64:
        """Return the newest (x, y, yaw) of the base in the odometry frame.

        Raises
        ------
        FrameError
            If nothing is known of it.
        """
        return planar(self.T_odom_frame(self.base))

    def is_base_standing(self) -> bool:
        """Return whether the base has data and has not moved for `STANDING_NS` of message time."""
        with self._robot.lock:
            try:
                base = self._base()
            except FrameError:
                return False
            motion = self._robot.robot.motion
            tracks = motion.tracks(base)
            if not tracks:
                return True
            last_ns = min(track.latest_ns or 0 for track in tracks)
            first_ns = max(int(track.stamps_ns[0]) if len(track) else last_ns for track in tracks)
            if last_ns - STANDING_NS < first_ns:
                return False
            stamps = np.linspace(last_ns - STANDING_NS, last_ns, 6).astype(np.int64)
            poses = motion.at(stamps, base)
        return all(is_near(planar(T), planar(poses[-1])) for T in poses[:-1])

    def _base(self) -> str:
        robot = self._robot.robot
        bases = [s.mount.base for s in robot.sensors.values() if s.mount.base is not None]
        base = bases[0] if bases else self._config.frames.base or robot.frames.odometry_child
        if base is None:
            raise FrameError("nothing is known of the robot yet: there is no odometry and no scan")
        return base

    def _T_odom_base(self, base: str) -> Float64:
        motion = self._robot.robot.motion
        latest = [track.latest_ns for track in motion.tracks(base)]
        if None in latest:
            raise FrameError(f"no odometry yet: '{base}' has no place in '{motion.odom_frame}'")
        stamp_ns = min((ns for ns in latest if ns is not None), default=0)
        T: Float64 = motion.at(np.array([stamp_ns], np.int64), base)[0]
        return T

    def _T_base_frame(self, base: str, frame: str) -> Float64:
        if frame == base:
            return np.eye(4)
        robot = self._robot.robot
        edges = robot.frames.view()
        known = frames_of(edges)
        if frame not in known:
            raise FrameError(f"no frame '{frame}'" + suggest(frame, known))
        finder = ChainFinder(self._config, MountKind.ANY, robot.frames, robot.joints)
        try:
            chain = build_chain(find_path(base, frame, edges), finder.reading)
        except FrameError:
            raise FrameError(f"no way from '{base}' to '{frame}'") from None
        latest = [track.latest_ns for track in chain.tracks]
        if None in latest:
            raise FrameError(f"nothing was heard of a joint between '{base}' and '{frame}'")
        stamp_ns = min((ns for ns in latest if ns is not None), default=0)
        T: Float64 = chain.at(np.array([stamp_ns], np.int64))[0]
        return T


def is_near(pose: Float64, other: Float64) -> bool:
    """Return whether two planar poses (x, y, yaw) differ by no more than odometry jitter."""
    dx, dy, dyaw = pose - other
    dyaw = (dyaw + np.pi) % (2.0 * np.pi) - np.pi
    return bool(np.hypot(dx, dy) < STANDING_M and abs(dyaw) < STANDING_RAD)
