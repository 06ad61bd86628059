"""Maps to merge, read from files or result folders, with the outlines of their surfaces."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import shapely

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.errors import FleetError, MapError, one_line
from tccm_ros.fleet.layout import FleetFolder
from tccm_ros.geometry import spatial
from tccm_ros.mapping.saved_map import SavedMap
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.outlines.transformation import transform_outline
from tccm_ros.records import Surface
from tccm_ros.results.folder_reader import read_json, read_or_empty
from tccm_ros.results.map_file import load_map
from tccm_ros.results.models import SignEntry, SignsFile, SurfaceEntry, SurfacesFile, plan_polygon
from tccm_ros.slam.saved_walls import SavedWalls, unpack_walls

MAP = "map.mcap"

MAX_HEIGHT_DIFFERENCE = 0.03
"""Maximum difference in height of a surface in two maps, m. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFootprint:
    """Outline of a surface from above, in its map.

    Attributes
    ----------
    id
        Id of the surface.
    polygon
        Its outline with holes.
    height
        Height above the floor, m.
    is_floor
        Whether it is the floor.
    """

    id: int
    polygon: shapely.Polygon
    height: float
    is_floor: bool

    def moved(self, T: Float64) -> SurfaceFootprint:
        """Return it in another frame, where its map has the planar pose T, float64 (3,)."""
        return replace(self, polygon=transform_outline(spatial(T), self.polygon))

    def is_as_high_as(self, other: SurfaceFootprint) -> bool:
        """Return whether the heights allow both to be the same surface."""
        return abs(self.height - other.height) <= MAX_HEIGHT_DIFFERENCE


@dataclass(frozen=True, slots=True, eq=False)
class MapInput:
    """A map to merge.

    Attributes
    ----------
    name
        Name in messages and tables.
    path
        The map file.
    checksum
        SHA-256 of the file.
    saved
        Content of the file.
    walls
        Keyframes with their constraints.
    surfaces
        Surfaces, by id.
    signs
        Door signs with a number.
    """

    name: str
    path: Path
    checksum: str
    saved: SavedMap
    walls: SavedWalls
    surfaces: tuple[SurfaceFootprint, ...]
    signs: tuple[SignEntry, ...] = ()


def find_maps(sources: Iterable[Path]) -> list[Path]:
    """Return the map files in files, result folders and fleet folders, in order.

    Parameters
    ----------
    sources
        Paths of these.

    Raises
    ------
    FleetError
        If a path has no map, or there are fewer than two maps.
    """
    found: list[Path] = []
    for source in sources:
        folder = FleetFolder(source).recordings
        if folder.is_dir():
            files = sorted(path / MAP for path in folder.iterdir() if (path / MAP).is_file())
        else:
            files = [source / MAP if source.is_dir() else source]
        if not files or not all(file.is_file() for file in files):
            raise FleetError(f"{source}: no map here; expected a map.mcap, or a folder with one")
        found += files
    if len(found) < 2:
        raise FleetError("a single map: nothing to merge")
    return found


def checksum_of(path: Path) -> str:
    """Return the SHA-256 of a file.

    Raises
    ------
    MapError
        If it cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({one_line(error)})") from None


def read_map(path: Path, config: Config) -> MapInput:
    """Read a map, with the surfaces and signs of the result files next to it.

    Without surfaces.json, the surfaces are built from the map; without signs.json, there are no
    signs.

    Parameters
    ----------
    path
        The map file.
    config
        Configuration for building surfaces.

    Raises
    ------
    MapError
        If the map is damaged or of another version, or has no walls.
    """
    saved = load_map(path)
    if not saved.keyframe_count:
        raise MapError(f"{path}: made without a level laser: it has no keyframes to merge it by")
    beside = path.with_name("surfaces.json")
    signs: tuple[SignEntry, ...] = ()
    if path.name == MAP and beside.exists():
        file = read_json(beside, SurfacesFile)
        surfaces = footprints_of(file.surfaces, file.floor_z)
        known = read_or_empty(path.with_name("signs.json"), SignsFile).signs
        signs = tuple(sign for sign in known if sign.number)
    else:
        mapped = SurfaceSlam.from_saved(config, saved).solve().mapped
        surfaces = footprints_of(mapped.surfaces, mapped.floor_z)
    name = str(path.parent if path.name == MAP else path)
    walls = unpack_walls(saved.walls)
    return MapInput(name, path, checksum_of(path), saved, walls, surfaces, signs)


def footprints_of(
    surfaces: Iterable[Surface | SurfaceEntry], floor_z: float | None
) -> tuple[SurfaceFootprint, ...]:
    """Return the outlines of a map's surfaces, with their heights above the floor."""
    return tuple(
        SurfaceFootprint(s.id, plan_polygon(s), s.height - (floor_z or 0.0), s.label == "floor")
        for s in surfaces
    )
