"""The forward model: positions of hits as a function of the rig's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.calibrate.recording import CycleScans
from tccm_ros.config import RigConfig
from tccm_ros.geometry import pose, pose_from_rpy
from tccm_ros.robot.chain import JointReading, Part, TransformChain, twist_angle

RIG_PARAMETERS = (
    "tilt_offset", "tilt_scale", "roll", "height", "joint_time_offset", "pan_offset",
)  # fmt: skip
"""Order of the parameters of the tilting sensor in vectors and covariances."""

ANGLE_STEP, TIME_STEP = 1e-5, 1e-3
"""Steps of the numerical derivatives by the tilt angle, rad, and by the time offset, s (chosen)."""


@dataclass(frozen=True, slots=True)
class RigValues:
    """Parameters of the pose of the tilting sensor: a laser, or a camera on a head.

    Attributes
    ----------
    tilt_offset, tilt_scale
        True tilt = tilt_scale * measured + tilt_offset, rad.
    roll, height
        Rotation of the tilt axis's mount about the horizontal direction perpendicular to the axis,
        through the axis, rad, and its upward shift, m; both relative to the configured mount.
    joint_time_offset
        Offset added to the stamps of joint samples, s.
    pan_offset
        True pan of a head = measured + pan_offset, rad.
    """

    tilt_offset: float = 0.0
    tilt_scale: float = 1.0
    roll: float = 0.0
    height: float = 0.0
    joint_time_offset: float = 0.0
    pan_offset: float = 0.0

    @classmethod
    def of_rig(cls, rig: RigConfig) -> RigValues:
        """Return the values of a configuration."""
        return cls(rig.tilt_offset, rig.tilt_scale, 0.0, 0.0, rig.joint_time_offset, rig.pan_offset)

    def vector(self) -> Float64:
        """Return the values in the order of `RIG_PARAMETERS`, float64 (6,)."""
        return np.array([getattr(self, name) for name in RIG_PARAMETERS])

    def delayed(self, shift: float) -> RigValues:
        """Return the values with a further offset of the joint's stamps, s."""
        return replace(self, joint_time_offset=self.joint_time_offset + shift)

    @classmethod
    def of_vector(cls, values: Float64) -> RigValues:
        """Return the values of a vector in the order of `RIG_PARAMETERS`."""
        return cls(**dict(zip(RIG_PARAMETERS, np.asarray(values, float).tolist())))


@dataclass(frozen=True, slots=True, eq=False)
class CycleBeams:
    """Beams of one or several tilt cycles, sorted by tilt cycle.

    Attributes
    ----------
    cycle
        int64 (N,), number of the tilt cycle of each beam.
    stamps_ns
        int64 (N,), time of each beam.
    points
        float64 (N, 3), m, hits in the laser's frame.
    T_place_base
        float64 (N, 4, 4), pose of the base relative to the tilt cycle's place.
    """

    cycle: Int64
    stamps_ns: Int64
    points: Float64
    T_place_base: Float64

    def take(self, rows: Bool | Int64) -> CycleBeams:
        """Return a subset of the beams; it must keep them sorted by tilt cycle."""
        return CycleBeams(
            self.cycle[rows], self.stamps_ns[rows], self.points[rows], self.T_place_base[rows]
        )


def beams_of(number: int, cycle: CycleScans) -> CycleBeams:
    """Return the valid beams of the tilt cycle with a number, scan by scan."""
    rows, columns = np.nonzero(np.isfinite(cycle.ranges))
    r = cycle.ranges[rows, columns].astype(float)
    points = r[:, None] * np.broadcast_to(cycle.directions, (*cycle.ranges.shape, 3))[rows, columns]
    poses = cycle.T_place_base()[rows]
    return CycleBeams(np.full(len(r), number), cycle.stamps_ns[rows, columns], points, poses)


