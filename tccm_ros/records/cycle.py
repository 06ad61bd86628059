"""Results of a tilt cycle: the surface message, tracked planes and objects."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float32, Float64


class SensorKind(IntEnum):
    """The kind of sensor that measured points; each kind has its own range noise."""

    LASER = 0
    DEPTH_IMAGE = 1
    POINT_CLOUD = 2


HITS_CUBE = 0.04
"""Edge of the cubes in which hits are combined, m. Chosen: two cells of the map."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceCloud:
    """The surface message of one tilt cycle: the points of its horizontal surfaces.

    Attributes
    ----------
    stamp_ns
        Middle between the times of the tilt cycle's first and last used beam.
    frame_id
        Base frame; points are transformed to the base pose at the stamp.
    points
        float32 (N, 3), m.
    surface
        uint32 (N,), index of the surface within this cloud, from 0.
    viewpoint
        float32 (3,), position of the sensor at the stamp, m, in the same frame; None if unknown.
    sensor
        Kind of that sensor.
    """

    stamp_ns: int
    frame_id: str
    points: Float32
    surface: NDArray[np.uint32]
    viewpoint: Float32 | None = None
    sensor: SensorKind = SensorKind.LASER


@dataclass(frozen=True, slots=True, eq=False)
class ViewIntervals:
    """The free intervals that one tilt cycle observed, per column of ``views.cell_size``.

    Attributes
    ----------
    stamp_ns, frame_id
        As in the SurfaceCloud of the same cycle.
    intervals
        float32 (N, 4): x y of the column's centre, z_low, z_high; m. A column may have several.
    hits
        float32 (M, 4), beam hits near horizontal surfaces, one row per cube of edge `HITS_CUBE`:
        mean x and y of its points, and their minimum and maximum z; m.
    """

    stamp_ns: int
    frame_id: str
    intervals: Float32
    hits: Float32 = field(default_factory=lambda: np.zeros((0, 4), np.float32))


@dataclass(frozen=True, slots=True, eq=False)
class ObjectBoxes:
    """The objects on the surfaces of one tilt cycle, as prisms with vertical sides.

    Attributes
    ----------
    stamp_ns, frame_id
        As in the SurfaceCloud of the same cycle; prisms are in the base frame at the stamp.
    footprints
        float64 (H, 2) of each, open rings, convex, counter-clockwise, m.
    z
        float64 (N, 2), lower and upper end of each, m.
    points
        uint32 (N,), points measured on it.
    """

    stamp_ns: int
    frame_id: str
    footprints: tuple[Float64, ...]
    z: Float64
    points: NDArray[np.uint32]


class PlaneKind(StrEnum):
    """Constraint on a plane's inclination."""

    HORIZONTAL = "horizontal"
    ANY = "any"


@dataclass(frozen=True, slots=True, eq=False)
class PlaneRecord:
    """A tracked plane of one tilt cycle, in the frame of the map it was found in.

    Attributes
    ----------
    id
        Identity over tilt cycles.
    kind
        `PlaneKind`, or its string value where the record was read from a file.
    normal, offset
        Unit normal float64 (3,), ``normal . p = offset``; horizontal normals point up, others
        towards the sensor.
    covariance
        float64 (3, 3) of (rotation about u, rotation about v, offset at the centroid) in rad and
        m, with u, v as in `PlaneFit.tangents`: u horizontal, v up the slope.
    support
        Number of inlier points.
    area
        Area inside the boundary minus the holes, m2.
    quality
        val of Eq. (8), m2.
    boundary
        float64 (N, 3), open ring, counter-clockwise seen against the normal.
    holes
        Rings as `boundary`, clockwise.
    rms
        Root mean square distance of the points to the plane, m.
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
    """An object that stands on a surface.

    Attributes
    ----------
    id
        Identity over tilt cycles.
    plane
        PlaneRecord.id of the surface that it stands on.
    center
        float64 (3,), centre of the box, in the map's frame.
    size
        float64 (3,), edge lengths along the box's x, y, z.
    yaw
        Yaw of the box's x axis, rad, in (-pi/2, pi/2].
    footprint
        float64 (N, 2), open ring, convex.
    points
        Points measured on it.
    is_round
        Whether it is a vertical cylinder, as wide as its box.
    """

    id: int
    plane: int
    center: Float64
    size: Float64
    yaw: float
    footprint: Float64 = field(default_factory=lambda: np.zeros((0, 2)))
    points: int = 0
    is_round: bool = False
