"""Models of the JSON files of a result folder: a class for each file.

An entry is the record itself, or a class of its own if the file has other keys than the record.
Writer, report, evaluation and comparison use these classes; `docs/reference/schema` is generated
from them. Field names are the keys of the files, in order; a trailing underscore (`from_`) is not
part of the key. Lengths are in m, angles in rad, stamps in s; numbers that are not finite are
written as null. Readers ignore unknown keys.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Literal, TypeVar

import numpy as np
import shapely
from pydantic import ConfigDict

from tccm_ros.arrays import (
    Covariance3,
    Ends3,
    Float64,
    Pixel,
    PlaneErrors,
    Ring,
    Ring2,
    Vector,
)
from tccm_ros.geometry import planar, spatial
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.racks.compartment import Compartment, FaceState, OpenPart
from tccm_ros.records import (
    Keyframe,
    Landmark,
    Loop,
    RefusedSign,
    Room,
    Sign,
    Surface,
    SurfaceEdge,
    SurfaceShape,
    Wall,
)
from tccm_ros.results.numbers import Stamp, key_of
from tccm_ros.results.surface_counts import SurfaceCounts
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.tabletop.placements import Placement, PlacementRequest

EntryType = TypeVar("EntryType")


def _entry(kind: type[EntryType], record: Any, **others: Any) -> EntryType:
    """Return the entry of a record: its attributes of the same names, except those in `others`."""
    names = (name for name in kind.__dataclass_fields__ if name not in others)  # type: ignore[attr-defined]
    return kind(**{name: getattr(record, name) for name in names}, **others)


# --- surfaces.json -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ViewEntry:
    """A view in which a surface was measured.

    Attributes
    ----------
    stamp
        Stamp of the view, s.
    keyframe
        Keyframe nearest in time; -1 if there is none.
    points
        Number of points measured on the surface.
    """

    stamp: float
    keyframe: int
    points: int


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceEntry:
    """A surface, in map, as `records.Surface`.

    Attributes
    ----------
    id, label, confidence
        As in `records.Surface`.
    height
        z at the centroid, m.
    normal, offset
        Unit normal float64 (3,), up; ``normal . p = offset``, m.
    area
        Area of the boundary without the holes, m2.
    centroid
        float64 (3,), mean of the points, m.
    boundary, holes
        float64 (N, 3), open rings, m; the boundary is counter-clockwise from above.
    points
        Number of points measured, before thinning.
    height_std
        Standard deviation of the points' distances from the plane, m.
    first_seen, last_seen
        Stamps of the first and the last view, s.
    views
        The views that measured it.
    took
        Merged ids: ids of the surfaces that were merged into this one.
    shape
        Shape model of the boundary.
    edges
        Edges of the boundary, in order, each from one corner to the next.
    area_seen, boundary_seen
        Measured extent, without a shape model: m2, and an open ring, m; with the same holes.
    room
        Name of its room; empty if unknown.
    near
        Texts of the door signs near it, the nearest first.
    plane_sigma, plane_correlation
        Standard deviations of z at the centroid (m), dz/dx and dz/dy of its plane, and their
        correlations: first and second, first and third, second and third.
    """

    id: int
    label: str
    confidence: float
    height: float
    normal: Vector
    offset: float
    area: float
    centroid: Vector
    boundary: Ring
    holes: tuple[Ring, ...]
    points: int
    height_std: float | None
    first_seen: float
    last_seen: float
    views: tuple[ViewEntry, ...]
    took: tuple[int, ...] = ()
    shape: SurfaceShape = SurfaceShape.FREE
    edges: tuple[SurfaceEdge, ...] = ()
    area_seen: float = 0.0
    boundary_seen: Ring = field(default_factory=lambda: np.zeros((0, 3)))
    room: str = ""
    near: tuple[str, ...] = ()
    plane_sigma: PlaneErrors = field(default_factory=lambda: np.full(3, np.nan))
    plane_correlation: PlaneErrors = field(default_factory=lambda: np.full(3, np.nan))

    @classmethod
    def of(cls, surface: Surface) -> SurfaceEntry:
        """Return the entry of a surface."""
        sigma = np.sqrt(np.diag(surface.cov_plane))
        return _entry(
            cls,
            surface,
            plane_sigma=sigma,
            plane_correlation=(surface.cov_plane / np.outer(sigma, sigma))[[0, 0, 1], [1, 2, 2]],
            first_seen=Stamp(surface.first_seen_ns),
            last_seen=Stamp(surface.last_seen_ns),
            took=surface.merged_ids,
            views=tuple(_entry(ViewEntry, v, stamp=Stamp(v.stamp_ns)) for v in surface.views),
        )

    @property
    def is_floor(self) -> bool:
        """Return whether this is the floor."""
        return self.label == "floor"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfacesFile:
    """surfaces.json: the surface map.

    Attributes
    ----------
    format, version
        Name and version of the file format.
    frame_id
        Frame of all coordinates.
    floor_z
        Height of the floor, m; None if it was never seen.
    surfaces
        Surfaces, by id.
    rooms
        Rooms, from the largest to the smallest.
    """

    format: Literal["tccm_ros/surfaces"] = "tccm_ros/surfaces"
    version: Literal[1] = 1
    frame_id: str = "map"
    floor_z: float | None = None
    surfaces: tuple[SurfaceEntry, ...]
    rooms: tuple[Room, ...] = ()

    @classmethod
    def of(
        cls,
        surfaces: Iterable[Surface],
        floor_z: float | None,
        frame_id: str,
        rooms: Iterable[Room] = (),
    ) -> SurfacesFile:
        """Return the model of surfaces.json.

        Parameters
        ----------
        surfaces
            In the frame `frame_id`.
        floor_z
            Height of the floor, m; None if it was never seen.
        frame_id
            Name of the map frame.
        rooms
            Rooms of the map.
        """
        entries = tuple(map(SurfaceEntry.of, surfaces))
        return cls(frame_id=frame_id, floor_z=floor_z, surfaces=entries, rooms=tuple(rooms))


# --- labels.json ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LabelEntry:
    """A user's label of a surface.

    Attributes
    ----------
    surface
        Id of the surface.
    label
        A label of surfaces.json except ``floor``.
    """

    surface: int
    label: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelsFile:
    """labels.json: the labels of surfaces that a user has corrected.

    The file beside a saved map may be edited; its labels replace those in the map.

    Attributes
    ----------
    format, version
        Name and version of the file format.
    labels
        Labels, by surface.
    """

    format: Literal["tccm_ros/labels"] = "tccm_ros/labels"
    version: Literal[1] = 1
    labels: tuple[LabelEntry, ...] = ()

    @classmethod
    def of(cls, corrected: Mapping[int, str]) -> LabelsFile:
        """Return the model of labels.json for labels by surface id."""
        return cls(labels=tuple(LabelEntry(k, str(v)) for k, v in sorted(corrected.items())))


# --- objects.json --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ObjectEntry:
    """A box on a surface, in map.

    Attributes
    ----------
    id
        Id of the object.
    surface
        Id of the surface under it.
    center
        float64 (3,), m.
    size
        float64 (3,), edge lengths along its own x, y and z axes, m.
    yaw
        Yaw of its x axis, in (-pi/2, pi/2], rad.
    label
        Class assigned by detectors; empty if there is none.
    confidence
        Mean score of that class, 0 to 1; null if there is none.
    is_round
        Whether it is a vertical cylinder, as wide as its box.
    """

    id: int
    surface: int
    center: Vector
    size: Vector
    yaw: float
    label: str = ""
    confidence: float | None = None
    is_round: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FreePlacesEntry:
    """Free places on a surface, in map.

    Attributes
    ----------
    surface
        Id of the surface.
    polygons
        Open rings float64 (N, 3), m.
    """

    surface: int
    polygons: tuple[Ring, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PlacementsEntry:
    """Placements of one object on all surfaces except the floor.

    Attributes
    ----------
    size
        float64 (3,), length, width and height of the object, m.
    clearance
        Free distance around and above the object, m.
    ranked
        Placements by clearance, the largest first; all of them can be used at the same time.
    """

    size: Vector
    clearance: float
    ranked: tuple[Placement, ...]

    @classmethod
    def of(cls, request: PlacementRequest, found: Iterable[Placement]) -> PlacementsEntry:
        """Return the entry of a request and its placements."""
        size = np.array([request.size_x, request.size_y, request.height])
        return cls(size, request.clearance, tuple(found))


@dataclass(frozen=True, slots=True, eq=False)
class ObjectsFile:
    """objects.json: objects on surfaces, free places, and placements.

    Attributes
    ----------
    objects
        Objects, by surface and id.
    free
        Free places, by surface.
    placements
        Placements of an object of `objects.place_size`; None in files of older versions.
    """

    objects: tuple[ObjectEntry, ...] = ()
    free: tuple[FreePlacesEntry, ...] = ()
    placements: PlacementsEntry | None = None

    @classmethod
    def of(
        cls,
        objects: Iterable[SceneObject],
        free: Mapping[int, Sequence[Float64]],
        placements: PlacementsEntry | None = None,
    ) -> ObjectsFile:
        """Return the model of objects.json.

        Parameters
        ----------
        objects
            Objects, by surface and id.
        free
            Rings by surface (`free_places`).
        placements
            Entry of the placements; None without them.
        """
        return cls(
            tuple(map(_object_entry, objects)),
            tuple(FreePlacesEntry(s, tuple(rings)) for s, rings in sorted(free.items())),
            placements,
        )


def _object_entry(item: SceneObject) -> ObjectEntry:
    score = None if item.label is None else item.label.score
    box = item.id, item.surface, item.center, item.size, item.yaw
    return ObjectEntry(*box, item.class_id, score, item.is_round)


# --- racks.json ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class OpenPartEntry:
    """A part that stands open before a compartment, as a door or a drawer, in map.

    Attributes
    ----------
    center
        float64 (3,), middle of its box, m.
    size
        float64 (3,), edges along its own x, y and z, m.
    yaw
        Yaw of its x axis, rad.
    """

    center: Vector
    size: Vector
    yaw: float

    @classmethod
    def of(cls, part: OpenPart) -> OpenPartEntry:
        """Return the entry of a part."""
        yaw = float(planar(part.T_map_part)[2])
        return cls(part.T_map_part[:3, 3], part.size, yaw)

    @property
    def part(self) -> OpenPart:
        """The part."""
        x, y, z = self.center
        return OpenPart(spatial(np.array([x, y, self.yaw]), z), self.size)


@dataclass(frozen=True, slots=True, eq=False)
class CompartmentEntry:
    """The space over a board or a part of it, accessible from its front, in map.

    Attributes
    ----------
    rack
        Id of the lowest board of its rack.
    board
        Id of the surface below it.
    above
        Id of the surface above it; null if its ceiling belongs to no surface of the map.
    front
        float64 (2, 3), left and right end of its front edge, on the board, m, from outside.
    insertion
        float64 (3,), unit vector from the front inwards.
    width, depth, height
        Clear lengths, m. A face that was not measured is assumed at the edge of the board, and an
        unmeasured lower side of a board 4 cm below its top.
    left, right, back, ceiling
        ``measured``: beams ended on it; ``open``: beams passed through it; ``unknown``: there were
        too few beams.
    front_seen
        Fraction of the front through which beams passed, 0 to 1.
    open_parts
        Boxes around doors and drawers that stand open before the front, from left to right.
    """

    rack: int
    board: int
    above: int | None
    front: Ends3
    insertion: Vector
    width: float
    depth: float
    height: float
    left: FaceState
    right: FaceState
    back: FaceState
    ceiling: FaceState
    front_seen: float
    open_parts: tuple[OpenPartEntry, ...] = ()

    @classmethod
    def of(cls, compartment: Compartment) -> CompartmentEntry:
        """Return the entry of a compartment."""
        parts = tuple(map(OpenPartEntry.of, compartment.open_parts))
        return _entry(cls, compartment, insertion=compartment.T_map_front[:3, 0], open_parts=parts)


@dataclass(frozen=True, slots=True, eq=False)
class RacksFile:
    """racks.json: compartments of racks.

    Attributes
    ----------
    compartments
        Compartments, by rack and height.
    """

    compartments: tuple[CompartmentEntry, ...] = ()


# --- walls.json ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class WallsFile:
    """walls.json: the walls of the graph.

    Attributes
    ----------
    walls
        Walls, by id.
    """

    walls: tuple[Wall, ...]


# --- signs.json ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class SignViewEntry:
    """A picture in which a sign was read.

    Attributes
    ----------
    stamp
        Stamp of the picture, s.
    keyframe
        Keyframe to which the picture is attached.
    pixel
        float64 (2,), centre of the number, from the left and the top of the picture.
    """

    stamp: float
    keyframe: int
    pixel: Pixel


@dataclass(frozen=True, slots=True, eq=False)
class SignEntry:
    """A door sign, in map, as `records.Sign`.

    Attributes
    ----------
    id
        Id, stable over solutions and sessions.
    text, number
        Text on the plate, and the room number in it.
    confidence
        Confidence in the number, 0 to 1.
    position
        float64 (3,), centre of the number, m.
    normal
        float64 (3,), unit normal of the wall towards the reader of the sign.
    covariance
        float64 (3, 3) of the position, m2.
    wall
        Id of its wall in walls.json; null if unknown.
    views
        Pictures, in order of sessions and stamps.
    """

    id: int
    text: str
    number: str
    confidence: float
    position: Vector
    normal: Vector
    covariance: Covariance3
    wall: int | None
    views: tuple[SignViewEntry, ...]

    @classmethod
    def of(cls, sign: Sign) -> SignEntry:
        """Return the entry of a sign."""
        views = (_entry(SignViewEntry, view, stamp=Stamp(view.stamp_ns)) for view in sign.views)
        return _entry(cls, sign, views=tuple(views))


@dataclass(frozen=True, slots=True, eq=False)
class SignsFile:
    """signs.json: the door signs of the map.

    Attributes
    ----------
    signs
        Signs, by id.
    refused
        Texts read at one position that are not signs.
    """

    signs: tuple[SignEntry, ...] = ()
    refused: tuple[RefusedSign, ...] = ()

    @classmethod
    def of(cls, signs: Iterable[Sign], refused: Iterable[RefusedSign] = ()) -> SignsFile:
        """Return the model of signs.json."""
        return cls(tuple(map(SignEntry.of, signs)), tuple(refused))


# --- graph.json ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeEntry:
    """A keyframe of the graph.

    Attributes
    ----------
    id
        Id of the keyframe.
    stamp
        Stamp of its scan, s.
    pose
        float64 (3,), (x, y, yaw) of base in map, m and rad.
    """

    id: int
    stamp: float
    pose: Vector


@dataclass(frozen=True, slots=True, eq=False)
class LoopEntry:
    """A proposed loop closure.

    Attributes
    ----------
    from_, to
        Ids of the keyframes, ``from_ < to``.
    delta
        float64 (3,), planar pose (x, y, yaw) of keyframe `to` in `from_`, m and rad.
    accepted
        Whether it is a factor of the graph.
    reason
        Reason why it was accepted or rejected.
    """

    __pydantic_config__ = ConfigDict(alias_generator=key_of)

    from_: int
    to: int
    delta: Vector
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class GraphFile:
    """graph.json: the graph without its walls.

    Attributes
    ----------
    keyframes
        Keyframes, by id.
    loops
        Proposed loop closures.
    landmarks
        Landmarks other than walls.
    """

    keyframes: tuple[KeyframeEntry, ...] = ()
    loops: tuple[LoopEntry, ...] = ()
    landmarks: tuple[Landmark, ...] = ()

    @classmethod
    def of(
        cls, keyframes: Iterable[Keyframe], loops: Iterable[Loop], landmarks: Iterable[Landmark]
    ) -> GraphFile:
        """Return the model of graph.json.

        Parameters
        ----------
        keyframes, loops, landmarks
            Contents of a solution, in map.
        """
        return cls(
            tuple(_entry(KeyframeEntry, k, stamp=Stamp(k.stamp_ns)) for k in keyframes),
            tuple(LoopEntry(p.from_id, p.to_id, p.delta, p.accepted, p.reason) for p in loops),
            tuple(landmarks),
        )


# --- planes.json ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class PlaneEntry:
    """A tracked plane of a tilt cycle, in the odometry frame, as `records.PlaneRecord`.

    Attributes
    ----------
    id
        Track id.
    kind
        ``horizontal`` or another class of planes.
    normal, offset
        Unit normal float64 (3,); ``normal . p = offset``, m.
    covariance
        float64 (3, 3) of two rotations and the offset, rad and m, as in `records.PlaneRecord`.
    support
        Number of points.
    area
        Area, m2.
    quality
        val of Eq. (8), m2.
    boundary, holes
        float64 (N, 3), open rings, m.
    rms
        Root mean square distance of the points from the plane, m.
    """

    id: int
    kind: str
    normal: Vector
    offset: float
    covariance: Covariance3
    support: int
    area: float
    quality: float
    boundary: Ring
    holes: tuple[Ring, ...]
    rms: float


@dataclass(frozen=True, slots=True, eq=False)
class CycleEntry:
    """The tracked planes of one tilt cycle.

    Attributes
    ----------
    cycle
        Number of the tilt cycle.
    stamp
        Stamp of the tilt cycle, s.
    frame_id
        The odometry frame.
    planes
        Planes in that frame.
    """

    cycle: int
    stamp: float
    frame_id: str
    planes: tuple[PlaneEntry, ...]

    @classmethod
    def of(cls, cycle: CycleResult) -> CycleEntry:
        """Return the entry of a tilt cycle."""
        planes = tuple(_entry(PlaneEntry, plane) for plane in cycle.planes)
        return _entry(cls, cycle, stamp=Stamp(cycle.stamp_ns), planes=planes)


@dataclass(frozen=True, slots=True, eq=False)
class PlanesFile:
    """planes.json: the tracked planes of every tilt cycle.

    Attributes
    ----------
    cycles
        Tilt cycles, in order of time.
    """

    cycles: tuple[CycleEntry, ...] = ()


# --- summary.json and timing.json ----------------------------------------------------------------


class SessionKind(StrEnum):
    """Relation of a recording to a saved map."""

    FIRST = "first"
    """The recording starts a map."""
    NEW = "new"
    """The recording continues a saved map in which the robot was localised."""


@dataclass(frozen=True, slots=True)
class SessionEntry:
    """Relation of the recording to a saved map.

    Attributes
    ----------
    kind
        First session of a map, or a new one.
    """

    kind: SessionKind


@dataclass(frozen=True, slots=True)
class ScansUsedEntry:
    """Numbers of scans used, by laser.

    Attributes
    ----------
    tilt
        Counts of the tilting laser.
    level
        Counts of the level laser.
    """

    tilt: int
    level: int


@dataclass(frozen=True, slots=True)
class CountsEntry:
    """Counts of messages, dropped scans and results.

    Attributes
    ----------
    messages
        Numbers of messages read, by topic.
    scans_used
        Numbers of scans used, by laser.
    dropped
        Numbers of records that were not used, by reason.
    cycles, planes
        Numbers of tilt cycles, and of planes with a track id of their own.
    keyframes, walls
        Numbers in the graph.
    loops_accepted, loops_rejected
        Numbers of proposed loop closures.
    surfaces, small_surfaces
        Numbers of surfaces as counted by `count_surfaces`.
    objects
        Number of objects on surfaces.
    failed_stages
        Optional stages after the map that failed, by name and error.
    unjoined_trajectories
        Number of trajectories whose poses in the map are unknown.
    """

    messages: dict[str, int]
    scans_used: ScansUsedEntry
    dropped: dict[str, int]
    cycles: int
    planes: int
    keyframes: int
    walls: int
    loops_accepted: int
    loops_rejected: int
    surfaces: int
    small_surfaces: int
    objects: int
    failed_stages: dict[str, int] = field(default_factory=dict)
    unjoined_trajectories: int = 0

    @property
    def surface_counts(self) -> SurfaceCounts:
        """Numbers of surfaces above the floor."""
        return SurfaceCounts(self.surfaces, self.small_surfaces)


@dataclass(frozen=True, slots=True)
class SummaryFile:
    """summary.json: counts and configuration of a replay.

    Attributes
    ----------
    versions
        Versions of tccm_ros, Python and the libraries, by name.
    bag_duration
        Duration of the bag, s.
    session
        Whether the recording continued a saved map.
    counts
        Numbers of messages, dropped scans and results.
    config
        Every parameter, by group.
    """

    versions: dict[str, str]
    bag_duration: float
    session: SessionEntry
    counts: CountsEntry
    config: dict[str, Any]


@dataclass(frozen=True, slots=True)
class TimingFile:
    """timing.json: the processing time of a replay.

    Attributes
    ----------
    seconds
        Time of each stage, s.
    real_time_factor
        Seconds of the bag in a second of processing.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    real_time_factor: float = 0.0


