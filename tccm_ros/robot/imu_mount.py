"""Pose of an IMU on the base."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import FrameError
from tccm_ros.robot.frames import FrameTree, build_chain, find_path


class ImuMount:
    """Finds the pose of an IMU in the child frame of odometry.

    Parameters
    ----------
    frames
        Frames of the robot.
    """

    def __init__(self, frames: FrameTree) -> None:
        self._frames = frames
        self._found: Float64 | None = None
        self._found_of = -1, ""

    def pose(self, frame: str) -> Float64 | None:
        """Return T_base_imu float64 (4, 4) of an IMU's frame; None if it is unknown.

        It is unknown before odometry arrives, and where a joint between the two moves.
        """
        known = self._frames.version, frame
        if known != self._found_of:
            self._found_of, self._found = known, self._find(frame)
        return self._found

    def _find(self, frame: str) -> Float64 | None:
        base = self._frames.odometry_child
        if not base or not frame:
            return None
        if frame == base:
            return np.eye(4)
        edges = self._frames.view(moving_tf=False)
        try:
            chain = build_chain(find_path(base, frame, edges))
        except FrameError:
            return None
        return chain.at(np.zeros(1, np.int64))[0]
