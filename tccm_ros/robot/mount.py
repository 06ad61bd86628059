"""Pose of a sensor in the base over time, its tilt angle, and the robot's own shapes.

All moving joints between base and sensor are included; poses are interpolated, never extrapolated.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Int64
from tccm_ros.config import Config
from tccm_ros.errors import FrameError, suggest
from tccm_ros.records import SelfShapes
from tccm_ros.robot.chain import JointReading, Part, TransformChain
from tccm_ros.robot.chain_finder import ChainFinder, MountKind
from tccm_ros.robot.frames import FrameTree
from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.self_shapes import ShapeModel
from tccm_ros.robot.tilt_angle import TiltReadout
from tccm_ros.robot.tracks import ScalarTrack, Track, merge_stamps

SAMPLE_STEP_NS = 10_000_000
"""Maximum interval between poses; the motion between two is a short arc."""

OTHER_CLOCK_NS = 3_600_000_000_000
"""Stamps that differ by more than an hour, ns, are from two clocks: no recording pauses a joint for
that long."""

NO_STAMPS = np.zeros(0, np.int64)


class Mount:
    """The mount of one sensor on the robot.

    Parameters
    ----------
    config
        Groups `frames` and `rig`.
    kind
        How the sensor is mounted.
    frames, joints
        Frames and joints known so far, common to all sensors.
    can_be_base
        Whether the sensor is the base if there are no frames.
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
        self._no_chain: FrameError | None = None
        self._no_samples: tuple[FrameError, Track | None] | None = None
        self._kind = kind
        self._frames = frames
        self._joints = joints
        self._finder = ChainFinder(config, kind, frames, joints, can_be_base=can_be_base)
        self._chains: dict[str, TransformChain] = {}
        self._version = -1
        self._tilt = TiltReadout(config.rig.tilt_scale, config.rig.tilt_offset)
        self._shapes: ShapeModel | None = None
        self._shapes_version: tuple[int, str] | None = None
        self._tilt_joint, self._pan_offset = config.frames.tilt_joint, config.rig.pan_offset
        self._T_correction = kind.T_correction(config.rig)

    @property
    def base(self) -> str | None:
        """Base frame; None until it is found."""
        return self._finder.base

    @property
    def is_base(self) -> bool:
        """Whether the sensor itself is the base, as there are no frames."""
        return self._finder.is_base

    @property
    def odometry_chain(self) -> TransformChain | None:
        """Chain from the child frame of odometry to the base; None if they are equal."""
        return self._finder.odometry_chain

    @property
    def problem(self) -> FrameError | None:
        """Error: the newest record has no chain to the base, or its chain lacks samples."""
        missing = None if self._no_samples is None else self._no_samples[1]
        if missing is not None and len(missing):
            self._no_samples = None
        return self._no_chain or (None if self._no_samples is None else self._no_samples[0])

    def clear_samples(self) -> None:
        """Clear all time-stamped data, after a jump of the clock."""
        self._tilt.clear()
        self._chains.clear()

    # -- finding the chain ---------------------------------------------------------------------

    def find(self, frame: str, *, final: bool) -> TransformChain | None:
        """Find the chain base -> sensor.

        Parameters
        ----------
        frame
            Frame of the sensor.
        final
            Whether to decide with the present knowledge. Otherwise None is returned while a
            preferred source may still arrive.

        Raises
        ------
        FrameError
            If `final` and there is no chain, no such joint, or an ambiguity.
        """
        if self._version != self._frames.version:
            self._chains.clear()
            self._version = self._frames.version
        chain = self._chains.get(frame)
        if chain is not None:
            self._no_chain = None
            return chain
        try:
            chain = self._finder.find(frame, final=final)
            part = None
            if chain is not None and self._is_corrected(chain):
                part = self._finder.tilt_part(chain)
                _correct_pan(chain, part, self._pan_offset)
        except FrameError as error:
            if not final:
                return None
            self._no_chain = error
            raise
        if chain is None or (part is not None and not self._tilt.follow(part, final=final)):
            return None
        if part is not None or self._kind is not MountKind.ANY:
            chain.fixed[0] = self._T_correction @ chain.fixed[0]
        self._chains[frame], self._no_chain = chain, None
        return chain

    def _is_corrected(self, chain: TransformChain) -> bool:
        """Return whether tilt corrections apply; for a camera only if its tilt joint is named."""
        if self._kind is not MountKind.ANY:
            return self._kind is MountKind.TILTING
        return bool(self._tilt_joint) and any(p.name == self._tilt_joint for p, _ in chain.parts)

    # -- the tilt joint ------------------------------------------------------------------------

    @property
    def tilt_joint(self) -> str | None:
        """Name of the tilt joint, or of the moving tf frame; None until found."""
        return self._tilt.name

    def tilt_samples(self) -> list[tuple[int, float]]:
        """Return new samples (stamp_ns, corrected tilt angle in rad), in stamp order, once each.

        The angle is unwrapped.
        """
        return self._tilt.drain()

    # -- the robot itself ----------------------------------------------------------------------

    def self_shapes(self, stamp_ns: int) -> SelfShapes | None:
        """Return the robot's collision shapes in the base at a stamp.

        Returns
        -------
        None without a robot description, before the base is known, and where no link has a box,
        sphere or cylinder. Links below joints without samples around the stamp are left out.
        """
        model = self._frames.model
        if model is None or self.base is None or not model.shapes:
            return None
        if self._shapes is None or self._shapes_version != (self._frames.version, self.base):
            edges = self._frames.view(moving_tf=False)
            self._shapes = ShapeModel(model, self.base, edges, self._finder.reading)
            self._shapes_version = (self._frames.version, self.base)
        return self._shapes.at(stamp_ns)

    # -- poses ---------------------------------------------------------------------------------

    def explain_missing(
        self, reason: str, track: Track, chain: TransformChain, stamp_ns: int
    ) -> None:
        """Set `problem` where there is a known reason for a track without samples at a record.

        Parameters
        ----------
        reason
            Reason of the drop, such as missing samples.
        track
            Track of a joint of the chain, of a transform or of odometry.
        chain
            Chain from base to sensor.
        stamp_ns
            Stamp of the record.
        """
        silent = [part for part, _ in chain.parts if not len(part.track)]
        problem = self._joints.explain(track) if isinstance(track, ScalarTrack) else None
        if problem is not None:
            self._no_samples = FrameError(problem), None
        elif track.latest_ns is not None and abs(stamp_ns - track.latest_ns) > OTHER_CLOCK_NS:
            error = FrameError(
                f"{reason} at a stamp of {stamp_ns * 1e-9:.10g} s: the newest has a stamp of "
                f"{track.latest_ns * 1e-9:.10g} s; set the clocks, or have the driver fill in its "
                "stamps"
            )
            self._no_samples = error, None
        elif silent and isinstance(track, ScalarTrack):
            error = FrameError(
                f"no samples of joint '{silent[-1].name}' in the joint states, which moves the "
                "laser" + suggest(silent[-1].name, self._joints.heard())
            )
            self._no_samples = error, silent[-1].track

    def note_posed(self) -> None:
        """Clear the error of missing samples, as a later record was posed."""
        self._no_samples = None

    def pose_stamps(self, chain: TransformChain, start_ns: int, end_ns: int, *more: Int64) -> Int64:
        """Return the stamps at which to compute poses, so that the motion between is a short arc.

        Parameters
        ----------
        chain
            Chain from base to sensor.
        start_ns, end_ns
            Times of the first and last measurement of a record.
        more
            int64 (N,) each: stamps of further samples in the interval, such as odometry's.

        Returns
        -------
        int64 (K,), strictly increasing from start to end: the stamps of the chain's samples and
        `more`, and intermediate stamps every `SAMPLE_STEP_NS`.
        """
        if start_ns == end_ns:
            return np.array([start_ns], np.int64)
        inner = [track.stamps_within(start_ns, end_ns) for track in chain.tracks]
        return merge_stamps(
            start_ns, end_ns, SAMPLE_STEP_NS, np.concatenate([*inner, *more, NO_STAMPS])
        )


def _correct_pan(chain: TransformChain, tilt: Part, offset: float) -> None:
    """Add the offset to the revolute joint before the tilt joint, if joint states give it."""
    before: list[JointReading] = []
    for part, _ in chain.parts:
        if part is tilt:
            break
        if isinstance(part, JointReading) and part.is_revolute:
            before.append(part)
    if before:
        before[-1].offset += offset
