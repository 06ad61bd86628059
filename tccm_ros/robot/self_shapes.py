"""The robot's own collision shapes in the base frame, for the self filter."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import FrameError
from tccm_ros.kernels import kernel
from tccm_ros.records import SelfShapes
from tccm_ros.robot.chain import JointReading, TransformChain, apply_fixed, apply_joint
from tccm_ros.robot.frames import Edges, build_chain, find_path
from tccm_ros.robot.urdf import Joint, RobotModel

#: Shape kinds; the index is used in `SelfShapes.kinds`.
SHAPE_KINDS = ("box", "sphere", "cylinder")

#: Parent index of shapes that are fixed to the base.
ROOT = -1


@dataclass(frozen=True, slots=True, eq=False)
class _MovedFrame:
    """The frame after a joint: parent, fixed transform from it, and the joint."""

    parent: int
    before: Float64
    axis: Float64
    reading: JointReading


class ShapeModel:
    """Forward kinematics of a robot's collision shapes.

    Parameters
    ----------
    model, base, edges
        The robot, its base frame, and the tree of frames.
    reading
        Function that returns the samples of a joint.
    """

    def __init__(
        self,
        model: RobotModel,
        base: str,
        edges: Edges,
        reading: Callable[[Joint], JointReading],
    ):
        self._joints: list[_MovedFrame] = []
        self._frame_of: dict[tuple[tuple[str, bool], ...], int] = {(): ROOT}
        hangs: dict[str, tuple[int, Float64]] = {}
        for link in dict.fromkeys(shape.link for shape in model.shapes):
            with suppress(FrameError):  # shapes without a chain to the base are left out
                hangs[link] = self._hang(build_chain(find_path(base, link, edges), reading))
        shapes = [shape for shape in model.shapes if shape.link in hangs]
        self._kinds = np.array([SHAPE_KINDS.index(s.kind) for s in shapes], np.int64)
        self._half = np.array([s.size for s in shapes]).reshape(-1, 3)
        self._hangs_on = np.array([hangs[s.link][0] for s in shapes], np.int64)
        self._T_frame_shape = np.array([hangs[s.link][1] @ s.T_link_shape for s in shapes]).reshape(
            -1, 4, 4
        )
        self._parents = np.array([f.parent for f in self._joints], np.int64)
        self._before = np.array([f.before for f in self._joints]).reshape(-1, 4, 4)
        self._axes = np.array([f.axis for f in self._joints]).reshape(-1, 3)
        self._is_revolute = np.array([f.reading.is_revolute for f in self._joints], np.bool_)

    def _hang(self, chain: TransformChain) -> tuple[int, Float64]:
        """Return the last moved frame of a chain, and the fixed transform from there."""
        key: tuple[tuple[str, bool], ...] = ()
        for (part, backwards), before in zip(chain.parts, chain.fixed):
            if not isinstance(part, JointReading):
                raise FrameError(f"'{part.name}' is not a joint")
            parent = self._frame_of[key]
            key = (*key, (part.name, backwards))
            if key not in self._frame_of:
                self._frame_of[key] = len(self._joints)
                axis = -part.axis if backwards else part.axis
                self._joints.append(_MovedFrame(parent, before, axis, part))
        return self._frame_of[key], chain.fixed[-1]

    def at(self, stamp_ns: int) -> SelfShapes:
        """Return the shapes at a stamp, without those whose joints have no samples around it."""
        stamps = np.array([stamp_ns], np.int64)
        positions = np.full(len(self._joints), np.nan)
        for i, frame in enumerate(self._joints):
            if frame.reading.track.widest_gap_ns(stamp_ns, stamp_ns) is not None:
                positions[i] = frame.reading.at(stamps)[0]
        T_base_shape = place_shapes(
            self._parents,
            self._before,
            self._axes,
            self._is_revolute,
            positions,
            self._hangs_on,
            self._T_frame_shape,
        )
        placed = ~np.isnan(T_base_shape[:, 0, 0])
        if placed.all():
            return SelfShapes(self._kinds, self._half, T_base_shape)
        return SelfShapes(self._kinds[placed], self._half[placed], T_base_shape[placed])


@kernel
def place_shapes(parents, before, axes, is_revolute, positions, hangs_on, T_frame_shape):  # type: ignore[no-untyped-def]
    """Return the poses of shapes in a tree of moved frames, T_base_shape float64 (S, 4, 4).

    The pose of a moved frame is its parent's pose times a fixed transform times the joint's motion.
    Shapes below a joint without a position are NaN.

    Parameters
    ----------
    parents
        int64 (N,): parent index of each moved frame, smaller than its own, or ROOT for the base.
    before
        float64 (N, 4, 4): fixed transform from the parent to the joint.
    axes, is_revolute, positions
        float64 (N, 3), bool (N,) and float64 (N,) of the joints; positions in rad or m, or nan.
    hangs_on
        int64 (S,): the moved frame of each shape, or ROOT.
    T_frame_shape
        float64 (S, 4, 4): pose of each shape in that frame.
    """
    frames = np.empty((len(parents), 4, 4))
    for n in range(len(parents)):
        if parents[n] == ROOT:
            frames[n] = before[n]
        else:
            frames[n] = frames[parents[n]]
            apply_fixed(frames[n : n + 1], before[n])
        apply_joint(frames[n : n + 1], axes[n], positions[n : n + 1], is_revolute[n])
        if np.isnan(positions[n]):
            frames[n, :3] = np.nan
    placed = np.empty((len(hangs_on), 4, 4))
    for s in range(len(hangs_on)):
        if hangs_on[s] == ROOT:
            placed[s] = T_frame_shape[s]
        else:
            placed[s] = frames[hangs_on[s]]
            apply_fixed(placed[s : s + 1], T_frame_shape[s])
    return placed
