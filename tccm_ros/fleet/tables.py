"""Tables of the catalogue, with columns from the models of the result files.

A field of a model becomes a column of the same name, or three columns for a vector; fields of other
shapes are omitted. Outlines are in the GeoParquet column ``geometry`` with ``crs`` null, because
the coordinates are relative to a map, not to the earth.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import shapely
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Float64, Vector
from tccm_ros.geometry import transform2
from tccm_ros.records import Wall
from tccm_ros.results.folder_reader import read_json, read_or_empty
from tccm_ros.results.models import (
    FreePlacesEntry,
    ObjectEntry,
    ObjectsFile,
    SignEntry,
    SignsFile,
    SurfaceEntry,
    SurfacesFile,
    WallsFile,
)

STAMPS = ("stamp", "first_seen", "last_seen")
"""Fields in seconds that are converted to times."""

TIME = pa.timestamp("us")
"""UTC without a time zone, which databases compare without further libraries."""

Row = tuple[Any, BaseGeometry, dict[str, Any]]
"""An entry, its geometry, and the values of the additional columns."""

PLAIN = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}


@dataclass(frozen=True, slots=True, eq=False)
class ResultFiles:
    """Result files of a map, from which its rows are made.

    Attributes
    ----------
    map
        Name of the map in the catalogue.
    folder
        Result folder.
    surfaces, objects, walls, signs
        Contents of the files; empty for a missing file.
    """

    map: str
    folder: Path
    surfaces: SurfacesFile
    objects: ObjectsFile
    walls: WallsFile
    signs: tuple[SignEntry, ...]


def read_source(name: str, folder: Path) -> ResultFiles:
    """Read the result files of a map.

    Parameters
    ----------
    name
        Name of the map in the catalogue.
    folder
        Result folder.

    Raises
    ------
    MapError
        If surfaces.json or walls.json is missing, or a file is damaged.
    """
    return ResultFiles(
        name,
        folder,
        read_json(folder / "surfaces.json", SurfacesFile),
        read_or_empty(folder / "objects.json", ObjectsFile),
        read_json(folder / "walls.json", WallsFile),
        read_or_empty(folder / "signs.json", SignsFile).signs,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A table of the catalogue.

    Attributes
    ----------
    name
        Name of the table.
    entry
        Model whose fields are columns.
    rows
        Returns the rows of a map: entries, geometries, and values of the additional columns.
    further
        Types of the columns that are not fields of the model.
    """

    name: str
    entry: type[Any]
    rows: Callable[[ResultFiles], Iterable[Row]]
    further: Mapping[str, pa.DataType]

    @property
    def schema(self) -> pa.Schema:
        """Names and types of all columns, with GeoParquet's metadata."""
        columns = {"map": pa.string(), "folder": pa.string(), **_columns(self.entry)}
        columns |= {**self.further, "geometry": pa.binary()}
        return pa.schema(columns, metadata={"geo": json.dumps(GEO)})

    def of(self, source: ResultFiles) -> pa.Table:
        """Return the rows of a map."""
        head = {"map": source.map, "folder": str(source.folder)}
        rows = [
            {**head, **_values(entry), **more, "geometry": shapely.to_wkb(geometry)}
            for entry, geometry, more in self.rows(source)
        ]
        return pa.Table.from_pylist(rows, schema=self.schema)


GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": [], "crs": None}},
}
"""GeoParquet's file metadata."""


def _columns(entry: type[Any]) -> dict[str, pa.DataType]:
    """Return the columns for the fields of a model, and their types."""
    columns: dict[str, pa.DataType] = {}
    for name, hint in get_type_hints(entry, include_extras=True).items():
        kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        kind = next(kind for kind in kinds if kind is not type(None))
        if hint == Vector:
            columns |= {f"{name}_{x}": pa.float64() for x in "xyz"}
        elif name in STAMPS:
            columns[name] = TIME
        elif isinstance(kind, type) and issubclass(kind, tuple(PLAIN)):
            columns[name] = next(PLAIN[plain] for plain in PLAIN if issubclass(kind, plain))
    return columns


def _values(entry: Any) -> dict[str, Any]:
    """Return the values of the columns of an entry, and of fields that are no columns."""
    values: dict[str, Any] = {}
    for name in entry.__dataclass_fields__:
        value = getattr(entry, name)
        if isinstance(value, np.ndarray) and value.shape == (3,):
            values |= {f"{name}_{x}": number for x, number in zip("xyz", value.tolist())}
        else:
            values[name] = _time(value) if name in STAMPS else value
    return values


def _time(seconds: float | None) -> int | None:
    return None if seconds is None else round(seconds * 1e6)


def _surface_rows(source: ResultFiles) -> Iterable[Row]:
    free = {places.surface: _free_area(places) for places in source.objects.free}
    for entry in source.surfaces.surfaces:
        above = entry.height - (source.surfaces.floor_z or 0.0)
        more = {"height_above_floor": above, "free_area": free.get(entry.id)}
        yield entry, shapely.Polygon(entry.boundary, entry.holes), more


def _free_area(places: FreePlacesEntry) -> float:
    return sum(shapely.Polygon(ring).area for ring in places.polygons)


def _object_rows(source: ResultFiles) -> Iterable[Row]:
    seen = {surface.id: surface.last_seen for surface in source.surfaces.surfaces}
    for entry in source.objects.objects:
        x, y, z = 0.5 * entry.size
        corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
        pose = np.array([*entry.center[:2], entry.yaw])
        ring = _at_height(transform2(pose, corners), float(entry.center[2] - z))
        yield entry, shapely.Polygon(ring), {"last_seen": _time(seen.get(entry.surface))}


def _at_height(ring: Float64, z: float) -> Float64:
    return np.column_stack([ring, np.full(len(ring), z)])


def _wall_rows(source: ResultFiles) -> Iterable[Row]:
    for entry in source.walls.walls:
        length = float(np.linalg.norm(entry.endpoints[1] - entry.endpoints[0]))
        yield entry, shapely.LineString(entry.endpoints), {"length": length}


def _sign_rows(source: ResultFiles) -> Iterable[Row]:
    for entry in source.signs:
        stamps: Sequence[float] = [view.stamp for view in entry.views]
        first, last = min(stamps, default=None), max(stamps, default=None)
        times = {"first_seen": _time(first), "last_seen": _time(last)}
        yield entry, shapely.Point(entry.position), times


TABLES = (
    Table(
        "surfaces",
        SurfaceEntry,
        _surface_rows,
        {"height_above_floor": pa.float64(), "free_area": pa.float64()},
    ),
    Table("objects", ObjectEntry, _object_rows, {"last_seen": TIME}),
    Table("walls", Wall, _wall_rows, {"length": pa.float64()}),
    Table("signs", SignEntry, _sign_rows, {"first_seen": TIME, "last_seen": TIME}),
)
"""The tables of the catalogue."""
