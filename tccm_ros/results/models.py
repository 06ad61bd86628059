"""What the JSON files of a result folder hold: one class for each file and each kind of entry.

Writer, report, evaluation and comparison use these classes, and `docs/reference/schema` is made
from them. The names of the fields are the keys of the files, in their order; a trailing underscore
(`from_`) is no part of the key. Lengths are in m, angles in rad, stamps in s; numbers that are not
finite are written as null. Readers ignore keys that they do not know.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import ConfigDict, PlainValidator, WithJsonSchema

from tccm_ros.arrays import Float64
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.records import (
    Keyframe,
    Landmark,
    Loop,
    Surface,
    Wall,
)
from tccm_ros.results.numbers import Stamp, key_of
from tccm_ros.results.surface_counts import SurfaceCounts
from tccm_ros.surfaces.scene_objects import SceneObject

__all__ = [
    "CountsEntry",
    "CycleEntry",
    "FreePlacesEntry",
    "GraphFile",
    "KeyframeEntry",
    "LandmarkEntry",
    "LoopEntry",
    "ObjectEntry",
    "ObjectsFile",
    "PlaneEntry",
    "PlanesFile",
    "ScansUsedEntry",
    "SessionEntry",
    "SessionKind",
    "SummaryFile",
    "SurfaceEntry",
    "SurfacesFile",
    "TimingFile",
    "TruthFile",
    "TruthObject",
    "TruthSurface",
    "ViewEntry",
    "WallEntry",
    "WallsFile",
]


def _array_type(*shape: int | None, is_finite: bool = True) -> tuple[PlainValidator, Any]:
    """Return how a float64 array of a shape is read, None for any length, and its JSON Schema."""

    def check(value: Any) -> Float64:
        array = np.asarray(value, np.float64)
        if array.size == 0 and shape[0] is None:
            array = array.reshape(0, *shape[1:])
        fits = len(array.shape) == len(shape) and all(
            wanted in (None, found) for wanted, found in zip(shape, array.shape)
        )
        if not fits or (is_finite and not np.isfinite(array).all()):
            raise ValueError(f"an array of {' x '.join(str(n or 'N') for n in shape)} is expected")
        return array

    schema: dict[str, Any] = {"type": "number" if is_finite else ["number", "null"]}
    for length in reversed(shape):
        schema = {"type": "array", "items": schema}
        if length is not None:
            schema |= {"minItems": length, "maxItems": length}
    return PlainValidator(check), WithJsonSchema(schema)


Vector = Annotated[Float64, *_array_type(3)]
Ring = Annotated[Float64, *_array_type(None, 3)]
Ends = Annotated[Float64, *_array_type(2, 2)]
Covariance2 = Annotated[Float64, *_array_type(2, 2, is_finite=False)]
Covariance3 = Annotated[Float64, *_array_type(3, 3, is_finite=False)]


EntryType = TypeVar("EntryType")


def _entry(kind: type[EntryType], record: Any, **others: Any) -> EntryType:
    """Return the entry of a record: its attributes of the same names, but for `others`."""
    names = (name for name in kind.__dataclass_fields__ if name not in others)  # type: ignore[attr-defined]
    return kind(**{name: getattr(record, name) for name in names}, **others)


# --- surfaces.json -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ViewEntry:
    """One view that a surface was measured in; keyframe -1 where there is none near in time."""

    stamp: float
    keyframe: int
    points: int


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceEntry:
    """One surface, in map: the attributes are those of `records.Surface`, stamps in s."""

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

    @classmethod
    def of(cls, surface: Surface) -> SurfaceEntry:
        """Return the entry of a surface."""
        return _entry(
            cls,
            surface,
            first_seen=Stamp(surface.first_seen_ns),
            last_seen=Stamp(surface.last_seen_ns),
            views=tuple(_entry(ViewEntry, v, stamp=Stamp(v.stamp_ns)) for v in surface.views),
        )

    @property
    def is_floor(self) -> bool:
        """Return whether this is the floor."""
        return self.label == "floor"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfacesFile:
    """surfaces.json: the map of surfaces; `floor_z` is None where the floor was never seen."""

    format: Literal["tccm_ros/surfaces"] = "tccm_ros/surfaces"
    version: Literal[1] = 1
    frame_id: str = "map"
    floor_z: float | None = None
    surfaces: tuple[SurfaceEntry, ...]

    @classmethod
    def of(cls, surfaces: Iterable[Surface], floor_z: float | None, frame_id: str) -> SurfacesFile:
        """Return what surfaces.json holds of these surfaces."""
        entries = tuple(map(SurfaceEntry.of, surfaces))
        return cls(frame_id=frame_id, floor_z=floor_z, surfaces=entries)


# --- objects.json --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ObjectEntry:
    """A box on a surface, in map: `yaw` of its x axis in (-pi/2, pi/2]."""

    id: int
    surface: int
    center: Vector
    size: Vector
    yaw: float


@dataclass(frozen=True, slots=True, eq=False)
class FreePlacesEntry:
    """Where there is room on a surface: open rings (N, 3) in map."""

    surface: int
    polygons: tuple[Ring, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ObjectsFile:
    """objects.json: what stands on surfaces, and where there is room."""

    objects: tuple[ObjectEntry, ...] = ()
    free: tuple[FreePlacesEntry, ...] = ()

    @classmethod
    def of(
        cls, objects: Iterable[SceneObject], free: Mapping[int, Sequence[Float64]]
    ) -> ObjectsFile:
        """Return what objects.json holds of what `scene_objects` gives."""
        return cls(
            tuple(_entry(ObjectEntry, item) for item in objects),
            tuple(FreePlacesEntry(s, tuple(rings)) for s, rings in sorted(free.items())),
        )


# --- walls.json ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class WallEntry:
    """One wall, in map: the attributes are those of `records.Wall`."""

    id: int
    phi: float
    rho: float
    endpoints: Ends
    observations: int
    covariance: Covariance2
    corners: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class WallsFile:
    """walls.json."""

    walls: tuple[WallEntry, ...]

    @classmethod
    def of(cls, walls: Iterable[Wall]) -> WallsFile:
        """Return what walls.json holds of these walls."""
        return cls(tuple(_entry(WallEntry, wall) for wall in walls))


# --- graph.json ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeEntry:
    """A keyframe of the graph: `pose` is (x, y, yaw) of base in map."""

    id: int
    stamp: float
    pose: Vector


@dataclass(frozen=True, slots=True, eq=False)
class LoopEntry:
    """A proposed loop closure: `delta` is the planar pose of keyframe `to` in `from`."""

    __pydantic_config__ = ConfigDict(alias_generator=key_of)

    from_: int
    to: int
    delta: Vector
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkEntry:
    """A landmark of the graph other than a wall: its position (3,) in map and its covariance."""

    kind: str
    id: int
    position: Vector
    covariance: Covariance3
    observations: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class GraphFile:
    """graph.json."""

    keyframes: tuple[KeyframeEntry, ...] = ()
    loops: tuple[LoopEntry, ...] = ()
    landmarks: tuple[LandmarkEntry, ...] = ()

    @classmethod
    def of(
        cls, keyframes: Iterable[Keyframe], loops: Iterable[Loop], landmarks: Iterable[Landmark]
    ) -> GraphFile:
        """Return what graph.json holds of a solution's keyframes, loops and landmarks."""
        return cls(
            tuple(_entry(KeyframeEntry, k, stamp=Stamp(k.stamp_ns)) for k in keyframes),
            tuple(LoopEntry(p.from_id, p.to_id, p.delta, p.accepted, p.reason) for p in loops),
            tuple(_entry(LandmarkEntry, landmark) for landmark in landmarks),
        )


