"""The part map of one tilt cycle, and its builder (sections III.A and III.B of the paper).

Scans are projected and binned as they arrive. At the end of the tilt cycle, the intervals of each
cell are merged and the moments summed (docs/design/tccm.md, "Part map").
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Bool, Float32, Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids import binning
from tccm_ros.cuboids.beam_endpoints import SETTINGS, WORK_SIZE, RegionFrame
from tccm_ros.cuboids.caps import Caps, no_caps, sum_caps
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, Cuboids, key_cells
from tccm_ros.cuboids.tiles import BinnedPoints
from tccm_ros.cuboids.union import (
    DIGITS,
    UNION,
    CuboidRule,
    gather_points,
    mark_cells,
    sort_cells,
    sum_cuboids,
)
from tccm_ros.errors import ConfigError
from tccm_ros.records import PosedScan

_LOW = np.int64(0xFFFFFFFF)

_MAX_GEOMETRIES = 8
"""Number of scan geometries with cached bearings. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class PartPoints:
    """The points of a part map, in the order of the cuboids.

    Attributes
    ----------
    packed
        int64 (M, 2): z in ticks and position within the cell, ``z << 32 | x << 16 | y``; depth in
        ticks and number of the scan within the tilt cycle, ``depth << 32 | scan``.
    first
        int32 (N,), first point of each cuboid; the points of a cuboid are contiguous.
    """

    packed: Int64
    first: Int32

    def __len__(self) -> int:
        return len(self.packed)


