"""Where a laser is in the base while it measures, the tilt angle, and the robot's own shapes.

Every moving joint between base and laser is followed; poses are given between samples only.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.errors import FrameError, suggest
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import JointSample, Odometry, RobotDescription, TransformSample
from tccm_ros.robot.chain import Chain
from tccm_ros.robot.chain_finder import ChainFinder
from tccm_ros.robot.frames import FrameTree, plain_name
from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.self_shapes import SelfShapes, ShapeModel
from tccm_ros.robot.tilt_angle import TiltReadout
from tccm_ros.robot.tracks import merge_stamps
from tccm_ros.robot.urdf import read_urdf

__all__ = ["LaserKinematics", "NotBracketed"]

#: Poses are given at least this often, so that what lies between is a short arc.
KNOT_STEP_NS = 10_000_000

NO_STAMPS = np.zeros(0, np.int64)

Int64 = NDArray[np.int64]
Float64 = NDArray[np.float64]


class NotBracketed(Exception):
    """A stamp that the samples do not bracket: it is never guessed."""


class LaserKinematics:
    """The pose of one laser in the base, from what is known of the robot.

    Parameters
    ----------
    config
        Groups `frames` and `rig` are used.
    role
        ``tilt``: the laser turns with a tilt joint; ``level``: it does not.

    Attributes
    ----------
    frames
        The tree of frames.
    joints
        The samples of all joints.
    problem
        The last reason for which no chain was found, None if there was none.
    """

    def __init__(self, config: Config, role: Literal["tilt", "level"]):
        rig = config.rig
        correction = rig.mount_correction if role == "tilt" else rig.level_correction
        self.role = role
        self.frames = FrameTree()
        self.joints = JointTracks(round(rig.joint_time_offset * 1e9))
        self.problem: FrameError | None = None
        self._finder = ChainFinder(config, role, self.frames, self.joints)
        self._chains: dict[str, Chain] = {}
        self._version = -1
        self._urdf: str | None = None
        self._tilt = TiltReadout(rig.tilt_scale, rig.tilt_offset)
        self._shapes: ShapeModel | None = None
        self._shapes_version: tuple[int, str] | None = None
        self._T_correction = pose_from_rpy(correction)

    @property
    def base(self) -> str | None:
        """Base frame, None until it is found."""
        return self._finder.base

    @property
    def odometry_chain(self) -> Chain | None:
        """From the frame that odometry follows to the base, None where they are the same."""
        return self._finder.odometry_chain

    # -- what is fed in ------------------------------------------------------------------------

    def add(self, record: RobotDescription | JointSample | TransformSample | Odometry) -> int:
        """Take one record; return how many samples in it are left out because they are late.

        Raises
        ------
        UrdfError
            For a robot description that cannot be read; the one before stays.
        """
        if isinstance(record, JointSample):
            return self.joints.add(record)
        if isinstance(record, TransformSample):
            return int(not self.frames.add_transform(record))
        if isinstance(record, RobotDescription):
            self._add_description(record)
        elif self._finder.odometry_child is None:
            self._finder.odometry_child = plain_name(record.child_frame_id)
            self._chains.clear()
        return 0

    def _add_description(self, record: RobotDescription) -> None:
        if record.urdf == self._urdf:
            return
        self.frames.set_model(read_urdf(record.urdf))
        self._urdf = record.urdf

    def clear_samples(self) -> None:
        """Forget everything that has a stamp, as after a jump of the clock."""
        self.joints.clear()
        self.frames.clear_samples()
        self._tilt.clear()
        self._chains.clear()

    def forget_base(self) -> None:
        """Find base and chains anew: odometry has come and may name another base."""
        self._chains.clear()

    # -- finding the chain ---------------------------------------------------------------------

    def find(self, laser_frame: str, *, final: bool) -> Chain | None:
        """Find the chain base -> laser.

        Parameters
        ----------
        laser_frame
            Frame of the scan.
        final
            Whether to decide on what is known. Otherwise None is returned while a source that
            would be preferred may still come.

        Raises
        ------
        FrameError
            If `final` and there is no way, no such joint, or an ambiguity.
        """
        if self._version != self.frames.version:
            self._chains.clear()
            self._version = self.frames.version
        chain = self._chains.get(laser_frame)
        if chain is not None:
            return chain
        try:
            chain = self._finder.find(plain_name(laser_frame), final=final)
            part = None
            if chain is not None and self.role == "tilt":
                part = self._finder.tilt_part(chain)
        except FrameError as error:
            if not final:
                return None
            self.problem = error
            raise
        if chain is None or (part is not None and not self._tilt.follow(part, final=final)):
            return None
        chain.fixed[0] = self._T_correction @ chain.fixed[0]
        self._chains[laser_frame] = chain
        return chain

    # -- the tilt joint ------------------------------------------------------------------------

    @property
    def tilt_joint(self) -> str | None:
        """Name of the tilt joint (or of the moving frame, where tf tells), None until found."""
        return self._tilt.name

    def tilt_samples(self) -> list[tuple[int, float]]:
        """Return new samples (stamp_ns, corrected tilt angle in rad), in stamp order, once each.

        The angle goes on over a wrap.
        """
        return self._tilt.drain()

    # -- the robot itself ----------------------------------------------------------------------

    def self_shapes(self, stamp_ns: int) -> SelfShapes | None:
        """Return the robot's collision shapes in the base at a stamp.

        Returns
        -------
        None without a robot description, before the base is known, and where no link has a box,
        sphere or cylinder. Links are left out whose joints no samples bracket at the stamp.
        """
        model = self.frames.model
        if model is None or self.base is None or not model.shapes:
            return None
        if self._shapes is None or self._shapes_version != (self.frames.version, self.base):
            edges = self.frames.view(urdf=True, tf=True, moving_tf=False)
            self._shapes = ShapeModel(model, self.base, edges, self._finder.reading)
            self._shapes_version = (self.frames.version, self.base)
        return self._shapes.at(stamp_ns)

    # -- poses ---------------------------------------------------------------------------------

    def explain_missing(self, chain: Chain) -> None:
        """Set `problem` where a joint of the chain was never heard of."""
        silent = [part.name for part, _ in chain.parts if not len(part.track)]
        if silent:
            self.problem = FrameError(
                f"no samples of joint '{silent[-1]}' in the joint states, which moves the laser"
                + suggest(silent[-1], self.joints.heard())
            )

    def known_until(self, laser_frame: str) -> int | None:
        """Return the stamp up to which the laser's place is known.

        None where it is not known at all; a laser that nothing moves is known for ever, and the
        largest int64 is returned.
        """
        chain = self._chains.get(laser_frame)
        if chain is None or any(not len(track) for track in chain.tracks):
            return None
        return min((int(t.stamps_ns[-1]) for t in chain.tracks), default=np.iinfo(np.int64).max)

    def knots(self, chain: Chain, start_ns: int, end_ns: int, *more: Int64) -> Int64:
        """Return the stamps at which poses are needed so that what lies between is a short arc.

        Returns
        -------
        int64 (K,), strictly increasing from start to end: the samples' stamps of the chain and
        those `more`, and enough between them.
        """
        if start_ns == end_ns:
            return np.array([start_ns], np.int64)
        inner = [track.stamps_within(start_ns, end_ns) for track in chain.tracks]
        return merge_stamps(
            start_ns, end_ns, KNOT_STEP_NS, np.concatenate([*inner, *more, NO_STAMPS])
        )

    def T_base_laser(self, laser_frame: str, stamps_ns: Int64) -> Float64:
        """Return T_base_laser float64 (K, 4, 4) at stamps int64 (K,).

        Raises
        ------
        FrameError
            Where the laser cannot be placed.
        NotBracketed
            Where a joint or transform has no samples on both sides of a stamp.
        """
        chain = self.find(laser_frame, final=True)
        assert chain is not None
        stamps = np.asarray(stamps_ns, np.int64)
        for part, _ in chain.parts:
            if part.track.widest_gap_ns(int(stamps.min()), int(stamps.max())) is None:
                raise NotBracketed(f"'{part.name}' has no samples around the stamps")
        return chain.at(stamps)
