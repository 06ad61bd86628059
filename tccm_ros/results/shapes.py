"""What the JSON files of a result folder hold, one class for each kind of entry.

The names are the files' keys (DESIGN section 5); keys that the report does not show are ignored.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from shapely import Point, Polygon
from shapely.ops import polylabel

__all__ = [
    "Entry",
    "FreePlace",
    "Graph",
    "Keyframe",
    "LandmarkEntry",
    "Loop",
    "ObjectBox",
    "PlaneCycle",
    "PlaneShape",
    "SurfaceShape",
    "TruthOutline",
    "View",
    "WallLine",
]


def _array(columns: int) -> BeforeValidator:
    """Return a validator of finite float64 arrays (N, columns), or (columns,) for a vector."""

    def check(value: Any) -> NDArray[np.float64]:
        array = np.asarray(value, float)
        if array.size == 0:
            array = array.reshape(0, columns)
        if array.shape[-1] != columns or not np.isfinite(array).all():
            raise ValueError(f"numbers in rows of {columns} are expected")
        return array

    return BeforeValidator(check)


Points2 = Annotated[NDArray[np.float64], _array(2)]
Points3 = Annotated[NDArray[np.float64], _array(3)]


POLE_TOLERANCE = 0.01
"""How exactly the innermost point of an outline is wanted, m."""


class Entry(BaseModel):
    """Base of all entries: read-only, numbers checked."""

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True, extra="ignore")


class View(Entry):
    """One sight of a surface."""

    stamp: float
    keyframe: int | None = None
    points: int = 0


class SurfaceShape(Entry):
    """One surface of surfaces.json; the names are the file's keys (DESIGN section 5)."""

    id: int
    label: str
    height: float
    normal: Points3
    area: float
    centroid: Points3
    boundary: Points3
    holes: tuple[Points3, ...] = ()
    points: int | None = None
    height_std: float | None = None
    first_seen: float | None = None
    last_seen: float | None = None
    views: tuple[View, ...] = ()

    @property
    def is_floor(self) -> bool:
        """Whether this is the floor."""
        return self.label == "floor"

    @property
    def label_point(self) -> NDArray[np.float64]:
        """Where its name belongs, float64 (3,): the centroid, or well inside where that is not."""
        ring = Polygon(self.boundary[:, :2], [hole[:, :2] for hole in self.holes if len(hole) > 2])
        if not ring.is_valid or ring.is_empty:
            return self.centroid
        inner = polylabel(ring, POLE_TOLERANCE)
        middle = Point(self.centroid[:2])
        if ring.contains(middle) and middle.distance(ring.boundary) > 0.6 * inner.distance(
            ring.boundary
        ):
            return self.centroid
        return np.array([inner.x, inner.y, self.centroid[2]])


class TruthOutline(Entry):
    """One surface of truth.json: where it really is."""

    boundary: Points3


class WallLine(Entry):
    """One wall of walls.json: x cos phi + y sin phi = rho, between two endpoints (2, 2)."""

    id: int
    phi: float
    rho: float
    endpoints: Points2
    observations: int | None = None


class ObjectBox(Entry):
    """One object of objects.json: a box turned by yaw about z."""

    id: int
    surface: int | None = None
    center: Points3
    size: Points3
    yaw: float = 0.0


class FreePlace(Entry):
    """Where there is room on a surface: open rings (N, 3) of objects.json."""

    surface: int
    polygons: tuple[Points3, ...] = ()


class PlaneShape(Entry):
    """One tracked plane of one cycle of planes.json."""

    id: int
    kind: str
    normal: Points3
    support: int | None = None
    area: float | None = None
    boundary: Points3
    holes: tuple[Points3, ...] = ()
    rms: float | None = None


class PlaneCycle(Entry):
    """The planes of one cycle, in `frame_id`."""

    cycle: int
    stamp: float
    frame_id: str = ""
    planes: tuple[PlaneShape, ...]


class Keyframe(Entry):
    """One keyframe of graph.json: its pose is (x, y, yaw) of base in map."""

    id: int
    stamp: float
    pose: Points3


class Loop(Entry):
    """One proposed loop closure of graph.json."""

    start: int = Field(alias="from")
    end: int = Field(alias="to")
    accepted: bool = True
    reason: str | None = None


class LandmarkEntry(Entry):
    """One landmark of graph.json: its position in map with covariance (3, 3)."""

    kind: str
    id: int
    position: Points3
    covariance: Points3
    observations: int = 1


class Graph(Entry):
    """graph.json."""

    keyframes: tuple[Keyframe, ...] = ()
    loops: tuple[Loop, ...] = ()
    landmarks: tuple[LandmarkEntry, ...] = ()