# --- planes.json ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class PlaneEntry:
    """One tracked plane of a cycle: the attributes are those of `records.PlaneRecord`."""

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
    """The tracked planes of one tilt cycle, in `frame_id`, the odometry frame."""

    cycle: int
    stamp: float
    frame_id: str
    planes: tuple[PlaneEntry, ...]

    @classmethod
    def of(cls, cycle: CycleResult) -> CycleEntry:
        """Return the entry of a cycle."""
        planes = tuple(_entry(PlaneEntry, plane) for plane in cycle.planes)
        return _entry(cls, cycle, stamp=Stamp(cycle.stamp_ns), planes=planes)


@dataclass(frozen=True, slots=True, eq=False)
class PlanesFile:
    """planes.json."""

    cycles: tuple[CycleEntry, ...] = ()

    @classmethod
    def of(cls, cycles: Iterable[CycleResult]) -> PlanesFile:
        """Return what planes.json holds of these cycles."""
        return cls(tuple(map(CycleEntry.of, cycles)))


# --- summary.json and timing.json ----------------------------------------------------------------


class SessionKind(StrEnum):
    """What a recording is to the map."""

    FIRST = "first"
    """It begins a map."""
    NEW = "new"
    """It goes on with a saved map, in which its place was found."""


@dataclass(frozen=True, slots=True)
class SessionEntry:
    """How the recording began."""

    kind: SessionKind


@dataclass(frozen=True, slots=True)
class ScansUsedEntry:
    """Scans of each laser that were used."""

    tilt: int
    level: int


@dataclass(frozen=True, slots=True)
class CountsEntry:
    """Counts of what was read, dropped and found.

    `messages` is by topic, `dropped` by reason; surfaces are counted as `surface_counts` says.
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

    @property
    def surface_counts(self) -> SurfaceCounts:
        """Numbers of surfaces above the floor."""
        return SurfaceCounts(self.surfaces, self.small_surfaces)


@dataclass(frozen=True, slots=True)
class SummaryFile:
    """summary.json: what a replay read and found, and how it was configured.

    `versions` are those of the package, Python and libraries; `bag_duration` is in s.
    """

    versions: dict[str, str]
    bag_duration: float
    session: SessionEntry
    counts: CountsEntry
    config: dict[str, Any]


@dataclass(frozen=True, slots=True)
class TimingFile:
    """timing.json: seconds of each stage, and seconds of the bag in a second of processing."""

    seconds: dict[str, float] = field(default_factory=dict)
    real_time_factor: float = 0.0


# --- truth.json ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthSurface:
    """A surface that is really there; the keys are those of surfaces.json."""

    id: int
    label: str
    height: float
    area: float
    boundary: Ring
    holes: tuple[Ring, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthObject:
    """A box that really stands on a surface."""

    name: str
    center: Vector
    size: Vector
    yaw: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthFile:
    """truth.json: surfaces at the end of a recording, what went before, and other level tops.

    `others` are too small or too hidden to count as missed.
    """

    format: Literal["tccm_ros/surfaces"] = "tccm_ros/surfaces"
    version: Literal[1] = 1
    frame_id: str = "map"
    floor_z: float | None = None
    surfaces: tuple[TruthSurface, ...]
    gone: tuple[TruthSurface, ...] = ()
    others: tuple[TruthSurface, ...] = ()
    objects: tuple[TruthObject, ...] = ()
