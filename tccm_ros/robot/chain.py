"""Chains of fixed transforms and moving parts, evaluated at many stamps at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.geometry import inverse
from tccm_ros.kernels import kernel
from tccm_ros.robot.tracks import PoseTrack, ScalarTrack


@dataclass(slots=True, eq=False)
class JointReading:
    """A joint of a chain and its position from samples: q = scale * sample + offset.

    Attributes
    ----------
    name
        Name of the joint in the chain.
    track
        Samples of the joint, or of the joint that it mimics.
    axis
        Unit vector float64 (3,) in the joint's frame.
    is_revolute
        Whether the joint rotates about the axis; otherwise it translates along it.
    scale, offset
        Coefficients of a mimic joint, corrected by the rig's calibration.
    """

    name: str
    track: ScalarTrack
    axis: Float64
    is_revolute: bool
    scale: float = 1.0
    offset: float = 0.0

    def at(self, stamps_ns: Int64) -> Float64:
        """Return positions float64 (K,), rad or m."""
        q = self.track.at(stamps_ns, wraps=self.is_revolute)
        if self.scale != 1.0 or self.offset != 0.0:
            q = self.scale * q + self.offset
        return q

    def apply(self, T: Float64, stamps_ns: Int64, *, backwards: bool) -> None:
        """Multiply poses (K, 4, 4) in place by the joint's motion, or by its inverse.

        Parameters
        ----------
        T
            float64 (K, 4, 4), multiplied from the right.
        stamps_ns
            int64 (K,), bracketed by the track.
        backwards
            Whether the chain goes from the joint's child to its parent.
        """
        q = self.at(stamps_ns)
        apply_joint(T, self.axis, -q if backwards else q, self.is_revolute)


@dataclass(slots=True, eq=False)
class MovingTransform:
    """A moving tf transform in a chain, with a rotational correction about `axis` in its child.

    The correction maps the angle `a` about the axis to ``scale * a + offset``.

    Attributes
    ----------
    name
        Name of the child frame.
    track
        T_parent_child over time.
    axis
        Unit vector float64 (3,) in the child frame; None for no correction.
    scale, offset
        The correction; offset in rad.
    """

    name: str
    track: PoseTrack
    axis: Float64 | None = None
    scale: float = 1.0
    offset: float = 0.0

    def apply(self, T: Float64, stamps_ns: Int64, *, backwards: bool) -> None:
        """Multiply poses (K, 4, 4) in place by the transform, or by its inverse.

        Parameters
        ----------
        T
            float64 (K, 4, 4), multiplied from the right.
        stamps_ns
            int64 (K,), bracketed by the track.
        backwards
            Whether the chain goes from child to parent.
        """
        moved = self.track.at(stamps_ns)
        if self.axis is not None and (self.scale != 1.0 or self.offset != 0.0):
            angle = twist_angle(moved, self.axis)
            apply_joint(moved, self.axis, (self.scale - 1.0) * angle + self.offset, True)
        T[:] = T @ (inverse(moved) if backwards else moved)


Part = JointReading | MovingTransform


@dataclass(slots=True, eq=False)
class TransformChain:
    """T_a_b as alternating fixed transforms and moving parts.

    Attributes
    ----------
    fixed
        float64 (P + 1, 4, 4): the fixed transforms before each part and after the last one.
    parts
        The moving parts from a to b, each with True where the chain goes from its child to its
        parent.
    """

    fixed: Float64
    parts: tuple[tuple[Part, bool], ...]

    @property
    def tracks(self) -> list[ScalarTrack | PoseTrack]:
        """The tracks of the moving parts."""
        return [part.track for part, _ in self.parts]

    def at(self, stamps_ns: Int64) -> Float64:
        """Return T_a_b float64 (K, 4, 4) at stamps int64 (K,) within the samples of all tracks."""
        T = np.empty((len(stamps_ns), 4, 4))
        T[:] = self.fixed[0]
        for (part, backwards), after in zip(self.parts, self.fixed[1:]):
            part.apply(T, stamps_ns, backwards=backwards)
            apply_fixed(T, after)
        return T


@kernel
def apply_fixed(T, F):  # type: ignore[no-untyped-def]
    """Multiply rigid poses (K, 4, 4) in place by one rigid transform from the right."""
    row = np.empty(4)
    for k in range(T.shape[0]):
        for i in range(3):
            for j in range(4):
                row[j] = T[k, i, 0] * F[0, j] + T[k, i, 1] * F[1, j] + T[k, i, 2] * F[2, j]
            row[3] += T[k, i, 3]
            for j in range(4):
                T[k, i, j] = row[j]


@kernel
def apply_joint(T, axis, q, is_revolute):  # type: ignore[no-untyped-def]
    """Multiply rigid poses by a rotation about an axis, or by a translation along it.

    Parameters
    ----------
    T
        float64 (K, 4, 4), multiplied in place from the right.
    axis
        Unit vector float64 (3,) in the frame of T's child.
    q
        float64 (K,), rad or m.
    is_revolute
        Whether the motion is a rotation (Rodrigues' formula) or a translation.
    """
    x, y, z = axis[0], axis[1], axis[2]
    R = np.empty((3, 3))
    row = np.empty(3)
    for k in range(T.shape[0]):
        if not is_revolute:
            for i in range(3):
                T[k, i, 3] += q[k] * (T[k, i, 0] * x + T[k, i, 1] * y + T[k, i, 2] * z)
            continue
        c, s = np.cos(q[k]), np.sin(q[k])
        v = 1.0 - c
        R[0, 0], R[0, 1], R[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
        R[1, 0], R[1, 1], R[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
        R[2, 0], R[2, 1], R[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v
        for i in range(3):
            for j in range(3):
                row[j] = T[k, i, 0] * R[0, j] + T[k, i, 1] * R[1, j] + T[k, i, 2] * R[2, j]
            for j in range(3):
                T[k, i, j] = row[j]


def twist_angle(T_a_b: Float64, axis: Float64) -> Float64:
    """Return the angles float64 (K,) of poses (K, 4, 4) about an axis in b, in (-pi, pi]."""
    R = T_a_b[:, :3, :3]
    w = 1.0 + np.trace(R, axis1=1, axis2=2)
    v = np.stack(
        [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1
    )
    return 2.0 * np.arctan2(v @ axis, w)
