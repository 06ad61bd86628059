"""Binned points: counts per cell in tiles of 64 x 64 cells, allocated where points are.

Memory thus grows with the number of observed cells, not with their bounding box. A cell's address
is ``slot * 4096 + x * 64 + y``; a bitmap of the counted cells allows listing them in order without
sorting.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Int32, Int64

TILE = 64
"""Cells along a tile's edge: one row is one word of the bitmap."""

CELLS_PER_TILE = TILE * TILE

GROW_TILES, GROW_SLOTS = -1, -2
"""Codes of the array to enlarge before `binning` can continue."""

_FIRST_SLOTS = 16
"""Initial number of tiles. Chosen."""

_TILE_MARGIN = 6
"""Margin of the directory around the tiles in use, tiles. Chosen."""

_COUNTERS = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("points", "slots", "next_beam"),
            *("tile_x0", "tile_y0", "tiles_x", "tiles_y"),
            *("box_x0", "box_x1", "box_y0", "box_y1"),
        )
    ]
)
"""Counters of kernels: points, tiles in use, and the beam at which they stopped; first tile and
shape of the directory; bounding box of tiles that it must cover."""


class Tiles(NamedTuple):
    """Arrays in which kernels count points.

    Attributes
    ----------
    records
        int64 (2 M,), two words per point: ``z << 32 | x << 16 | y`` within the cell, and ``depth <<
        32 | address``.
    directory
        int32, slot of each tile or -1; row-major along y.
    counts
        int32, points per address.
    bits
        uint64, bitmap of the addresses with points.
    counters
        Array with one element of `_COUNTERS`; kernels use ``counters[0]``.
    """

    records: Int64
    directory: Int32
    counts: Int32
    bits: NDArray[np.uint64]
    counters: NDArray[Any]


class BinnedPoints:
    """Binned points, scan by scan, in growing arrays.

    Attributes
    ----------
    room
        Number of points that fit in the arrays.
    """

    def __init__(self) -> None:
        self.room = 1 << 15
        self._records = np.zeros(2 * self.room, np.int64)
        self._directory: Int32 = np.zeros(0, np.int32)
        self._counts = np.zeros(_FIRST_SLOTS * CELLS_PER_TILE, np.int32)
        self._bits = np.zeros(_FIRST_SLOTS * TILE, np.uint64)
        self._counters = np.zeros(1, _COUNTERS)

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """The fields of `Tiles`, as a plain tuple, which numba passes in half the time."""
        return self._records, self._directory, self._counts, self._bits, self._counters

    @property
    def points(self) -> int:
        """Number of points binned so far."""
        return int(self._counters["points"][0])

    @property
    def next_beam(self) -> int:
        """Index of the beam at which the kernel stopped."""
        return int(self._counters["next_beam"][0])

    def make_room(self, count: int) -> None:
        """Make room for a total number of points."""
        if count > self.room:
            records = np.zeros(4 * count, np.int64)
            records[: 2 * self.points] = self._records[: 2 * self.points]
            self._records, self.room = records, 2 * count

    def grow(self, wanted: int) -> None:
        """Enlarge the array with a code from a kernel: `GROW_TILES` or `GROW_SLOTS`."""
        if wanted == GROW_TILES:
            self._grow_directory()
        else:
            self._counts, self._bits = _doubled(self._counts), _doubled(self._bits)

    def clear(self, *, listed: bool) -> None:
        """Clear all points; `listed` if counts and bits are already zero."""
        slots = int(self._counters["slots"][0])
        if not listed:
            self._counts[: slots * CELLS_PER_TILE] = 0
            self._bits[: slots * TILE] = 0
        self._directory[:] = -1
        self._counters[["points", "slots"]] = 0

    def _grow_directory(self) -> None:
        """Extend the directory to the bounding box in the counters and to the tiles in use."""
        c: Any = self._counters[0]
        x0, x1 = c["box_x0"] - _TILE_MARGIN, c["box_x1"] + _TILE_MARGIN + 1
        y0, y1 = c["box_y0"] - _TILE_MARGIN, c["box_y1"] + _TILE_MARGIN + 1
        if c["slots"]:
            x0, x1 = min(x0, c["tile_x0"]), max(x1, c["tile_x0"] + c["tiles_x"])
            y0, y1 = min(y0, c["tile_y0"]), max(y1, c["tile_y0"] + c["tiles_y"])
        directory = np.full((x1 - x0, y1 - y0), -1, np.int32)
        if c["slots"]:
            left, low = c["tile_x0"] - x0, c["tile_y0"] - y0
            old = self._directory.reshape(c["tiles_x"], c["tiles_y"])
            directory[left : left + len(old), low : low + old.shape[1]] = old
        self._directory = directory.reshape(-1)
        c["tile_x0"], c["tile_y0"], c["tiles_x"], c["tiles_y"] = x0, y0, x1 - x0, y1 - y0


def _doubled(array: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([array, np.zeros_like(array)])
