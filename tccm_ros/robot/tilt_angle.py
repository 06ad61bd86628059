"""The tilt angle over time for the tilt cycles: increasing stamps, unwrapped angles."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.arrays import Float64
from tccm_ros.robot.chain import JointReading, MovingTransform, Part, twist_angle
from tccm_ros.robot.tracks import PoseTrack

AXIS_ANGLE = 0.02
"""Rotation of a moving transform after which its axis is known, rad. Chosen: 1.1 deg, above the
noise of joints."""


class TiltReadout:
    """Reads corrected tilt angles from the samples of the tilt joint, each once.

    Parameters
    ----------
    scale, offset
        The correction: angle a of the joint becomes ``scale * a + offset``.
    """

    def __init__(self, scale: float, offset: float) -> None:
        self._part: Part | None = None
        self._correction = (scale, offset)
        self._scale = 1.0
        self._offset = 0.0
        self._given_ns: int | None = None
        self._angle: float | None = None
        self._revolutions = 0

    @property
    def name(self) -> str | None:
        """The tilt joint, or the moving tf frame; None until it is known."""
        return None if self._part is None else self._part.name

    def follow(self, part: Part, *, final: bool) -> bool:
        """Set a part of the chain as the tilt joint and apply the correction to it.

        Returns
        -------
        False where a tf transform needs a correction about an axis that is still unknown, unless
        `final`: then it is used without correction.
        """
        scale, offset = self._correction
        if isinstance(part, JointReading):
            part.scale *= scale
            part.offset = scale * part.offset + offset
        else:
            part.axis = find_axis(part.track)
            if part.axis is None and self._correction != (1.0, 0.0) and not final:
                return False
            part.scale, part.offset = scale, offset
        self._scale, self._offset = part.scale, part.offset
        self._part = part
        return True

    def clear(self) -> None:
        """Restart after a jump of the clock."""
        self._given_ns = self._angle = None
        self._revolutions = 0

    def drain(self) -> list[tuple[int, float]]:
        """Return the samples (stamp_ns, corrected angle in rad) since the last call."""
        if self._part is None:
            return []
        track = self._part.track
        newest_ns = track.latest_ns
        if newest_ns is None or (self._given_ns is not None and newest_ns <= self._given_ns):
            return []
        if isinstance(self._part, MovingTransform) and self._part.axis is None:
            self._part.axis = find_axis(self._part.track)
            if self._part.axis is None:
                return []
        first = 0
        if self._given_ns is not None:
            first = int(track.stamps_ns.searchsorted(self._given_ns, "right"))
        stamps = track.stamps_ns[first:].tolist()
        angles = [self._unwrapped(angle) for angle in self._raw(self._part, first).tolist()]
        self._given_ns = stamps[-1]
        return list(zip(stamps, angles))

    def _raw(self, part: Part, first: int) -> Float64:
        if isinstance(part, MovingTransform):
            assert part.axis is not None
            return twist_angle(part.track.at(part.track.stamps_ns[first:]), part.axis)
        return part.track.values[first:, 0]

    def _unwrapped(self, angle: float) -> float:
        is_revolute = isinstance(self._part, MovingTransform) or (
            self._part is not None and self._part.is_revolute
        )
        if is_revolute and self._angle is not None:
            self._revolutions -= round((angle - self._angle) / (2.0 * np.pi))
        self._angle = angle
        return self._scale * (angle + self._revolutions * 2.0 * np.pi) + self._offset


def find_axis(track: PoseTrack) -> Float64 | None:
    """Return the rotation axis float64 (3,) of a transform, in the child frame.

    The axis is computed between the first sample and the first that has rotated by `AXIS_ANGLE`;
    its largest component is positive. None while there is no such sample.
    """
    if not len(track):
        return None
    rotations = Rotation.from_quat(track.values[:, 3:])
    relative = (rotations[0].inv() * rotations).as_rotvec()
    angles = np.linalg.norm(relative, axis=1)
    moved = np.flatnonzero(angles > AXIS_ANGLE)
    if not len(moved):
        return None
    axis = relative[moved[0]] / angles[moved[0]]
    return axis * np.sign(axis[np.argmax(np.abs(axis))])
