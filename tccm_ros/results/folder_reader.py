"""The result folder as typed values: what pictures, report and comparison are made of.

The report is a function of these files and nothing else, so a folder can be looked at years
later, on another machine. ``surfaces.json``, ``walls.json`` and ``trajectory.tum`` must be there;
the rest is shown when it is.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from tccm_ros.cuboids.cuboids import TICK
from tccm_ros.errors import MapError, one_line
from tccm_ros.geometry import pose_from_quaternion
from tccm_ros.results.cycles import CycleParts, load_cycles
from tccm_ros.results.shapes import (
    Entry,
    FreePlace,
    Graph,
    ObjectBox,
    PlaneCycle,
    SurfaceShape,
    TruthOutline,
    WallLine,
)

__all__ = ["FinalCuboids", "Results", "Trajectory", "load_results"]


class _SurfacesFile(Entry):
    format: Literal["tccm_ros/surfaces"] = "tccm_ros/surfaces"
    version: Literal[1] = 1
    floor_z: float | None = None
    surfaces: tuple[SurfaceShape, ...]


class _TruthFile(Entry):
    surfaces: tuple[TruthOutline, ...]


class _WallsFile(Entry):
    walls: tuple[WallLine, ...]


class _ObjectsFile(Entry):
    objects: tuple[ObjectBox, ...] = ()
    free: tuple[FreePlace, ...] = ()


class _PlanesFile(Entry):
    cycles: tuple[PlaneCycle, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """trajectory.tum: stamps float64 (N,) in s and T_map_base float64 (N, 4, 4)."""

    stamps: NDArray[np.float64]
    T_map_base: NDArray[np.float64]

    @property
    def positions(self) -> NDArray[np.float64]:
        """Places of the base in map, float64 (N, 3), m."""
        return self.T_map_base[:, :3, 3]

    @property
    def length(self) -> float:
        """Path length over ground, m."""
        steps = np.diff(self.positions[:, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    def nearest(self, stamps: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the index int64 (M,) of the pose nearest to each stamp in s; N must not be 0."""
        right = np.clip(np.searchsorted(self.stamps, stamps), 1, max(len(self.stamps) - 1, 1))
        right = np.minimum(right, len(self.stamps) - 1)
        left = np.maximum(right - 1, 0)
        earlier = np.abs(self.stamps[left] - stamps) <= np.abs(self.stamps[right] - stamps)
        return np.where(earlier, left, right)


@dataclass(frozen=True, slots=True, eq=False)
class FinalCuboids:
    """cuboids.npz, the integration map at the end, in the odometry frame.

    Attributes
    ----------
    cell_size
        m.
    ix, iy
        int64 (N,).
    bottom, top
        float64 (N,), m.
    count
        float64 (N,).
    mean, cov
        float64 (N, 3) and (N, 6: xx xy xz yy yz zz), m and m2.
    newest
        int64 (N,), newest cycle that each cuboid has a piece of.
    """

    cell_size: float
    ix: NDArray[np.int64]
    iy: NDArray[np.int64]
    bottom: NDArray[np.float64]
    top: NDArray[np.float64]
    count: NDArray[np.float64]
    mean: NDArray[np.float64]
    cov: NDArray[np.float64]
    newest: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ix)


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Everything that a result folder holds; what is not there is None or empty."""

    folder: Path
    floor_z: float | None
    surfaces: tuple[SurfaceShape, ...]
    walls: tuple[WallLine, ...]
    trajectory: Trajectory
    graph: Graph
    objects: tuple[ObjectBox, ...]
    free: tuple[FreePlace, ...]
    planes: tuple[PlaneCycle, ...]
    cuboids: FinalCuboids | None
    cycles: CycleParts | None
    summary: dict[str, Any]
    timing: dict[str, Any]
    truth: tuple[TruthOutline, ...]

    @property
    def standing(self) -> tuple[SurfaceShape, ...]:
        """The surfaces other than the floor."""
        return tuple(s for s in self.surfaces if not s.is_floor)

    @property
    def tabletop(self) -> tuple[ObjectBox, ...]:
        """The objects on surfaces other than the floor."""
        surfaces = {surface.id for surface in self.standing}
        return tuple(box for box in self.objects if box.surface in surfaces)

    @property
    def ground(self) -> float:
        """Height of the floor in map, 0 where it was never seen, m."""
        return 0.0 if self.floor_z is None else self.floor_z

    @property
    def start(self) -> float:
        """Stamp from which times are told: the first of the trajectory or the cycles, s."""
        first = [float(stamp) for stamp in self.trajectory.stamps[:1]]
        first += [cycle.stamp for cycle in self.planes[:1]]
        return min(first, default=0.0)

    def view_stamps(self) -> NDArray[np.float64]:
        """Return the stamps of all views, sorted, each once, float64 (V,), s."""
        return np.unique([view.stamp for s in self.surfaces for view in s.views])


def load_results(folder: Path | str, truth: Path | str | None = None) -> Results:
    """Read a result folder.

    Parameters
    ----------
    folder
        What ``tccm replay --out`` wrote.
    truth
        A truth.json to draw beside; ``truth.json`` in the folder, if any, when None.

    Raises
    ------
    MapError
        If the folder or one of the three files that must be there is missing, or one is damaged.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise MapError(f"{folder}: no such folder; expected what 'tccm replay --out' wrote")
    surfaces = _model(folder / "surfaces.json", _SurfacesFile)
    walls = _model(folder / "walls.json", _WallsFile)
    trajectory = _trajectory(folder / "trajectory.tum")
    objects = _model(folder / "objects.json", _ObjectsFile, _ObjectsFile())
    planes = _model(folder / "planes.json", _PlanesFile, _PlanesFile())
    known = _model(Path(truth), _TruthFile) if truth else None
    cuboids, cycles = folder / "cuboids.npz", folder / "cycles.npz"
    return Results(
        folder,
        surfaces.floor_z,
        surfaces.surfaces,
        walls.walls,
        trajectory,
        _model(folder / "graph.json", Graph, Graph()),
        objects.objects,
        objects.free,
        planes.cycles,
        _cuboids(cuboids) if cuboids.exists() else None,
        load_cycles(cycles) if cycles.exists() else None,
        _table(folder / "summary.json"),
        _table(folder / "timing.json"),
        (known or _model(folder / "truth.json", _TruthFile, _TruthFile(surfaces=()))).surfaces,
    )


