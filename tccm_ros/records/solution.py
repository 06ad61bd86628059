"""Poses, loop closures, walls, landmarks, surfaces and rooms, all in the map frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from tccm_ros.arrays import Covariance2, Covariance3, Ends, Float64, KnownNumber, Ring2, Vector


@dataclass(frozen=True, slots=True, eq=False)
class ScanPose:
    """The live estimate of the base pose at the first beam of a level scan.

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
    """A pose of the graph, at the stamp of a level scan.

    Attributes
    ----------
    id
        Index in the graph.
    stamp_ns
        Stamp of its level scan.
    pose
        float64 (3,), (x, y, yaw) of base in map, m and rad.
    """

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
        Whether the loop closure is a factor of the graph.
    reason
        Reason of the acceptance or rejection.
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
        Number of line measurements.
    covariance
        float64 (2, 2) of (phi, rho), rad and m.
    corners
        Ids of walls with a common endpoint, ascending.
    is_seen_from_origin
        Whether the observed side is that of the origin; the two sides of a wall are two records.
    """

    id: int
    phi: float
    rho: float
    endpoints: Ends
    observations: int
    covariance: Covariance2
    corners: tuple[int, ...] = ()
    is_seen_from_origin: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class PoseGuess:
    """A user-supplied pose of the robot, around which relocalisation searches.

    Attributes
    ----------
    stamp_ns
        Stamp of the pose.
    pose
        float64 (3,), planar pose of the base in map, m and rad.
    cov
        float64 (3, 3) of (x, y, yaw) in map.
    """

    stamp_ns: int
    pose: Float64
    cov: Float64


@dataclass(frozen=True, slots=True)
class LabelCorrection:
    """A user-supplied label of a surface.

    Attributes
    ----------
    surfaces
        Id of the surface, and the ids merged into it, whose earlier corrections are deleted.
    label
        The label; empty to return to the automatic label.
    """

    surfaces: tuple[int, ...]
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkObservation:
    """A measurement of a landmark by a sensor that identified it.

    Attributes
    ----------
    stamp_ns
        Stamp of the measurement.
    kind, id
        Landmark identity: a registered kind, and a number within it, >= 0, the same in all
        sessions.
    measurement, covariance
        float64 (N,) and (N, N), in the base frame at the stamp; the kind defines the components.
    """

    stamp_ns: int
    kind: str
    id: int
    measurement: Float64
    covariance: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Landmark:
    """A landmark of a registered kind.

    Attributes
    ----------
    kind, id
        Identity, as observed.
    position
        float64 (3,), in map, m.
    covariance
        float64 (3, 3) of the position, m2.
    observations
        Number of observations, in all sessions.
    """

    kind: str
    id: int
    position: Vector
    covariance: Covariance3
    observations: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSighting:
    """One view that measured a surface.

    Attributes
    ----------
    stamp_ns
        Stamp of the view.
    keyframe
        Keyframe nearest in time; -1 if there is none.
    points
        Number of points measured on the surface.
    """

    stamp_ns: int
    keyframe: int
    points: int


class SurfaceShape(StrEnum):
    """The outline models; a free outline has no model."""

    RECTANGLE = "rectangle"
    L = "L"
    CIRCLE = "circle"
    ELLIPSE = "ellipse"
    POLYGON = "polygon"
    FREE = "free"


class EdgeState(StrEnum):
    """Observation state of an edge of a surface."""

    SEEN = "seen"
    """A view observed the end of the surface: there is free space or a wall beyond the edge."""
    HIDDEN = "hidden"
    """An occlusion left open whether the surface continues."""
    CUT = "cut"
    """No view observed the edge: it is the border of the views."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceEdge:
    """One edge of a surface's boundary.

    Attributes
    ----------
    start, end
        float64 (3,), in map, m; the surface is to the left of the direction from start to end.
    state
        `EdgeState` of the edge.
    sigma
        Standard deviation of the edge's position perpendicular to it, m; NaN where it was not seen.
    hidden_by
        Id of the occluding surface; None if another object occludes, or nothing does.
    """

    start: Vector
    end: Vector
    state: EdgeState
    sigma: KnownNumber
    hidden_by: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PreviousPose:
    """The place of a surface before it was moved.

    Attributes
    ----------
    boundary, normal, offset
        As in `Surface`; the boundary is the observed one, without a model.
    last_seen_ns
        Stamp of the last view that measured the surface at this place.
    """

    boundary: Float64
    normal: Float64
    offset: float
    last_seen_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A horizontal surface of the surface map, in the map frame.

    Attributes
    ----------
    id
        Persistent over merges and splits: the number of its oldest patch.
    label, confidence
        Class of the surface (``other`` is a class), and the confidence in it, 0 to 1.
    height
        z at the centroid, m, in map.
    normal, offset
        Unit normal float64 (3,), up; ``normal . p = offset``.
    area
        Area inside the boundary minus the holes, m2.
    centroid
        float64 (3,), mean of the points.
    boundary
        float64 (N, 3), open ring, counter-clockwise seen from above; the outline of the model
        `shape`.
    holes
        Rings as `boundary`, clockwise.
    points
        Number of measured points, before thinning.
    height_std
        Standard deviation of the points' distances from the plane, m.
    first_seen_ns, last_seen_ns
        Stamps of the first and the last view that measured it, including replaced views.
    views
        The views that contribute to it, in the order of sessions and stamps.
    merged_ids
        Numbers of its other patches: ids of the surfaces that were merged into this one. If the
        surface splits, a part takes its id from them.
    shape
        The simplest outline model that the observations support.
    edges
        Edges of the boundary, in order, one from each corner to the next.
    area_seen, boundary_seen
        Observed area, m2, and observed boundary, a ring as `boundary`, without a model. The holes
        belong to both.
    room
        Name of the room that contains it; empty where unknown.
    near
        Texts of nearby door signs, the nearest first.
    placed_ns
        Stamp of the first view that measured it at its present place.
    previous_pose
        Its place before it was moved; None if unknown.
    cov_plane
        float64 (3, 3), covariance of the plane: z at the centroid (m), and the slopes dz/dx and
        dz/dy in map; NaN where unknown.
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
    merged_ids: tuple[int, ...] = ()
    shape: SurfaceShape = SurfaceShape.FREE
    edges: tuple[SurfaceEdge, ...] = ()
    area_seen: float = 0.0
    boundary_seen: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    room: str = ""
    near: tuple[str, ...] = ()
    placed_ns: int = 0
    previous_pose: PreviousPose | None = None
    cov_plane: Float64 = field(default_factory=lambda: np.full((3, 3), np.nan))

    def height_at(self, at_xy: Float64) -> Float64:
        """Return the heights of its plane at positions float64 (..., 2), m, float64 (...)."""
        return np.asarray((self.offset - at_xy @ self.normal[:2]) / self.normal[2])


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A room: an area that walls enclose when doors are closed.

    Attributes
    ----------
    id
        Number, in the order of decreasing area.
    name
        Number on the door sign; empty where none was read.
    boundary
        float64 (N, 2), open ring in map, counter-clockwise, m.
    area
        Area, m2.
    signs
        Ids of the door signs that name it, ascending.
    """

    id: int
    name: str
    boundary: Ring2
    area: float
    signs: tuple[int, ...] = ()
