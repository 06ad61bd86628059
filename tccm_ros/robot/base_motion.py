"""Where the base is in the odometry frame: by odometry, else by tf, else it stands still."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.records import Odometry
from tccm_ros.robot.chain import Chain, JointReading
from tccm_ros.robot.frames import FrameTree, ancestors, build_chain, find_path
from tccm_ros.robot.tracks import PoseTrack
from tccm_ros.robot.urdf import Joint

__all__ = ["BaseMotion"]

Int64 = NDArray[np.int64]
Float64 = NDArray[np.float64]


class BaseMotion:
    """T_odom_base over time.

    Attributes
    ----------
    mode
        ``odometry``, ``tf`` or ``still``; None until it is decided.
    odom_frame
        Name of the odometry frame.
    """

    def __init__(self, config: Config, frames: FrameTree):
        self.mode: Literal["odometry", "tf", "still"] | None = None
        self.odom_frame = config.frames.odom_name
        self._frames = frames
        self._track = PoseTrack()
        self._chain: Chain | None = None

    def add(self, record: Odometry) -> bool:
        """Take one odometry record; return whether it is newer than the one before."""
        self.mode = "odometry"
        self.odom_frame = record.frame_id or self.odom_frame
        return self._track.append_pose(record.stamp_ns, record.T_odom_base)

    def clear_samples(self) -> None:
        """Forget everything that has a stamp, as after a jump of the clock."""
        self._track.clear()
        if self.mode == "tf":
            self.mode = self._chain = None

    def decide(self, base: str) -> None:
        """Decide without odometry: tf's way from the odometry frame to the base, or none."""
        if self.mode is not None:
            return
        edges = self._frames.view(urdf=False, tf=True, moving_tf=True)
        frame = self._odom_frame_above(base)
        if frame is None:
            self.mode = "still"
            return
        self.odom_frame = frame
        self._chain = build_chain(find_path(frame, base, edges), _no_joint)
        self.mode = "tf"

    def _odom_frame_above(self, base: str) -> str | None:
        """Return the configured odometry frame, or where the first moving transform comes from."""
        above = ancestors(base, dict(self._frames.tf))
        if self.odom_frame in above[1:]:
            return self.odom_frame
        for frame in above[:-1]:
            edge = self._frames.tf[frame]
            if edge.T_parent_child is None:
                return edge.parent
        return None

    def stamps_within(self, start_ns: int, end_ns: int) -> list[Int64]:
        """Return the stamps of the samples in the open interval (start, end)."""
        return [track.stamps_within(start_ns, end_ns) for track in self.tracks]

    def at(self, stamps_ns: Int64) -> Float64:
        """Return T_odom_base float64 (K, 4, 4) at stamps int64 (K,) that are bracketed."""
        if self.mode == "odometry":
            return self._track.at(stamps_ns)
        if self._chain is not None:
            return self._chain.at(stamps_ns)
        return np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4)).copy()

    @property
    def tracks(self) -> list[PoseTrack]:
        """The tracks that the motion is read from: none where the base stands still."""
        if self.mode == "odometry":
            return [self._track]
        if self._chain is None:
            return []
        return [track for track in self._chain.tracks if isinstance(track, PoseTrack)]


def _no_joint(joint: Joint) -> JointReading:
    raise FrameError(f"joint '{joint.name}' is not in tf")
