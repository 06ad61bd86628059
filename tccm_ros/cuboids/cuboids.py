"""Cuboids as arrays: the common form of part maps and integration maps for readers.

A cuboid is in cell (ix, iy) of edge `cell_size` and covers the heights [bottom, top]. Heights and
moments are in ticks of 0.1 mm, so that adding and subtracting points is exact (docs/design/tccm.md,
"Ticks").
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cuboids.caps import Caps, no_caps

TICKS_PER_M = 10_000
"""Ticks in a metre."""

TICK = 1.0 / TICKS_PER_M
"""One tick, m."""


def cell_keys(ix: ArrayLike, iy: ArrayLike) -> Int64:
    """Return int64 keys that sort cells by (ix, iy)."""
    return (np.asarray(ix, np.int64) << 32) + np.asarray(iy, np.int64)


def key_cells(keys: Int64) -> tuple[Int32, Int32]:
    """Return the cells int32 (ix, iy) of keys from `cell_keys`."""
    ix = (keys + 2**31) >> 32
    return ix.astype(np.int32), (keys - (ix << 32)).astype(np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """The geometry of N cuboids by cell: 12 bytes per cell and 8 per cuboid.

    Attributes
    ----------
    keys
        int64 (C,), occupied cells, ascending; see `cell_keys`.
    first
        int32 (C + 1,): the cuboids of cell i are ``spans[first[i]:first[i + 1]]``.
    spans
        int32 (N, 2), bottom and top, ticks; ascending within a cell.
    """

    keys: Int64
    first: Int32
    spans: Int32

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, bytes."""
        return self.keys.nbytes + self.first.nbytes + self.spans.nbytes


class CuboidArrays(NamedTuple):
    """The cuboids of a map, in the form for kernels.

    Attributes
    ----------
    ix, iy, bottom, top, s, S
        As in `Cuboids`.
    counts
        float64 (N,), number of points.
    cell, tick
        Edge of a cell in ticks, and length of a tick in m.
    """

    ix: Int32
    iy: Int32
    bottom: Int32
    top: Int32
    counts: Float64
    s: Float64
    S: Float64
    cell: float
    tick: float


@dataclass(frozen=True, slots=True, eq=False)
class Cuboids:
    """N cuboids, sorted by (ix, iy, bottom).

    Attributes
    ----------
    cell_size
        Edge of a cell, m.
    ix, iy
        int32 (N,), cell: floor(x / cell_size), floor(y / cell_size).
    bottom, top
        int32 (N,), ticks, bottom < top.
    count
        float64 (N,), number of points; fractional where a piece is part of a part map's cuboid.
    s
        float64 (N, 3), ticks: sum of (x - x_cell, y - y_cell, z), x_cell = rint(ix * cell_size).
    S
        float64 (N, 6), ticks^2: sums of the products xx xy xz yy yz zz of the same.
    cycles, cycle_offsets
        int32 (M,) and int64 (N + 1,): the ordered cycles (the paper's msnlist) of cuboid i are
        ``cycles[cycle_offsets[i]:cycle_offsets[i + 1]]``.
    caps
        Moments of the points at the tops, where known.
    """

    cell_size: float
    ix: Int32
    iy: Int32
    bottom: Int32
    top: Int32
    count: Float64
    s: Float64
    S: Float64
    cycles: Int32
    cycle_offsets: Int64
    caps: Caps = field(default_factory=no_caps)

    def __len__(self) -> int:
        return len(self.ix)

    @property
    def arrays(self) -> tuple[Any, ...]:
        """The fields of `CuboidArrays`, as a plain tuple, which numba passes in half the time."""
        return (
            *(self.ix, self.iy, self.bottom, self.top, self.count, self.s, self.S),
            *(self.cell_size * TICKS_PER_M, TICK),
        )

    @property
    def cell_origin(self) -> Float64:
        """Reference point of the moments, float64 (N, 3), ticks."""
        ticks = self.cell_size * TICKS_PER_M
        return np.stack(
            [np.rint(self.ix * ticks), np.rint(self.iy * ticks), np.zeros(len(self))], axis=1
        )

    def select(self, chosen: Bool) -> Cuboids:
        """Return the cuboids of a mask, bool (N,), in order; their caps are unknown."""
        lengths = np.diff(self.cycle_offsets)
        return Cuboids(
            self.cell_size,
            self.ix[chosen],
            self.iy[chosen],
            self.bottom[chosen],
            self.top[chosen],
            self.count[chosen],
            self.s[chosen],
            self.S[chosen],
            self.cycles[np.repeat(chosen, lengths)],
            np.concatenate([[0], np.cumsum(lengths[chosen])]).astype(np.int64),
        )

    def columns(self) -> Columns:
        """Return the geometry alone."""
        keys = cell_keys(self.ix, self.iy)
        begins = np.flatnonzero(np.diff(keys, prepend=keys[:1] - 1))
        first = np.append(begins, len(keys)).astype(np.int32)
        return Columns(keys[begins], first, np.column_stack([self.bottom, self.top]))

    def mean(self) -> Float64:
        """Return the mean of each cuboid's points, float64 (N, 3), m, in the map's frame."""
        return (self.s / self.count[:, None] + self.cell_origin) * TICK

    def cov(self) -> Float64:
        """Return P = S / N - p p^T (Eq. 2, sign restored), float64 (N, 6), m2: xx xy .. zz."""
        p = self.s / self.count[:, None]
        outer = np.stack([p[:, i] * p[:, j] for i in range(3) for j in range(i, 3)], axis=1)
        return (self.S / self.count[:, None] - outer) * TICK**2
