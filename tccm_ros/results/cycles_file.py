"""Write and read cycles.npz: the coarsened part map of every tilt cycle, for the report.

From it the report shows the integration map after any tilt cycle, the newest n part maps. Cells are
merged to at least `MIN_CELL_SIZE_M` and heights rounded outwards to centimetres, so that an hour of
mapping takes a few megabytes. ``cuboids.npz`` has the exact final map.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.atomic import write_output
from tccm_ros.cuboids.cuboids import TICKS_PER_M, Cuboids
from tccm_ros.errors import MapError, one_line
from tccm_ros.results.array_archive import array_archive, read_arrays

MIN_CELL_SIZE_M = 0.05
"""Minimum edge length of a coarse cell, m. Chosen: about a pixel of the report's view of a flat."""

MAX_CUBOIDS = 1_200_000
"""Maximum number of cuboids; cells grow until it is met. Chosen: 5 MB, smooth in a browser."""

TICKS_PER_CM = TICKS_PER_M // 100
MAX_MERGE_GAP_CM = 2
"""Coarse cuboids with a smaller vertical gap are merged, cm. Chosen: invisible at this scale."""

FORMAT = 1
"""Version of the file."""

MAX_INDEX = np.iinfo(np.int16).max
"""Maximum cell index and height in the file's integer type."""


@dataclass(frozen=True, slots=True, eq=False)
class CycleParts:
    """The coarse part maps of C cycles with N cuboids in all.

    Attributes
    ----------
    cell_size
        Edge length of a coarse cell, m.
    window
        Number of part maps in the integration map (``map.window_cycles``).
    cycles
        int32 (C,), increasing.
    stamps_ns
        int64 (C,).
    offsets
        int64 (C + 1,): cycle i has the cuboids ``offsets[i]:offsets[i + 1]``.
    ix, iy
        int16 (N,), coarse cell in the odometry frame, sorted by (ix, iy, bottom) in each cycle.
    bottom, top
        int16 (N,), cm.
    T_map_odom
        float64 (C, 4, 4), pose of the odometry frame in map at each cycle, after the last
        optimisation.
    """

    cell_size: float
    window: int
    cycles: Int32
    stamps_ns: Int64
    offsets: Int64
    ix: NDArray[np.int16]
    iy: NDArray[np.int16]
    bottom: NDArray[np.int16]
    top: NDArray[np.int16]
    T_map_odom: Float64

    def __len__(self) -> int:
        return len(self.cycles)


