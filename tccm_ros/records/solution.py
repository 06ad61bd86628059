"""Poses, loops, walls, landmarks and surfaces of the map, all in its frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from tccm_ros.arrays import Float64


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
    """A pose of the graph, at the stamp of a level scan.

    Attributes
    ----------
    id
        Its number in the graph.
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
    is_seen_from_origin
        Whether it was seen from the side of the origin; each side of a wall is one of its own.
    """

    id: int
    phi: float
    rho: float
    endpoints: Float64
    observations: int
    covariance: Float64
    corners: tuple[int, ...] = ()
    is_seen_from_origin: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class PoseGuess:
    """Where somebody says that the robot is; its place in the map is looked for around it.

    Attributes
    ----------
    stamp_ns
        When.
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
    """What a person says that a surface is.

    Attributes
    ----------
    surfaces
        Id of the surface, and those that were merged into it: what was said of them is forgotten.
    label
        Its label; empty: the rules decide again.
    """

    surfaces: tuple[int, ...]
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkObservation:
    """What a sensor measured of a landmark that it recognised.

    Attributes
    ----------
    stamp_ns
        When.
    kind, id
        Which landmark: a registered kind, and a number within it, >= 0, in all sessions.
    measurement, covariance
        float64 (N,) and (N, N), in the base frame at the stamp; the kind says of what.
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
        As observed.
    position
        float64 (3,), in map, m.
    covariance
        float64 (3, 3) of the position, m2.
    observations
        How often it was observed, in all sessions.
    """

    kind: str
    id: int
    position: Float64
    covariance: Float64
    observations: int


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


class SurfaceShape(StrEnum):
    """The models of outlines; a free outline has no model."""

    RECTANGLE = "rectangle"
    L = "L"
    CIRCLE = "circle"
    ELLIPSE = "ellipse"
    POLYGON = "polygon"
    FREE = "free"


class EdgeState(StrEnum):
    """What is known of an edge of a surface."""

    SEEN = "seen"
    """A view saw that the surface ends there: it looked through beyond, or a wall is there."""
    HIDDEN = "hidden"
    """Views looked that way, but something hid whether the surface goes on."""
    CUT = "cut"
    """No view looked there: the views end."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceEdge:
    """One edge of a surface's boundary.

    Attributes
    ----------
    start, end
        float64 (3,), in map, m; the surface is to the left of the way from start to end.
    state
        Whether it was seen, hidden, or cut by the views.
    sigma
        Standard deviation of its position across, m; NaN where it was not seen.
    hidden_by
        Id of the surface that hides it; None where that is no surface, or it is not hidden.
    """

    start: Float64
    end: Float64
    state: EdgeState
    sigma: float
    hidden_by: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PreviousPose:
    """Where a surface was before it was carried elsewhere.

    Attributes
    ----------
    boundary, normal, offset
        As of `Surface`; the boundary is what was seen.
    last_seen_ns
        Stamp of the last view that measured it there.
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
        float64 (N, 3), open ring, counter-clockwise seen from above: that of the model `shape`.
    holes
        Rings as `boundary`, clockwise.
    points
        Points measured, before thinning.
    height_std
        Standard deviation of the points' distances from the plane, m.
    first_seen_ns, last_seen_ns
        Stamps of the first and the last view that measured it, replaced views included.
    views
        The views that are part of it, in the order of sessions and stamps.
    merged_ids
        Numbers of its other patches: ids of surfaces that went into this one, and that a part of it
        has when it parts from it.
    shape
        The simplest model that the evidence supports.
    edges
        Of the boundary, in its order, one from each corner to the next.
    area_seen, boundary_seen
        What the views measured, without a model: m2, and a ring as `boundary`. The holes are those
        of both.
    room
        Name of the room that it stands in; empty where that is not known.
    near
        Texts of the door signs near it, the nearest first.
    placed_ns
        Stamp of the first view that measured it where it is now.
    previous_pose
        Where it was before it was carried here; None where that is not known.
    cov_plane
        float64 (3, 3), covariance of its plane: z at the centroid (m), and the slopes dz/dx and
        dz/dy in map; nan where it is not known.
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
