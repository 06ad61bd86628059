"""What sensors say, and what is known of the robot."""

from __future__ import annotations

from dataclasses import dataclass

from tccm_ros.arrays import Float32, Float64


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One scan of a laser (sensor_msgs/LaserScan).

    Attributes
    ----------
    stamp_ns
        Time of the first beam; beam i was measured at ``stamp + i * time_increment``.
    frame_id
        Frame of the laser: x at bearing 0, y at bearing +pi/2.
    angle_min, angle_increment
        Bearing of the first beam and step between beams, rad; the step may be negative.
    time_increment
        Time between beams, s.
    range_min, range_max
        Limits of valid ranges, m.
    ranges
        float32 (N,), m; REP-117: +inf nothing seen, -inf too close, nan invalid.
    """

    stamp_ns: int
    frame_id: str
    angle_min: float
    angle_increment: float
    time_increment: float
    range_min: float
    range_max: float
    ranges: Float32

    @property
    def end_ns(self) -> int:
        """Time of the last beam."""
        return self.stamp_ns + round(max(len(self.ranges) - 1, 0) * self.time_increment * 1e9)


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Joint positions at one time: names, and positions float64 (len(names),) in rad or m."""

    stamp_ns: int
    names: tuple[str, ...]
    positions: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """Pose of the base in the odometry frame: T_odom_base float64 (4, 4)."""

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    T_odom_base: Float64


@dataclass(frozen=True, slots=True, eq=False)
class TransformSample:
    """One transform of tf: T_parent_child float64 (4, 4)."""

    stamp_ns: int
    parent: str
    child: str
    T_parent_child: Float64
    is_static: bool


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """The robot's URDF."""

    urdf: str