class CycleHistory:
    """Collects the part map of each tilt cycle, coarsened at once to save memory.

    Parameters
    ----------
    window
        Number of part maps in the integration map (``map.window_cycles``).
    """

    def __init__(self, window: int):
        self.window = window
        self._cell_size = MIN_CELL_SIZE_M
        self._cycles: list[int] = []
        self._stamps_ns: list[int] = []
        self._parts: list[Int64] = []

    def add(self, cycle: int, stamp_ns: int, part: Cuboids) -> None:
        """Append the part map of one tilt cycle.

        Parameters
        ----------
        cycle
            Number of the tilt cycle, larger than the previous ones.
        stamp_ns
            Stamp of the tilt cycle, ns.
        part
            Its part map, in the odometry frame.
        """
        factor = max(1, int(np.ceil(MIN_CELL_SIZE_M / part.cell_size - 1e-9)))
        self._cell_size = factor * part.cell_size
        self._cycles.append(cycle)
        self._stamps_ns.append(stamp_ns)
        self._parts.append(
            coarsen(
                part.ix.astype(np.int64) // factor,
                part.iy.astype(np.int64) // factor,
                part.bottom.astype(np.int64) // TICKS_PER_CM,
                -(-part.top.astype(np.int64) // TICKS_PER_CM),
            )
        )

    def parts(self, T_map_odom: Float64) -> CycleParts:
        """Return all cycles as one table.

        Parameters
        ----------
        T_map_odom
            float64 (C, 4, 4), one for each cycle. A cycle without cuboids has no pose of its own
            and gets the pose of the previous cycle (at the beginning, of the next).
        """
        parts, cell_size = self._parts, self._cell_size
        while _must_grow(parts):
            parts = [coarsen(p[0] // 2, p[1] // 2, p[2], p[3]) for p in parts]
            cell_size *= 2.0
        table = np.concatenate([np.zeros((4, 0), np.int64), *parts], axis=1)
        ix, iy, bottom, top = np.clip(table, -MAX_INDEX, MAX_INDEX).astype(np.int16)
        return CycleParts(
            cell_size,
            self.window,
            np.array(self._cycles, np.int32),
            np.array(self._stamps_ns, np.int64),
            np.cumsum([0, *(p.shape[1] for p in parts)], dtype=np.int64),
            ix,
            iy,
            bottom,
            top,
            _fill_poses(np.asarray(T_map_odom, float).reshape(len(parts), 4, 4), self._parts),
        )


def _fill_poses(T_map_odom: Float64, parts: list[Int64]) -> Float64:
    """Return the poses, with those of empty part maps replaced by a neighbour."""
    known = np.flatnonzero([part.shape[1] > 0 for part in parts])
    if len(known) == 0:
        return T_map_odom
    before = np.searchsorted(known, np.arange(len(parts)), side="right") - 1
    return T_map_odom[known[np.maximum(before, 0)]]


def _must_grow(parts: list[Int64]) -> bool:
    """Return whether the cells must grow to meet the limits of the file."""
    if sum(p.shape[1] for p in parts) > MAX_CUBOIDS:
        return True
    return any(p.size > 0 and np.abs(p[:2]).max() > MAX_INDEX for p in parts)


def coarsen(
    ix: Int64,
    iy: Int64,
    bottom: Int64,
    top: Int64,
) -> Int64:
    """Merge the intervals of each cell that touch or have a gap of at most `MAX_MERGE_GAP_CM`.

    Parameters
    ----------
    ix, iy, bottom, top
        int64 (N,): coarse cells, and intervals in cm; any order, cells may repeat.

    Returns
    -------
    int64 (4, M)
        Rows ix, iy, bottom, top, sorted by (ix, iy, bottom); the intervals of a cell are disjoint.
    """
    order = np.lexsort((top, bottom, iy, ix))
    ix, iy, bottom, top = ix[order], iy[order], bottom[order], top[order]
    if len(ix) == 0:
        return np.zeros((4, 0), np.int64)
    new_cell = np.r_[True, (np.diff(ix) != 0) | (np.diff(iy) != 0)]
    # A running maximum that restarts in each cell: every cell is shifted to its own value range.
    span = int(top.max() - top.min()) + 1
    base = np.cumsum(new_cell) * span - top.min()
    top_so_far = np.maximum.accumulate(top + base) - base
    starts = new_cell.copy()
    starts[1:] |= bottom[1:] > top_so_far[:-1] + MAX_MERGE_GAP_CM
    first = np.flatnonzero(starts)
    return np.stack([ix[first], iy[first], bottom[first], np.maximum.reduceat(top, first)])


def save_cycles(path: Path | str, parts: CycleParts) -> None:
    """Write cycles.npz; byte-identical for the same parts.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    arrays = {name: np.asarray(getattr(parts, name)) for name in CycleParts.__dataclass_fields__}
    write_output(path, array_archive({"format": np.asarray(FORMAT)} | arrays))


def load_cycles(path: Path | str) -> CycleParts:
    """Read cycles.npz.

    Raises
    ------
    MapError
        If the file is missing, damaged or of another version.
    """
    try:
        found = read_arrays(Path(path))
    except FileNotFoundError:
        raise MapError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise MapError(f"{path}: damaged ({one_line(error)})") from None
    missing = sorted({"format", *CycleParts.__dataclass_fields__} - set(found))
    if missing:
        raise MapError(f"{path}: damaged, '{missing[0]}' is missing")
    if int(found.pop("format")) != FORMAT:
        raise MapError(f"{path}: another version than {FORMAT}; write it again")
    cell_size, window = float(found.pop("cell_size")), int(found.pop("window"))
    parts = CycleParts(cell_size=cell_size, window=window, **found)
    _check(path, parts)
    return parts


def _check(path: Path | str, parts: CycleParts) -> None:
    count = len(parts.ix)
    same = all(len(a) == count for a in (parts.iy, parts.bottom, parts.top))
    whole = (
        len(parts.offsets) == len(parts) + 1
        and parts.offsets[0] == 0
        and parts.offsets[-1] == count
    )
    poses = parts.T_map_odom.shape == (len(parts), 4, 4) and len(parts.stamps_ns) == len(parts)
    if not (same and whole and poses and bool(np.all(np.diff(parts.offsets) >= 0))):
        raise MapError(f"{path}: damaged, its arrays have lengths that contradict each other")
