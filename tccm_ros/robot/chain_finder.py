"""Find the chain from the base to a sensor automatically (docs/design/frames_and_time.md).

The base is the child frame of odometry where the robot has it, else a root; the tilt joint is the
revolute joint nearest to the laser. The chain comes from the robot description, from tf, or from
the configured rig; an ambiguity is an error that names the candidates.
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config, RigConfig
from tccm_ros.errors import FrameError, suggest
from tccm_ros.geometry import pose, pose_from_rpy
from tccm_ros.robot.chain import JointReading, MovingTransform, Part, TransformChain
from tccm_ros.robot.frames import (
    Edges,
    FrameTree,
    ancestors,
    build_chain,
    find_path,
    frames_of,
)
from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.urdf import Joint, RobotModel

#: Default name of the base.
DEFAULT_BASE = "base_link"


class MountKind(Enum):
    """Kind of mount: the requirements on the chain, and the parameters of `rig` that apply."""

    TILTING = "tilt_laser"
    """Moved by a tilt joint; `rig.tilt_laser` is its pose."""

    LEVEL = "level_laser"
    """Horizontal scan plane; `rig.level_laser` is its pose."""

    ANY = ""
    """Pose from the robot description or tf only, with any joints.

    If `frames.tilt_joint` moves the sensor, the corrections of `rig` apply as for a tilting laser.
    """

    def rig_place(self, rig: RigConfig) -> tuple[float, ...] | None:
        """Return the configured x y z roll pitch yaw in the base; None if not configured."""
        return {MountKind.TILTING: rig.tilt_laser, MountKind.LEVEL: rig.level_laser}.get(self)

    def T_correction(self, rig: RigConfig) -> Float64:
        """Return the correction that multiplies T_base_sensor from the left, float64 (4, 4)."""
        corrections = {
            MountKind.TILTING: rig.mount_correction,
            MountKind.ANY: rig.mount_correction,
            MountKind.LEVEL: rig.level_correction,
        }
        return pose_from_rpy(corrections[self])


class ChainFinder:
    """Finds chains in the frames and joints of the robot.

    Parameters
    ----------
    config
        Groups `frames` and `rig`.
    kind
        How the sensor is mounted.
    frames, joints
        Frames and joints known so far.

    Attributes
    ----------
    base
        Base frame; None until a chain is found.
    odometry_chain
        Chain from the child frame of odometry to the base; None if they are equal.
    is_base
        Whether the sensor itself is the base, as there are no other frames and no odometry.
    """

    def __init__(
        self,
        config: Config,
        kind: MountKind,
        frames: FrameTree,
        joints: JointTracks,
        *,
        can_be_base: bool = False,
    ):
        self._can_be_base = can_be_base
        self.base: str | None = config.frames.base or None
        self.odometry_chain: TransformChain | None = None
        self.is_base = False
        self._config = config
        self._kind = kind
        self._frames = frames
        self._joints = joints

    def find(self, laser: str, *, final: bool) -> TransformChain | None:
        """Find the chain to a laser; None while a preferred source may still arrive.

        Raises
        ------
        FrameError
            Where there is no chain, no such joint, or an ambiguity.
        """
        source = self._config.rig.kinematics
        if source == "rig":
            return self._rig_chain()
        model = None if source == "tf" else self._frames.model
        if source != "tf" and model is None and not final:
            return None
        if source == "urdf" and model is None:
            raise FrameError("no robot description was received; publish it on robot_description")
        edges = self._frames.view(urdf=source != "tf", moving_tf=source != "urdf")
        known = frames_of(edges)
        if source == "auto" and laser not in known and self._has_rig():
            return self._rig_chain() if final else None
        self.is_base = self._has_no_frames(known)
        if self.is_base:
            self.base = laser
            return TransformChain(np.eye(4)[None], ()) if final else None
        base = self._find_base(laser, known, model)
        if source == "auto" and self._silent_joints(base, laser, edges):
            if not final:
                return None
            edges = self._with_tf_for_silent_joints(base, laser, edges)
        self.base = base
        self.odometry_chain = self._odometry_chain(base, known, edges)
        return build_chain(find_path(base, laser, edges), self.reading)

    def _has_no_frames(self, known: set[str]) -> bool:
        """Return whether the sensor may be the base and there are no frames and no odometry."""
        is_alone = not known and not self._frames.odometry_child and not self._config.frames.base
        return is_alone and self._can_be_base and self._config.rig.kinematics == "auto"

    def _odometry_chain(self, base: str, known: set[str], edges: Edges) -> TransformChain | None:
        child = self._frames.odometry_child
        if not child or child == base or child not in known:
            return None
        return build_chain(find_path(child, base, edges), self.reading)

    def _find_base(self, laser: str, known: set[str], model: RobotModel | None) -> str:
        """Return the base: configured, the child frame of odometry, or a root of the model."""
        if self._config.frames.base:
            return self._config.frames.base
        child = self._frames.odometry_child
        if child and (child in known or (model and child in model.links) or model is None):
            return child
        odom = self._config.frames.odom_name
        moved = [e.child for e in self._frames.tf.values() if e.parent == odom]
        if model is not None:
            inside = [frame for frame in moved if frame in model.links]
            return inside[0] if len(inside) == 1 else model.root
        if not known:
            raise FrameError("no frames at all: neither a robot description nor tf was received")
        return moved[0] if len(moved) == 1 else self._base_in_tf(laser)

    def _base_in_tf(self, laser: str) -> str:
        """Return the base by tf alone: below the robot's own motion, above the tilt joint.

        Raises
        ------
        FrameError
            Where a tilting laser is below several moving transforms: each of them may be the
            robot's own motion.
        """
        above = ancestors(laser, dict(self._frames.tf))
        edges = {frame: self._frames.tf[frame] for frame in above[:-1]}
        on_tf = [frame for frame, edge in edges.items() if edge.T_parent_child is None]
        moving = [frame for frame in on_tf if edges[frame].track.has_moved] or on_tf
        if self._kind is not MountKind.TILTING:
            return moving[0] if moving else above[-1]
        if len(moving) > 1:
            candidates = sorted([*moving[1:], above[-1]])
            raise FrameError(
                "the base frame is ambiguous, set frames.base" + suggest("", candidates)
            )
        return above[-1]

    def _silent_joints(self, base: str, laser: str, edges: Edges) -> list[Joint]:
        moving = [
            edge
            for edge, _ in find_path(base, laser, edges)
            if isinstance(edge, Joint) and edge.motion in ("turn", "slide")
        ]
        return [joint for joint in moving if not len(self.reading(joint).track)]

    def _with_tf_for_silent_joints(self, base: str, laser: str, edges: Edges) -> Edges:
        """Return the edges, with tf transforms instead of joints that have no samples."""
        replaced = dict(edges)
        for joint in self._silent_joints(base, laser, edges):
            if joint.child in self._frames.tf:
                replaced[joint.child] = self._frames.tf[joint.child]
        return replaced

    def reading(self, joint: Joint) -> JointReading:
        """Return the reading of a joint; mimic joints are followed to the joint with samples."""
        scale, offset, source, seen = 1.0, 0.0, joint, {joint.name}
        by_name = self.model_joints()
        while source.mimic is not None:
            if source.fault:
                raise FrameError(source.fault)
            offset += scale * source.mimic.offset
            scale *= source.mimic.multiplier
            if source.mimic.joint in seen:
                raise FrameError(f"joint '{joint.name}' mimics itself")
            seen.add(source.mimic.joint)
            source = by_name[source.mimic.joint]
        track = self._joints.of(source.name)
        return JointReading(joint.name, track, joint.axis, joint.motion == "turn", scale, offset)

    def model_joints(self) -> dict[str, Joint]:
        """Return the joints of the robot description by their names."""
        model = self._frames.model
        return {} if model is None else {joint.name: joint for joint in model.joints.values()}

    def _has_rig(self) -> bool:
        return self._kind.rig_place(self._config.rig) is not None

    def _rig_chain(self) -> TransformChain:
        rig = self._config.rig
        self.base = self._config.frames.base or self._frames.odometry_child or DEFAULT_BASE
        self.odometry_chain = None
        laser = self._kind.rig_place(rig)
        if laser is None:
            name = f"rig.{self._kind.value}" if self._kind.value else "its place in the rig"
            raise FrameError(f"{name} is not set: the sensor's place is not known")
        T_base_laser = pose_from_rpy(laser)
        if self._kind is not MountKind.TILTING:
            return TransformChain(T_base_laser[None], ())
        center = np.array(rig.tilt_center or laser[:3])
        length = float(np.linalg.norm(rig.tilt_axis))
        if length < 1e-9:
            raise FrameError("rig.tilt_axis is zero; a direction is expected")
        axis = np.array(rig.tilt_axis) / length
        name = self._config.frames.tilt_joint or self._only_joint()
        reading = JointReading(name, self._joints.of(name), axis, True)
        fixed = np.array([pose(np.eye(3), center), pose(np.eye(3), -center) @ T_base_laser])
        return TransformChain(fixed, ((reading, False),))

    def _only_joint(self) -> str:
        names = self._joints.heard()
        if len(names) != 1:
            raise FrameError(
                "the tilt joint is not known" + suggest("", names) + "; set frames.tilt_joint"
            )
        return names[0]

    def tilt_part(self, chain: TransformChain) -> Part:
        """Return the tilt joint: the configured one, else the revolute one nearest to the laser.

        Raises
        ------
        FrameError
            Where there is none; the message names the existing joints.
        """
        turning = [
            part
            for part, _ in chain.parts
            if (part.track.has_moved if isinstance(part, MovingTransform) else part.is_revolute)
        ]
        wanted = self._config.frames.tilt_joint
        if wanted:
            for part in turning:
                if part.name == wanted:
                    return part
            names = {part.name for part in turning} | set(self.model_joints())
            raise FrameError(f"no joint '{wanted}' between base and laser" + suggest(wanted, names))
        if not turning:
            raise FrameError(
                "no moving joint between base and laser, but a tilting laser needs one"
                + suggest("", self.model_joints())
            )
        return turning[-1]
