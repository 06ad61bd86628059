"""The arrays that `binning` counts points in, and how they grow."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.cuboids import bin_layout as layout

__all__ = ["TileState"]

_FIRST_SLOTS = 16
"""Tiles that there is room for at first."""

_TILE_MARGIN = 6
"""Tiles that the directory covers beyond what asked for it."""


_NO_HEIGHTS = 2**40, -(2**40)


class TileState:
    """Binned points, scan by scan.

    Attributes
    ----------
    records, directory, counts, bits, meta
        See `binning.bin_scan`.
    room
        Points that there is room for.
    """

    def __init__(self) -> None:
        self.room = 1 << 15
        self.records: NDArray[np.int64] = np.zeros(2 * self.room, np.int64)
        self.directory: NDArray[np.int32] = np.zeros(0, np.int32)
        self.counts: NDArray[np.int32] = np.zeros(_FIRST_SLOTS * layout.CELLS_PER_TILE, np.int32)
        self.bits: NDArray[np.uint64] = np.zeros(_FIRST_SLOTS * layout.TILE, np.uint64)
        self.meta: NDArray[np.int64] = np.zeros(layout.N_META, np.int64)
        self.meta[layout.LOWEST], self.meta[layout.HIGHEST] = _NO_HEIGHTS

    @property
    def points(self) -> int:
        """Points binned so far."""
        return int(self.meta[layout.N_POINTS])

    @property
    def next_beam(self) -> int:
        """Beam at which the kernel stopped."""
        return int(self.meta[layout.NEXT_BEAM])

    @property
    def heights(self) -> tuple[int, int]:
        """The least and the greatest height so far, ticks; (0, 0) without points."""
        if self.points == 0:
            return 0, 0
        return int(self.meta[layout.LOWEST]), int(self.meta[layout.HIGHEST])

    def make_room(self, count: int) -> None:
        """Make room for so many points in all."""
        if count > self.room:
            records = np.zeros(4 * count, np.int64)
            records[: 2 * self.points] = self.records[: 2 * self.points]
            self.records, self.room = records, 2 * count

    def grow(self, wanted: int) -> None:
        """Give the kernel what it asked for."""
        if wanted == layout.GROW_TILES:
            self._grow_directory()
        else:
            self.counts = _doubled(self.counts)
            self.bits = _doubled(self.bits)

    def clear(self, *, listed: bool) -> None:
        """Forget all points; `listed` if counts and bits are already back at zero."""
        meta = self.meta
        slots = int(meta[layout.N_SLOTS])
        if not listed:
            self.counts[: slots * layout.CELLS_PER_TILE] = 0
            self.bits[: slots * layout.TILE] = 0
        self.directory[:] = -1
        meta[layout.N_POINTS] = meta[layout.N_SLOTS] = 0
        meta[layout.LOWEST], meta[layout.HIGHEST] = _NO_HEIGHTS

    def _grow_directory(self) -> None:
        """Cover the box of tiles that was asked for, and what is in use."""
        meta = self.meta
        x0, x1, y0, y1 = (int(v) for v in meta[layout.BOX_X0 : layout.LOWEST])
        slots = int(meta[layout.N_SLOTS])
        old_x0, old_y0 = int(meta[layout.TILE_X0]), int(meta[layout.TILE_Y0])
        old_nx, old_ny = int(meta[layout.TILES_X]), int(meta[layout.TILES_Y])
        x0, x1 = x0 - _TILE_MARGIN, x1 + _TILE_MARGIN + 1
        y0, y1 = y0 - _TILE_MARGIN, y1 + _TILE_MARGIN + 1
        if slots:
            x0, x1 = min(x0, old_x0), max(x1, old_x0 + old_nx)
            y0, y1 = min(y0, old_y0), max(y1, old_y0 + old_ny)
        n_x, n_y = x1 - x0, y1 - y0
        directory = np.full((n_x, n_y), -1, np.int32)
        if slots:
            left, low = old_x0 - x0, old_y0 - y0
            old = self.directory.reshape(old_nx, old_ny)
            directory[left : left + old_nx, low : low + old_ny] = old
        self.directory = directory.reshape(-1)
        meta[layout.TILE_X0 : layout.TILES_Y + 1] = x0, y0, n_x, n_y


def _doubled(array: Any) -> Any:
    return np.concatenate([array, np.zeros_like(array)])