EntryType = TypeVar("EntryType", bound=Entry)


def _model(path: Path, model: type[EntryType], missing: EntryType | None = None) -> EntryType:
    """Read one JSON file, or return `missing` if it is not there and need not be."""
    if missing is not None and not path.exists():
        return missing
    try:
        return model.model_validate(_json(path))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise MapError(f"{path}: damaged: {key or 'file'}: {first['msg'].lower()}") from None


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise MapError(f"{path}: no such file; is this a folder of results?") from None
    except (OSError, ValueError, RecursionError) as error:
        raise MapError(f"{path}: damaged: {one_line(error)}") from None


def _table(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    table = _json(path)
    if not isinstance(table, dict):
        raise MapError(f"{path}: damaged: an object is expected, found {type(table).__name__}")
    return table


def _trajectory(path: Path) -> Trajectory:
    try:
        text = path.read_text(encoding="utf-8")
        rows = [line.split() for line in text.splitlines() if line.strip() and line[0] != "#"]
        table = np.array(rows, float).reshape(len(rows), 8)
        poses = pose_from_quaternion(table[:, 1:4], table[:, 4:]) if rows else np.zeros((0, 4, 4))
    except FileNotFoundError:
        raise MapError(f"{path}: no such file; is this a folder of results?") from None
    except (OSError, ValueError) as error:
        raise MapError(f"{path}: damaged: {one_line(error)}") from None
    if not np.isfinite(table).all():
        raise MapError(f"{path}: damaged: a number is not finite")
    order = np.argsort(table[:, 0], kind="stable")
    return Trajectory(table[order, 0], poses[order])


def _cuboids(path: Path) -> FinalCuboids:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return _final(arrays)
    except KeyError as error:
        raise MapError(f"{path}: damaged: {one_line(error)}") from None
    except (OSError, ValueError, EOFError, IndexError, zipfile.BadZipFile, zlib.error) as error:
        raise MapError(f"{path}: damaged: {one_line(error)}") from None


def _final(arrays: Any) -> FinalCuboids:
    ix = arrays["ix"].astype(np.int64)
    n = len(ix)
    offsets, cycles = arrays["cycle_offsets"].astype(np.int64), arrays["cycles"].astype(np.int64)
    if len(offsets) != n + 1:
        raise ValueError("its arrays do not belong together")
    return FinalCuboids(
        float(arrays["cell_size"]),
        ix,
        arrays["iy"].astype(np.int64).reshape(n),
        _metres(arrays["bottom"]).reshape(n),
        _metres(arrays["top"]).reshape(n),
        arrays["count"].astype(float).reshape(n),
        arrays["mean"].astype(float).reshape(n, 3),
        arrays["cov"].astype(float).reshape(n, 6),
        cycles[offsets[1:] - 1] if n else np.zeros(0, np.int64),
    )


def _metres(heights: NDArray[Any]) -> NDArray[np.float64]:
    """Return heights in m: whole numbers are ticks."""
    return heights * TICK if heights.dtype.kind in "iu" else heights.astype(float)