# --- truth.json ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthSurface:
    """A true surface; the keys are those of surfaces.json.

    Attributes
    ----------
    id, label
        As in surfaces.json.
    height, area
        m in map, and m2.
    boundary, holes
        float64 (N, 3), open rings in map, m.
    """

    id: int
    label: str
    height: float
    area: float
    boundary: Ring
    holes: tuple[Ring, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthObject:
    """A true box on a surface.

    Attributes
    ----------
    name
        Name of the object in the simulated world.
    center, size
        float64 (3,), m, in map.
    yaw
        Yaw of its x axis, rad.
    """

    name: str
    center: Vector
    size: Vector
    yaw: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthSign:
    """A true door sign, in map.

    Attributes
    ----------
    id, text
        Its number in the file, and the number on it.
    position
        float64 (3,), middle of the number, m.
    normal
        float64 (3,), out of its wall.
    room
        Name of the room that it belongs to; None for none.
    """

    id: int
    text: str
    position: Vector
    normal: Vector
    room: str | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthRoom:
    """A true room.

    Attributes
    ----------
    name
        Its name.
    boundary
        float64 (N, 2), open ring of the faces of its walls in map, m.
    """

    name: str
    boundary: Ring2


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthFile:
    """truth.json: the true surfaces of a recording.

    Attributes
    ----------
    format, version
        As in surfaces.json.
    frame_id
        Frame of all coordinates.
    floor_z
        Height of the floor, m.
    surfaces
        Surfaces present at the end of the recording.
    gone
        Surfaces removed during the recording.
    others
        Horizontal tops too small or too hidden to count as missed.
    objects
        Boxes on surfaces.
    signs
        Door signs.
    rooms
        Rooms, including the corridor.
    """

    format: Literal["tccm_ros/surfaces"] = "tccm_ros/surfaces"
    version: Literal[1] = 1
    frame_id: str = "map"
    floor_z: float | None = None
    surfaces: tuple[TruthSurface, ...]
    gone: tuple[TruthSurface, ...] = ()
    others: tuple[TruthSurface, ...] = ()
    objects: tuple[TruthObject, ...] = ()
    signs: tuple[TruthSign, ...] = ()
    rooms: tuple[TruthRoom, ...] = ()


def plan_polygon(surface: Surface | SurfaceEntry | TruthSurface) -> shapely.Geometry:
    """Return the outline of a surface from above, with its holes, made valid."""
    if len(surface.boundary) < 3:
        return shapely.Polygon()
    holes = [hole[:, :2] for hole in surface.holes if len(hole) > 2]
    return shapely.make_valid(shapely.Polygon(surface.boundary[:, :2], holes))
