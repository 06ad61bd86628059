"""Tables of the catalogue, with columns from the models of the result files.

A field of a model becomes a column of the same name, or three columns for a vector; fields of other
shapes are omitted. Outlines are in the GeoParquet column ``geometry`` with ``crs`` null, because
the coordinates are relative to a map, not to the earth.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import shapely
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Float64, Vector
from tccm_ros.geometry import transform2
from tccm_ros.records import Wall
from tccm_ros.results.folder_reader import read_json
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

Row = tuple[Any, BaseGeometry, tuple[Any, ...]]
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
    objects = folder / "objects.json"
    return ResultFiles(
        name,
        folder,
        read_json(folder / "surfaces.json", SurfacesFile),
        read_json(objects, ObjectsFile) if objects.exists() else ObjectsFile(),
        read_json(folder / "walls.json", WallsFile),
        read_signs(folder),
    )


def read_signs(folder: Path) -> tuple[SignEntry, ...]:
    """Return the door signs of a result folder; none without signs.json.

    Raises
    ------
    MapError
        If the file is damaged.
    """
    path = folder / "signs.json"
    return read_json(path, SignsFile).signs if path.exists() else ()


class Column(NamedTuple):
    """Name and type of a column, and the function that returns its value from an entry."""

    name: str
    type: pa.DataType
    value: Callable[[Any], Any]


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
        Columns that are not fields of the model.
    """

    name: str
    entry: type[Any]
    rows: Callable[[ResultFiles], Iterable[Row]]
    further: tuple[tuple[str, pa.DataType], ...] = ()

    @property
    def schema(self) -> pa.Schema:
        """Names and types of all columns, with GeoParquet's metadata."""
        columns = [("map", pa.string()), ("folder", pa.string())]
        columns += [(column.name, column.type) for column in _columns(self.entry)]
        columns += [*self.further, ("geometry", pa.binary())]
        return pa.schema(columns, metadata={"geo": json.dumps(GEO)})

    def of(self, source: ResultFiles) -> pa.Table:
        """Return the rows of a map."""
        columns = _columns(self.entry)
        head = source.map, str(source.folder)
        rows = [
            (*head, *(column.value(entry) for column in columns), *more, shapely.to_wkb(geometry))
            for entry, geometry, more in self.rows(source)
        ]
        schema = self.schema
        values = zip(*rows) if rows else ((),) * len(schema)
        arrays = [pa.array(v, field.type) for v, field in zip(values, schema)]
        return pa.Table.from_arrays(arrays, schema=schema)


GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": [], "crs": None}},
}
"""GeoParquet's file metadata."""


def _columns(entry: type[Any]) -> list[Column]:
    """Return the columns for the fields of a model."""
    hints = get_type_hints(entry, include_extras=True)
    return [c for f in fields(entry) for c in _columns_of(f.name, hints[f.name])]


def _columns_of(name: str, hint: Any) -> list[Column]:
    if hint == Vector:
        return [Column(f"{name}_{x}", pa.float64(), _item(name, k)) for k, x in enumerate("xyz")]
    if get_origin(hint) in (Union, UnionType):
        kinds = [kind for kind in get_args(hint) if kind is not type(None)]
        hint = kinds[0] if len(kinds) == 1 else None
    if name in STAMPS and hint is float:
        return [Column(name, TIME, lambda entry: _time(getattr(entry, name)))]
    if isinstance(hint, type) and issubclass(hint, Enum):
        return [Column(name, pa.string(), lambda entry: str(getattr(entry, name).value))]
    if hint in PLAIN:
        return [Column(name, PLAIN[hint], lambda entry: getattr(entry, name))]
    return []


def _item(name: str, index: int) -> Callable[[Any], float]:
    return lambda entry: float(getattr(entry, name)[index])


def _time(seconds: float | None) -> int | None:
    return None if seconds is None else round(seconds * 1e6)


def _surface_rows(source: ResultFiles) -> Iterable[Row]:
    free = {places.surface: _free_area(places) for places in source.objects.free}
    for entry in source.surfaces.surfaces:
        above = entry.height - (source.surfaces.floor_z or 0.0)
        yield entry, shapely.Polygon(entry.boundary, entry.holes), (above, free.get(entry.id))


def _free_area(places: FreePlacesEntry) -> float:
    return sum(shapely.Polygon(ring).area for ring in places.polygons)


def _object_rows(source: ResultFiles) -> Iterable[Row]:
    seen = {surface.id: surface.last_seen for surface in source.surfaces.surfaces}
    for entry in source.objects.objects:
        x, y, z = 0.5 * entry.size
        corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
        pose = np.array([*entry.center[:2], entry.yaw])
        ring = _at_height(transform2(pose, corners), float(entry.center[2] - z))
        yield entry, shapely.Polygon(ring), (_time(seen.get(entry.surface)),)


def _at_height(ring: Float64, z: float) -> Float64:
    return np.column_stack([ring, np.full(len(ring), z)])


def _wall_rows(source: ResultFiles) -> Iterable[Row]:
    for entry in source.walls.walls:
        length = float(np.linalg.norm(entry.endpoints[1] - entry.endpoints[0]))
        yield entry, shapely.LineString(entry.endpoints), (length,)


def _sign_rows(source: ResultFiles) -> Iterable[Row]:
    for entry in source.signs:
        stamps: Sequence[float] = [view.stamp for view in entry.views]
        times = _time(min(stamps, default=None)), _time(max(stamps, default=None))
        yield entry, shapely.Point(entry.position), times


TABLES = (
    Table(
        "surfaces",
        SurfaceEntry,
        _surface_rows,
        (("height_above_floor", pa.float64()), ("free_area", pa.float64())),
    ),
    Table("objects", ObjectEntry, _object_rows, (("last_seen", TIME),)),
    Table("walls", Wall, _wall_rows, (("length", pa.float64()),)),
    Table("signs", SignEntry, _sign_rows, (("first_seen", TIME), ("last_seen", TIME))),
)
"""The tables of the catalogue."""
