"""Events that the intake gives to the processors: posed records and motion of the robot.

`robot.Robot` checks each incoming record once and returns a list of events in a deterministic
order. `Odometry` events carry the motion of the base.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from tccm_ros.arrays import Float64, Int64
from tccm_ros.records.cycle import SensorKind
from tccm_ros.records.sensors import Odometry, PoseCovariance, Scan

START_OF_TIME = -(2**62)
"""Earlier than every stamp, ns."""


@dataclass(frozen=True, slots=True, eq=False)
class SelfShapes:
    """The robot's own collision shapes at one time.

    Attributes
    ----------
    kinds
        int64 (S,), index into `robot.self_shapes.SHAPE_KINDS`.
    half
        float64 (S, 3), half extents, m; sphere (r, r, r), cylinder along z (r, r, length / 2).
    T_base_shape
        float64 (S, 4, 4).
    """

    kinds: Int64
    half: Float64
    T_base_shape: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A sensor's record with the poses of base and sensor while it was measured.

    Poses are given at pose samples and interpolated between them; the first is at or before the
    first measurement of the record, the last at or after the last.

    Attributes
    ----------
    record
        The sensor's record.
    pose_stamps_ns
        Stamps of the pose samples, int64 (K,), strictly increasing, K >= 2 (K = 1 where the whole
        record has one time).
    T_odom_base
        float64 (K, 4, 4).
    T_base_sensor
        float64 (K, 4, 4).
    role
        Name of the stream.
    odom_frame, base_frame
        Names of the two frames.
    own_shapes
        The robot's shapes at the record's stamp, where the stream needs them and they are known.
    has_odometry
        Whether odometry or tf gives the motion of the base; otherwise `T_odom_base` is the
        identity.
    heading
        Of a level scan, the integrated gyroscope yaw of the base at its stamp, rad. The zero is
        arbitrary: only differences between scans are meaningful. None without a gyroscope.
    sensor_kind
        Class attribute; selects the noise model (`sensors.noise`).
    """

    sensor_kind: ClassVar[SensorKind] = SensorKind.LASER

    record: Any
    pose_stamps_ns: Int64
    T_odom_base: Float64
    T_base_sensor: Float64
    role: str = ""
    odom_frame: str = "odom"
    base_frame: str = "base_link"
    own_shapes: SelfShapes | None = None
    has_odometry: bool = True
    heading: float | None = None

    @property
    def stamp_ns(self) -> int:
        """Stamp of the record."""
        return int(self.record.stamp_ns)


class PosedScan(Posed):
    """A laser's scan with its poses."""

    __slots__ = ()

    @property
    def scan(self) -> Scan:
        """The scan."""
        scan: Scan = self.record
        return scan

    @property
    def T_base_laser(self) -> Float64:
        """The poses of the laser, float64 (K, 4, 4)."""
        return self.T_base_sensor


class TiltAngle(NamedTuple):
    """The corrected angle of a sensor's tilt joint at a stamp.

    The angles of one stream come in stamp order, one per stamp. They are unwrapped.

    Attributes
    ----------
    role
        The stream of the sensor.
    stamp_ns
        Stamp of the joint sample or transform.
    angle
        rad, corrected by `rig.tilt_scale` and `rig.tilt_offset`.
    """

    role: str
    stamp_ns: int
    angle: float


class RollPitch(NamedTuple):
    """Roll and pitch of the base measured by its IMU, including the bias of the accelerometer.

    Roll is positive where the left side is up, pitch where the front is down (REP-103).

    Attributes
    ----------
    stamp_ns
        A multiple of 0.1 s.
    measured
        Roll and pitch, rad.
    sigma
        Standard deviation of each of the two relative to `usual`, rad.
    usual
        Median roll and pitch of the moving base so far, rad; None if unknown.
    """

    stamp_ns: int
    measured: tuple[float, float]
    sigma: float
    usual: tuple[float, float] | None


class MapOdom(NamedTuple):
    """The pose of the odometry frame in the map, from an external localisation.

    Attributes
    ----------
    stamp_ns
        Stamp from which on the pose holds.
    T_map_odom
        float64 (4, 4); the odometry frame is that of the `Odometry` events.
    """

    stamp_ns: int
    T_map_odom: Float64


class StreamComplete(NamedTuple):
    """Announces that no record of a sensor older than `until_ns` will follow.

    Attributes
    ----------
    role
        The stream of the sensor.
    until_ns
        All records with older stamps have been given or dropped.
    """

    role: str
    until_ns: int


class MapReset(NamedTuple):
    """Poses and the map start again: the clock went back, or odometry arrived late.

    Attributes
    ----------
    reason
        Reason, as a clause.
    """

    reason: str


Event = (
    Posed | TiltAngle | StreamComplete | Odometry | RollPitch | MapOdom | PoseCovariance | MapReset
)
"""Events of `robot.Robot`. The first three have the role of a stream; base motion, roll and pitch,
and map resets go to all processors."""