@dataclass(frozen=True, slots=True, eq=False)
class PartMap:
    """The cuboids of one tilt cycle, sorted by (ix, iy, bottom); immutable.

    Attributes
    ----------
    cycle
        Number of the cycle.
    start_ns, end_ns
        Times of the first and the last used beam.
    cell_size
        Edge of a cell, m.
    keys
        int64 (N,), cells, see `cuboids.cell_keys`.
    bounds
        int32 (N, 2), bottom and top, ticks.
    moments
        int64 (N, 10): count; sums of x, y, z; sums of xx xy xz yy yz zz; in ticks, x and y from the
        cell's lower corner.
    seen_ns
        int64 (N, 2), stamps of the first and the last scan that measured the cuboid.
    void_keys, void_bounds
        int64 (V,) and int32 (V, 2), as `keys` and `bounds`: where beams of this tilt cycle passed
        through cuboids of older part maps, which are removed there (`clearing`).
    points
        The points; None if they are not kept.
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
        """Return the part map with its times only, for histories of bounded memory."""
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
        """Return the part map without its points."""
        return self if self.points is None else replace(self, points=None)

    def point_cuboids(self) -> Int32:
        """Return the index of each point's cuboid, int32 (M,)."""
        if self.points is None:
            return np.zeros(0, np.int32)
        return np.repeat(np.arange(len(self), dtype=np.int32), self.moments[:, 0])

    def lines(self, chosen: Int64) -> Int64:
        """Return the scan number in the cycle of points with indices int64 (K,)."""
        if self.points is None:
            return np.zeros(0, np.int64)
        return self.points.packed[chosen, 1] & _LOW

    def positions(self, chosen: Bool | Int64 | None = None) -> Float64:
        """Return the positions of the points, in the order of `point_cuboids`.

        Parameters
        ----------
        chosen
            bool (M,) or indices of the points; all by default.

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
        """Return the part map as cuboids."""
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
        """Return the caps of the cuboids; unknown if the points are not kept."""
        if self.points is None:
            return no_caps()
        n = len(self)
        of, sums = np.empty(n, np.int32), np.zeros((n + 1, 10))
        caps = sum_caps(
            self.points.packed, self.moments[:, 0], self.points.first, self.bounds[:, 1], of, sums
        )
        return Caps(of, sums[:caps])


def _cell_ticks(config: Config) -> int:
    """Return the edge of a cell in ticks.

    Raises
    ------
    ConfigError
        If `map.cell_size` is not a multiple of a tick: cells and moments would not be exact.
    """
    ticks = round(config.map.cell_size * TICKS_PER_M)
    if abs(ticks - config.map.cell_size * TICKS_PER_M) > 1e-6:
        raise ConfigError(
            f"map.cell_size: a multiple of 0.0001 m is expected, found {config.map.cell_size}"
        )
    return ticks


class PartMapBuilder:
    """Builds the part maps of one cycle after another.

    Parameters
    ----------
    config
        Group `map`.
    rule
        Rule that turns points into cuboids; `baselines.union_as_printed` has another one.
    """

    def __init__(self, config: Config, rule: CuboidRule = UNION) -> None:
        self._config = config.map
        self._rule = rule
        adaptive = config.map.gap == "adaptive"
        depth = max(round(config.map.cuboid_depth * TICKS_PER_M), 1)
        self._settings = np.zeros(1, SETTINGS)
        own = self._settings[0]
        own["ticks"], own["cell_ticks"], own["depth"] = TICKS_PER_M, _cell_ticks(config), depth
        own["depth_per_range"] = config.map.gap_factor if adaptive else 0.0
        own["max_depth"] = (
            max(depth, round(config.map.max_depth * TICKS_PER_M)) if adaptive else depth
        )
        self.set_region(config.map.region)
        self._tiles = BinnedPoints()
        self._work = np.zeros(WORK_SIZE, np.int32)
        self._directions: dict[tuple[float, float, int], Float32] = {}
        self._scratch: _Scratch | None = None
        self._stamps: list[int] = []
        self._ends: list[int] = []
        self._max_points = 0

    def set_region(self, region: tuple[float, ...] | None) -> None:
        """Set the region of interest, in `map.region_frame`, m; None for no limit."""
        frame = RegionFrame.BASE if self._config.region_frame == "base" else RegionFrame.ODOM
        self._settings["region_frame"] = RegionFrame.NONE if region is None else frame
        if region is not None:
            self._settings["region"] = region

    @property
    def points(self) -> int:
        """Number of points binned since the last `close`."""
        return self._tiles.points

    @property
    def scans(self) -> int:
        """Number of scans added since the last `close`."""
        return len(self._stamps)

    def add(self, posed: PosedScan, keep: Bool, first: int = 0, last: int | None = None) -> None:
        """Project and bin the beams of a scan.

        Parameters
        ----------
        posed
            A posed scan.
        keep
            bool (N,), mask of the valid beams.
        first, last
            Range of beams [first, last) in this tilt cycle; all by default.
        """
        scan, tiles = posed.scan, self._tiles
        n = len(scan.ranges)
        self._make_room(n)
        stamps, T_odom_base, T_base_laser = (
            posed.pose_stamps_ns,
            posed.T_odom_base,
            posed.T_base_laser,
        )
        if scan.time_increment < 0.0:
            stamps = np.ascontiguousarray(stamps[::-1])
            T_odom_base = np.ascontiguousarray(T_odom_base[::-1])
            T_base_laser = np.ascontiguousarray(T_base_laser[::-1])
        poses = stamps, scan.stamp_ns, scan.time_increment * 1e9, T_odom_base, T_base_laser
        ranges, end = _writable(scan.ranges), n if last is None else last
        directions = self._bearings(scan.angle_min, scan.angle_increment, n)
        while True:
            beams = ranges, keep, directions, first, end, abs(scan.angle_increment)
            points = binning.bin_scan(beams, poses, self._settings, self._work, tiles.arrays)
            if points >= 0:
                break
            first = tiles.next_beam
            tiles.grow(points)
        self._end_scan(scan.stamp_ns, points)

    def add_points(self, points: Float64, stamp_ns: int = 0, gaps: Float64 | None = None) -> None:
        """Bin points in the map's frame.

        Parameters
        ----------
        points
            float64 (N, 3), m; points that are not finite are left out, the region is ignored.
        stamp_ns
            Stamp of the points.
        gaps
            float64 (N,), distance to the next scan line, m: with `map.gap adaptive`, the depth of a
            point grows with it; without, all points have `map.cuboid_depth`.
        """
        n, tiles, first = len(points), self._tiles, 0
        self._make_room(n)
        flat = _writable(np.asarray(points, np.float64)).reshape(-1)
        gaps = np.zeros(0) if gaps is None else _writable(np.asarray(gaps, np.float64))
        while True:
            count = binning.bin_points(flat, gaps, first, self._settings, self._work, tiles.arrays)
            if count >= 0:
                break
            first = tiles.next_beam
            tiles.grow(count)
        self._end_scan(stamp_ns, count)

    def close(self, cycle: int, start_ns: int, end_ns: int) -> PartMap:
        """Return the part map of the scans added since the last `close`.

        Parameters
        ----------
        cycle
            Number of the cycle.
        start_ns, end_ns
            Times of the first and the last used beam.
        """
        tiles, n = self._tiles, self._tiles.points
        records, _, counts, _, _ = tiles.arrays
        scratch = self._scratch_for(n)
        cells, starts, addresses = scratch.cells
        begins, (keys, bounds, firsts) = scratch.begins, scratch.found
        n_cells = binning.list_cells(tiles.arrays, cells, starts, addresses)
        packed = np.empty((n, 2), np.int64)
        points = packed.reshape(-1)
        gather_points(records, np.array(self._ends, np.int32), counts, points)
        if self._rule.is_by_height:
            sort_cells(points, starts, n_cells, scratch.sorting)
        mark_cells(starts, n_cells, addresses, counts, begins)
        k = self._rule.merge(points, n, begins, cells, n_cells, scratch.found)
        moments, seen = np.empty((n - k, 10), np.int64), np.empty((n - k, 2), np.int64)
        stamps = np.array(self._stamps, np.int64)
        sum_cuboids(points, n, begins, stamps, moments.reshape(-1), seen.reshape(-1))
        tiles.clear(listed=True)
        self._begin()
        return PartMap(
            cycle,
            start_ns,
            end_ns,
            self._config.cell_size,
            keys=keys[k:n].copy(),
            bounds=bounds[2 * k : 2 * n].reshape(-1, 2).copy(),
            moments=moments,
            seen_ns=seen,
            points=PartPoints(packed, firsts[k:n].copy()),
        )

    def clear(self) -> None:
        """Discard the scans added since the last `close`."""
        self._tiles.clear(listed=False)
        self._begin()

    def _begin(self) -> None:
        self._settings["has_normal"] = False
        self._stamps, self._ends, self._max_points = [], [], 0

    def _end_scan(self, stamp_ns: int, points: int) -> None:
        self._stamps.append(stamp_ns)
        self._ends.append(points)

    def _make_room(self, n: int) -> None:
        self._max_points += n
        if self._max_points > self._tiles.room:
            self._max_points = self._tiles.points + n
            self._tiles.make_room(self._max_points)

    def _scratch_for(self, n: int) -> _Scratch:
        if self._scratch is None or self._scratch.room < n:
            self._scratch = _Scratch(2 * n)
        return self._scratch

    def _bearings(self, angle_min: float, angle_increment: float, n: int) -> Float32:
        key = (angle_min, angle_increment, n)
        found = self._directions.get(key)
        if found is None:
            if len(self._directions) >= _MAX_GEOMETRIES:
                self._directions.clear()
            bearings = angle_min + angle_increment * np.arange(n)
            found = np.stack([np.cos(bearings), np.sin(bearings)]).astype(np.float32)
            self._directions[key] = found
        return found


class _Scratch:
    """Scratch arrays for `room` points, cells and cuboids, reused in each cycle."""

    def __init__(self, room: int) -> None:
        n, self.room = room, room
        self.cells = np.zeros(n, np.int64), np.zeros(n + 1, np.int32), np.zeros(n, np.int32)
        histogram = np.zeros(DIGITS, np.int64)
        self.sorting = np.zeros(n, np.uint64), np.zeros(n, np.uint64), histogram
        self.begins = np.zeros(n + 1, np.int8)
        self.found = np.zeros(n, np.int64), np.zeros(2 * n, np.int32), np.zeros(n, np.int32)


def _writable(array: NDArray[Any]) -> NDArray[Any]:
    """Return a writable array; kernels are not compiled for read-only ones."""
    flags = array.flags
    return array if flags.writeable and flags.c_contiguous else array.copy()