def join_beams(parts: Sequence[CycleBeams]) -> CycleBeams:
    """Return the beams of several tilt cycles, in the order of their numbers."""
    names = ("cycle", "stamps_ns", "points", "T_place_base")
    return CycleBeams(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class RigModel:
    """Transforms beams to the base frame for given rig parameters.

    Parameters
    ----------
    cycles
        Scans by tilt cycle, with uncorrected chains.
    rig
        The configured mount, to which roll and height are relative.

    Attributes
    ----------
    pivot
        float64 (3,), a point on the tilt axis in the base, m.
    roll_axis
        float64 (3,), the horizontal direction perpendicular to the tilt axis, nearest to forward.
    """

    def __init__(self, cycles: Sequence[CycleScans], rig: RigConfig) -> None:
        self._cycles = cycles
        self._T_mount = pose_from_rpy(rig.mount_correction)
        self.pivot, axis = self._tilt_axis()
        across = np.array([axis[1], -axis[0], 0.0])
        length = float(np.linalg.norm(across))
        across = across / length if length > 0.5 else np.array([1.0, 0.0, 0.0])
        largest = 0 if abs(across[0]) > 0.1 else 1
        self.roll_axis: Float64 = across * np.sign(across[largest])

    def _tilt_axis(self) -> tuple[Float64, Float64]:
        """Return a point and the direction of the tilt axis in the base in the first tilt cycle."""
        cycle = self._cycles[0]
        chain = cycle.chain
        parts = chain.parts[: cycle.tilt]
        if cycle.is_image:  # a head pans: use its axes at pan zero
            parts = tuple((_at_zero(part), backwards) for part, backwards in parts)
        before = TransformChain(chain.fixed[: cycle.tilt + 1], parts)
        middle = np.array([(cycle.span_ns[0] + cycle.span_ns[1]) // 2], np.int64)
        T = self._T_mount @ before.at(middle)[0]
        part = chain.parts[cycle.tilt][0]
        if isinstance(part, JointReading):
            return T[:3, 3], T[:3, :3] @ part.axis
        T = T @ part.track.at(middle)[0]
        axis = part.axis if part.axis is not None else np.array([0.0, 1.0, 0.0])
        return T[:3, 3], T[:3, :3] @ axis

    def mount(self, values: RigValues) -> Float64:
        """Return the correction of the mount, T_base_base float64 (4, 4)."""
        R = Rotation.from_rotvec(values.roll * self.roll_axis).as_matrix()
        up = np.array([0.0, 0.0, values.height])
        T: Float64 = pose(R, self.pivot - R @ self.pivot + up) @ self._T_mount
        return T

    def T_base_laser(self, cycle: int, stamps_ns: Int64, values: RigValues) -> Float64:
        """Return T_base_laser for given rig parameters.

        Parameters
        ----------
        cycle
            Number of the tilt cycle.
        stamps_ns
            int64 (K,), stamps in that tilt cycle.
        values
            Rig parameters.

        Returns
        -------
        float64 (K, 4, 4)
        """
        return self._laser_poses(cycle, stamps_ns, values, self.mount(values))

    def _laser_poses(
        self, cycle: int, stamps_ns: Int64, values: RigValues, T_mount: Float64
    ) -> Float64:
        """Return T_base_laser for given rig parameters and their mount."""
        data = self._cycles[cycle]
        chain = data.chain
        parts = list(chain.parts)
        part, backwards = parts[data.tilt]
        parts[data.tilt] = (_corrected(part, values), backwards)
        if data.pan is not None:
            pan, backwards = parts[data.pan]
            assert isinstance(pan, JointReading)
            parts[data.pan] = (replace(pan, offset=pan.offset + values.pan_offset), backwards)
        fixed = chain.fixed.copy()
        fixed[0] = T_mount @ fixed[0]
        return TransformChain(fixed, tuple(parts)).at(self._shifted(data, stamps_ns, values))

    @property
    def pans(self) -> bool:
        """Whether the sensor is on a head with a correctable pan joint."""
        return self._cycles[0].pan is not None

    @staticmethod
    def _shifted(data: CycleScans, stamps_ns: Int64, values: RigValues) -> Int64:
        """Return stamps on the clock of the joint samples, clipped to the range of the samples."""
        shifted = stamps_ns - round(values.joint_time_offset * 1e9)
        known = [
            (part.track.stamps_ns[0], part.track.stamps_ns[-1]) for part, _ in data.chain.parts
        ]
        return np.clip(shifted, max(k[0] for k in known), min(k[1] for k in known))

    def transform_points(self, beams: CycleBeams, values: RigValues) -> Float64:
        """Return the hits float64 (N, 3), m, relative to each tilt cycle's place."""
        return self._map(beams, values, beams.points, 1.0)

    def transform_directions(
        self, beams: CycleBeams, values: RigValues, directions: Float64
    ) -> Float64:
        """Return directions rotated from the laser's frame to that of the tilt cycle's place.

        Parameters
        ----------
        beams, values
            The beam of each direction, and the rig parameters.
        directions
            float64 (N, 3), in the laser's frame.

        Returns
        -------
        float64 (N, 3)
        """
        return self._map(beams, values, directions, 0.0)

    def _map(
        self, beams: CycleBeams, values: RigValues, vectors: Float64, is_point: float
    ) -> Float64:
        result, T_mount = np.empty_like(vectors), self.mount(values)
        for cycle, rows in _slices(beams.cycle):
            T_base_laser = self._laser_poses(cycle, beams.stamps_ns[rows], values, T_mount)
            T = beams.T_place_base[rows] @ T_base_laser
            turned = np.einsum("nij,nj->ni", T[:, :3, :3], vectors[rows])
            result[rows] = turned + is_point * T[:, :3, 3]
        return result

    def measured(self, beams: CycleBeams, values: RigValues) -> Float64:
        """Return the measured tilt angles float64 (N,), rad, without scale and offset."""
        angles = np.empty(len(beams.cycle))
        for cycle, rows in _slices(beams.cycle):
            data = self._cycles[cycle]
            part = data.chain.parts[data.tilt][0]
            stamps = self._shifted(data, beams.stamps_ns[rows], values)
            if isinstance(part, JointReading):
                angles[rows] = part.at(stamps)
            elif part.axis is not None:
                angles[rows] = twist_angle(part.track.at(stamps), part.axis)
        return angles

    def jacobian(self, beams: CycleBeams, values: RigValues, points: Float64) -> Float64:
        """Return the derivatives float64 (N, 3, 6) of the hits by `RIG_PARAMETERS`.

        Parameters
        ----------
        beams, values
            As in `transform_points`.
        placed
            float64 (N, 3), m, result of `transform_points` for them.
        """

        def by(name: str) -> Float64:
            turned = replace(values, **{name: getattr(values, name) + ANGLE_STEP})
            return (self.transform_points(beams, turned) - points) / ANGLE_STEP

        by_angle = by("tilt_offset")
        late, early = (
            self.transform_points(beams, values.delayed(step)) for step in (TIME_STEP, -TIME_STEP)
        )
        by_roll = np.cross(self.roll_axis, points - self.pivot)
        by_height = np.broadcast_to(np.array([0.0, 0.0, 1.0]), points.shape)
        columns = [
            by_angle,
            self.measured(beams, values)[:, None] * by_angle,
            by_roll,
            by_height,
            (late - early) / (2.0 * TIME_STEP),
            by("pan_offset") if self.pans else np.zeros_like(points),
        ]
        return np.stack(columns, axis=-1)


def _at_zero(part: Part) -> Part:
    return replace(part, scale=0.0, offset=0.0) if isinstance(part, JointReading) else part


def _corrected(part: Part, values: RigValues) -> Part:
    """Return the tilt joint with corrected scale and offset."""
    if isinstance(part, JointReading):
        scale = values.tilt_scale
        offset = scale * part.offset + values.tilt_offset
        return replace(part, scale=scale * part.scale, offset=offset)
    return replace(part, scale=values.tilt_scale, offset=values.tilt_offset)


def _slices(cycle: Int64) -> list[tuple[int, slice]]:
    """Return the rows of each tilt cycle."""
    numbers, firsts = np.unique(cycle, return_index=True)
    ends = [*firsts[1:].tolist(), len(cycle)]
    return [(n, slice(a, b)) for n, a, b in zip(numbers.tolist(), firsts.tolist(), ends)]
