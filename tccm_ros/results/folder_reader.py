"""Read a result folder as typed values, for pictures, report and comparison.

The report uses only these files, so that a folder can be viewed years later on another machine.
``surfaces.json``, ``walls.json`` and ``trajectory.tum`` are required; the other files are optional.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from tccm_ros.arrays import Float64
from tccm_ros.errors import LogError, MapError, one_line
from tccm_ros.records import Room, Wall
from tccm_ros.results.cuboids_file import FinalCuboids, load_cuboids
from tccm_ros.results.cycles_file import CycleParts, load_cycles
from tccm_ros.results.models import (
    CompartmentEntry,
    CycleEntry,
    FreePlacesEntry,
    GraphFile,
    ObjectEntry,
    ObjectsFile,
    PlanesFile,
    RacksFile,
    SignEntry,
    SignsFile,
    SummaryFile,
    SurfaceEntry,
    SurfacesFile,
    TimingFile,
    TruthFile,
    TruthSurface,
    WallsFile,
)
from tccm_ros.results.trajectory import Trajectory, read_tum

FileType = TypeVar("FileType")


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Content of a result folder; missing parts are None or empty.

    Attributes
    ----------
    folder
        The folder that was read.
    floor_z
        Height of the floor in map, m; None if it was never seen.
    surfaces, walls
        Contents of surfaces.json and walls.json, in map.
    trajectory
        Poses of the base in map.
    signs
        Door signs, in map.
    rooms
        Rooms between the walls, in map.
    graph
        Keyframes, loop closures and landmarks.
    objects, free
        Boxes on surfaces, and free places on surfaces, in map.
    compartments
        Compartments of racks, in map.
    planes
        Tracked planes by tilt cycle.
    cuboids
        The final integration map, in the odometry frame.
    cycles
        The coarsened part map of each tilt cycle, in the odometry frame.
    summary, timing
        Contents of summary.json and timing.json.
    truth
        Surfaces of truth.json.
    """

    folder: Path
    floor_z: float | None
    surfaces: tuple[SurfaceEntry, ...]
    walls: tuple[Wall, ...]
    trajectory: Trajectory
    signs: tuple[SignEntry, ...]
    rooms: tuple[Room, ...]
    graph: GraphFile
    objects: tuple[ObjectEntry, ...]
    free: tuple[FreePlacesEntry, ...]
    compartments: tuple[CompartmentEntry, ...]
    planes: tuple[CycleEntry, ...]
    cuboids: FinalCuboids | None
    cycles: CycleParts | None
    summary: SummaryFile | None
    timing: TimingFile | None
    truth: tuple[TruthSurface, ...]

    @property
    def above_floor(self) -> tuple[SurfaceEntry, ...]:
        """The surfaces other than the floor."""
        return tuple(s for s in self.surfaces if not s.is_floor)

    @property
    def tabletop(self) -> tuple[ObjectEntry, ...]:
        """The objects on surfaces other than the floor."""
        surfaces = {surface.id for surface in self.above_floor}
        return tuple(box for box in self.objects if box.surface in surfaces)

    @property
    def ground(self) -> float:
        """Height of the floor in map, m; 0 if it was never seen."""
        return 0.0 if self.floor_z is None else self.floor_z

    @property
    def start(self) -> float:
        """Origin of displayed times: the first stamp of trajectory and tilt cycles, s."""
        first = [float(stamp) for stamp in self.trajectory.stamps[:1]]
        first += [cycle.stamp for cycle in self.planes[:1]]
        return min(first, default=0.0)

    def view_stamps(self) -> Float64:
        """Return the distinct stamps of all views, sorted, float64 (V,), s."""
        return np.unique([view.stamp for s in self.surfaces for view in s.views])


def load_results(folder: Path | str) -> Results:
    """Read a result folder.

    Parameters
    ----------
    folder
        Output folder of ``tccm replay --out``.

    Raises
    ------
    MapError
        If the folder or one of the three required files is missing, or if a file is damaged.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise MapError(f"{folder}: no such folder; expected what 'tccm replay --out' wrote")
    surfaces = read_json(folder / "surfaces.json", SurfacesFile)
    walls = read_json(folder / "walls.json", WallsFile)
    objects = read_or_empty(folder / "objects.json", ObjectsFile)
    cuboids, cycles = folder / "cuboids.npz", folder / "cycles.npz"
    true = _read_optional(folder / "truth.json", TruthFile)
    return Results(
        folder,
        surfaces.floor_z,
        surfaces.surfaces,
        walls.walls,
        _trajectory(folder / "trajectory.tum"),
        read_or_empty(folder / "signs.json", SignsFile).signs,
        surfaces.rooms,
        read_or_empty(folder / "graph.json", GraphFile),
        objects.objects,
        objects.free,
        read_or_empty(folder / "racks.json", RacksFile).compartments,
        read_or_empty(folder / "planes.json", PlanesFile).cycles,
        load_cuboids(cuboids) if cuboids.exists() else None,
        load_cycles(cycles) if cycles.exists() else None,
        _read_optional(folder / "summary.json", SummaryFile),
        _read_optional(folder / "timing.json", TimingFile),
        true.surfaces if true else (),
    )


def read_json(path: Path, model: type[FileType]) -> FileType:
    """Read one JSON file as its model.

    Raises
    ------
    MapError
        If the file is missing or damaged; the message names the key of an invalid value.
    """
    kind: Any = model
    try:
        return _adapter(kind).validate_json(path.read_bytes())
    except FileNotFoundError:
        raise MapError(f"{path}: no such file; is this a folder of results?") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise MapError(f"{path}: damaged: {key or 'file'}: {first['msg'].lower()}") from None
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({one_line(error)})") from None


def read_or_empty(path: Path, model: type[FileType]) -> FileType:
    """Read one JSON file as its model; without the file, return an empty model.

    Raises
    ------
    MapError
        If the file is damaged.
    """
    return read_json(path, model) if path.exists() else model()


def read_json_or_none(path: Path, model: type[FileType]) -> FileType | None:
    """Read one JSON file as its model; return None if there is no readable one."""
    try:
        return read_json(path, model)
    except MapError:
        return None


@cache
def _adapter(model: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(model)


def _read_optional(path: Path, model: type[FileType]) -> FileType | None:
    return read_json(path, model) if path.exists() else None


def _trajectory(path: Path) -> Trajectory:
    if not path.exists():
        raise MapError(f"{path}: no such file; is this a folder of results?")
    try:
        return read_tum(path)
    except LogError as error:
        raise MapError(str(error)) from None
