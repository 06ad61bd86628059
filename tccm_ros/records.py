"""The typed records that processors take and give.

Stamps are integer nanoseconds; arrays have the dtype that the message has, so that a record made
from a bag, from a live message or by the pipeline is the same record. Records are immutable by
convention: whoever holds one may keep it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "JointSample",
    "Keyframe",
    "Loop",
    "Odometry",
    "PlaneRecord",
    "PosedScan",
    "RobotDescription",
    "Scan",
    "ScanPose",
    "Surface",
    "SurfaceCloud",
    "SurfaceSighting",
    "TabletopObject",
    "TransformSample",
    "ViewIntervals",
    "Wall",
    "seconds",
]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


def seconds(stamp_ns: int) -> float:
    """Return a stamp in s as float64 (about 0.2 us of resolution at today's epoch)."""
    return stamp_ns * 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One sweep of a laser (sensor_msgs/LaserScan).

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


@dataclass(frozen=True, slots=True, eq=False)
class PosedScan:
    """A scan with the poses of the base and of its laser while it was measured.

    Poses are given at `knots_ns` and interpolated between them; the first knot is at or before
    the first beam, the last at or after the last beam.

    Attributes
    ----------
    scan
        The scan.
    knots_ns
        int64 (K,), strictly increasing, K >= 2 (K = 1 where all beams have one time).
    T_odom_base
        float64 (K, 4, 4).
    T_base_laser
        float64 (K, 4, 4).
    """

    scan: Scan
    knots_ns: NDArray[np.int64]
    T_odom_base: Float64
    T_base_laser: Float64


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceCloud:
    """The hand-over of one tilt cycle: points of its horizontal surfaces (DESIGN section 4).

    Attributes
    ----------
    stamp_ns
        Middle of the sweep's first and last used beam.
    frame_id
        Base frame; the points are moved to where the base was at the stamp.
    points
        float32 (N, 3), m.
    surface
        uint32 (N,), index of the surface within this cloud, from 0.
    """

    stamp_ns: int
    frame_id: str
    points: Float32
    surface: NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class ViewIntervals:
    """The free intervals that one tilt cycle saw through, per column of ``views.cell_size``.

    Attributes
    ----------
    stamp_ns, frame_id
        As in the SurfaceCloud of the same cycle.
    intervals
        float32 (N, 4): x y of the column's centre, z_low, z_high; m. A column may have several.
    """

    stamp_ns: int
    frame_id: str
    intervals: Float32


@dataclass(frozen=True, slots=True, eq=False)
class PlaneRecord:
    """A tracked plane of one cycle, in the frame of the map it was found in.

    Attributes
    ----------
    id
        Identity over cycles.
    kind
        ``horizontal`` or ``any``.
    normal, offset
        Unit normal float64 (3,), ``normal . p = offset``; horizontal normals point up, others
        towards the sensor.
    covariance
        float64 (3, 3) of (rotation about u, rotation about v, offset at the centroid) in rad and
        m, with u, v the tangent directions of `geometry` of the detector.
    support
        Points.
    area
        m2, of the boundary less the holes.
    quality
        val of Eq. (8), m2.
    boundary
        float64 (N, 3), open ring, counter-clockwise seen against the normal.
    holes
        Rings as `boundary`, clockwise.
    rms
        Distance of the points to the plane, m.
    centroid
        float64 (3,), mean of the points.
    """

    id: int
    kind: str
    normal: Float64
    offset: float
    covariance: Float64
    support: int
    area: float
    quality: float
    boundary: Float64
    holes: tuple[Float64, ...]
    rms: float
    centroid: Float64


@dataclass(frozen=True, slots=True, eq=False)
class TabletopObject:
    """Something that stands on a surface.

    Attributes
    ----------
    id
        Identity over cycles.
    plane
        PlaneRecord.id of the surface that it stands on.
    center
        float64 (3,), of the box, in the map's frame.
    size
        float64 (3,), edge lengths along the box's x, y, z.
    yaw
        Of the box's x axis, rad, in (-pi/2, pi/2].
    footprint
        float64 (N, 2), open ring, convex.
    points
        Points measured on it.
    """

    id: int
    plane: int
    center: Float64
    size: Float64
    yaw: float
    footprint: Float64 = field(default_factory=lambda: np.zeros((0, 2)))
    points: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSighting:
    """One view that a surface was measured in.

    Attributes
    ----------
    stamp_ns
        Stamp of the view.
    keyframe
        Keyframe nearest in time; -1 where there is none.
    points
        Points measured on the surface.
    """

    stamp_ns: int
    keyframe: int
    points: int


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A horizontal surface of the surface map, in the map frame.

    Attributes
    ----------
    id
        Stays with the surface over merges and splits: the number of its oldest patch.
    label, confidence
        What it is (``other`` is an answer), and how sure that is, 0 to 1.
    height
        z at the centroid, m, in map.
    normal, offset
        Unit normal float64 (3,), up; ``normal . p = offset``.
    area
        m2, of the boundary less the holes.
    centroid
        float64 (3,), mean of the points.
    boundary
        float64 (N, 3), open ring, counter-clockwise seen from above.
    holes
        Rings as `boundary`, clockwise.
    points
        Points measured, before thinning.
    height_std
        Standard deviation of the points' distances from the plane, m.
    first_seen_ns, last_seen_ns
        Stamps of the first and the last view that measured it, replaced views included.
    views
        The views that are part of it, in stamp order.
    took
        Numbers of its other patches: ids of surfaces that went into this one, and that a part of it
        has when it parts from it.
    """

    id: int
    label: str
    confidence: float
    height: float
    normal: Float64
    offset: float
    area: float
    centroid: Float64
    boundary: Float64
    holes: tuple[Float64, ...]
    points: int
    height_std: float
    first_seen_ns: int
    last_seen_ns: int
    views: tuple[SurfaceSighting, ...]
    took: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class ScanPose:
    """Where the base was at the first beam of a level scan, as known when the scan arrived.

    Attributes
    ----------
    stamp_ns
        Stamp of the scan.
    pose
        float64 (3,), (x, y, yaw) of base in map, m and rad.
    keyframe
        Id of the keyframe that the scan became, or -1.
    """

    stamp_ns: int
    pose: Float64
    keyframe: int = -1


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A pose of the graph: pose float64 (3,), (x, y, yaw) of base in map."""

    id: int
    stamp_ns: int
    pose: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A proposed loop closure.

    Attributes
    ----------
    from_id, to_id
        Keyframes, ``from_id < to_id``.
    delta
        float64 (3,), planar pose of `to_id` in `from_id` as matched.
    accepted
        Whether it is a factor of the graph.
    reason
        Why it was accepted or rejected.
    """

    from_id: int
    to_id: int
    delta: Float64
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A wall: an infinite line ``x cos phi + y sin phi = rho`` in map with an observed extent.

    Attributes
    ----------
    id
        Index within the solution.
    phi
        Direction of the normal, rad, in (-pi, pi]; the origin of map lies on its negative side.
    rho
        Distance from the origin, m, >= 0.
    endpoints
        float64 (2, 2), ends of the observed extent, in the order of the tangent
        (-sin phi, cos phi).
    observations
        Line measurements that support it.
    covariance
        float64 (2, 2) of (phi, rho), rad and m.
    corners
        Ids of walls that share an endpoint, ascending.
    """

    id: int
    phi: float
    rho: float
    endpoints: Float64
    observations: int
    covariance: Float64
    corners: tuple[int, ...] = ()
