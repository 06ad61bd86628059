"""The part map of one tilt cycle (section III.A, III.B of the paper; DESIGN section 6)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tccm_ros.cuboids.caps import Caps, no_caps, sum_caps
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, Cuboids

__all__ = ["PartMap", "PartPoints", "cell_keys", "key_cells"]

Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Float64 = NDArray[np.float64]

_LOW = np.int64(0xFFFFFFFF)


def cell_keys(ix: ArrayLike, iy: ArrayLike) -> Int64:
    """Return int64 keys that sort cells by (ix, iy)."""
    return (np.asarray(ix, np.int64) << 32) + np.asarray(iy, np.int64)


def key_cells(keys: Int64) -> tuple[Int32, Int32]:
    """Return the cells int32 (ix, iy) of keys made by `cell_keys`."""
    ix = (keys + 2**31) >> 32
    return ix.astype(np.int32), (keys - (ix << 32)).astype(np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class PartPoints:
    """The points of a part map, in the order of the cuboids.

    Attributes
    ----------
    packed
        int64 (M, 2): z in ticks and place within the cell, ``z << 32 | x << 16 | y``; depth in
        ticks and number of the scan within the cycle, ``depth << 32 | scan``.
    first
        int32 (N,), first point of each cuboid; a cuboid's points follow each other.
    """

    packed: Int64
    first: Int32

    def __len__(self) -> int:
        return len(self.packed)


@dataclass(frozen=True, slots=True, eq=False)
class PartMap:
    """The cuboids of one cycle, sorted by (ix, iy, bottom). Never changed once made.

    Attributes
    ----------
    cycle
        Number of the cycle.
    start_ns, end_ns
        Time of the first and of the last used beam.
    cell_size
        Edge of a cell, m.
    keys
        int64 (N,), cells, see `cell_keys`.
    bounds
        int32 (N, 2), bottom and top, ticks.
    moments
        int64 (N, 10): count; sums of x, y, z; sums of xx xy xz yy yz zz; in ticks, x and y from the
        cell's lower corner.
    seen_ns
        int64 (N, 2), stamps of the first and the last scan that measured the cuboid.
    void_keys, void_bounds
        int64 (V,) and int32 (V, 2), as `keys` and `bounds`: where this cycle saw through what older
        cycles had measured; it takes their cuboids there away (`clearing`).
    points
        The points, or None where they are not kept.
    """

    cycle: int
    start_ns: int
    end_ns: int
    cell_size: float
    keys: Int64
    bounds: Int32
    moments: Int64
    seen_ns: Int64
    void_keys: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    void_bounds: Int32 = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    points: PartPoints | None = None

    def __len__(self) -> int:
        return len(self.keys)

    def without_cuboids(self) -> PartMap:
        """Return the cycle's times alone, for histories that must not grow."""
        return PartMap(
            self.cycle,
            self.start_ns,
            self.end_ns,
            self.cell_size,
            self.keys[:0].copy(),
            self.bounds[:0].copy(),
            self.moments[:0].copy(),
            self.seen_ns[:0].copy(),
        )

    def without_points(self) -> PartMap:
        """Return the same part map without its points."""
        return self if self.points is None else replace(self, points=None)

    def point_cuboids(self) -> Int32:
        """Return the index of each point's cuboid, int32 (M,)."""
        if self.points is None:
            return np.zeros(0, np.int32)
        return np.repeat(np.arange(len(self), dtype=np.int32), self.moments[:, 0])

    def lines(self, chosen: Int64) -> Int64:
        """Return the number of the scan of some points (indices, int64 (K,)) within the cycle."""
        if self.points is None:
            return np.zeros(0, np.int64)
        return self.points.packed[chosen, 1] & _LOW

    def positions(self, chosen: NDArray[np.bool_] | Int64 | None = None) -> Float64:
        """Return the positions of the points, in the order of `point_cuboids`.

        Parameters
        ----------
        chosen
            bool (M,) or indices, which points; all by default.

        Returns
        -------
        float64 (M, 3), m, in the map's frame; rounded to ticks.
        """
        if self.points is None:
            return np.zeros((0, 3))
        cuboid, packed = self.point_cuboids(), self.points.packed
        if chosen is not None:
            cuboid, packed = cuboid[chosen], packed[chosen]
        ix, iy = key_cells(self.keys[cuboid])
        cell = round(self.cell_size * TICKS_PER_M)
        word = packed[:, 0]
        x = ix.astype(np.int64) * cell + ((word >> 16) & 0xFFFF)
        y = iy.astype(np.int64) * cell + (word & 0xFFFF)
        return np.stack([x, y, word >> 32], axis=1) * TICK

    def cuboids(self) -> Cuboids:
        """Return the part map alone as cuboids."""
        ix, iy = key_cells(self.keys)
        n = len(self)
        return Cuboids(
            cell_size=self.cell_size,
            ix=ix,
            iy=iy,
            bottom=np.ascontiguousarray(self.bounds[:, 0]),
            top=np.ascontiguousarray(self.bounds[:, 1]),
            count=self.moments[:, 0].astype(np.float64),
            s=self.moments[:, 1:4].astype(np.float64),
            S=self.moments[:, 4:].astype(np.float64),
            cycles=np.full(n, self.cycle, np.int32),
            cycle_offsets=np.arange(n + 1, dtype=np.int64),
            caps=self.caps(),
        )

    def caps(self) -> Caps:
        """Return the caps of the cuboids; none are known where the points are not kept."""
        if self.points is None:
            return no_caps()
        n = len(self)
        of, sums = np.empty(n, np.int32), np.zeros((n + 1, 10))
        caps = sum_caps(
            self.points.packed, self.moments[:, 0], self.points.first, self.bounds[:, 1], of, sums
        )
        return Caps(of, sums[:caps])
