"""Detection of a base at rest, from odometry or tf."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import FrameError
from tccm_ros.geometry import planar
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.nodes.services.known_frames import KnownFrames

STANDING_NS = 500_000_000
"""The base is at rest if it has not moved for this time, ns. Chosen."""

STANDING_M, STANDING_RAD = 0.01, np.deg2rad(0.25)
"""Tolerated motion: speeds of 0.02 m/s and 0.5 deg/s over that time, as for still views."""


class BaseWatch:
    """Monitors the newest motion of the base.

    Parameters
    ----------
    robot, frames
        The robot, and the poses of its frames.
    """

    def __init__(self, robot: SharedRobot, frames: KnownFrames):
        self._robot, self._frames = robot, frames

    def pose(self) -> Float64:
        """Return the newest (x, y, yaw) of the base in the odometry frame.

        Raises
        ------
        FrameError
            If nothing is known of it.
        """
        return planar(self._frames.T_odom_frame(self._frames.base))

    def is_standing(self) -> bool:
        """Return whether the base has data and has not moved for `STANDING_NS` of message time."""
        with self._robot.lock:
            try:
                base = self._frames.base
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


def is_near(pose: Float64, other: Float64) -> bool:
    """Return whether two planar poses (x, y, yaw) differ by no more than odometry jitter."""
    dx, dy, dyaw = pose - other
    dyaw = (dyaw + np.pi) % (2.0 * np.pi) - np.pi
    return bool(np.hypot(dx, dy) < STANDING_M and abs(dyaw) < STANDING_RAD)
