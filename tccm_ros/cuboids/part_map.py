"""Building part maps: scans are placed and binned as they come, so that little is left to do when
the cycle ends, namely to unite the intervals of each cell and to sum the moments.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.cuboids import bin_layout as layout
from tccm_ros.cuboids import binning
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.cuboids.part import PartMap, PartPoints
from tccm_ros.cuboids.tiles import TileState
from tccm_ros.cuboids.union import HISTOGRAM_SIZE, find_cuboids, sum_cuboids
from tccm_ros.errors import ConfigError
from tccm_ros.records import PosedScan

__all__ = ["PartMapBuilder", "cell_ticks"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_MAX_GEOMETRIES = 8
"""Scan geometries whose bearings are kept."""


def cell_ticks(config: Config) -> int:
    """Return the edge of a cell in ticks.

    Raises
    ------
    ConfigError
        If `map.cell_size` is not a whole number of ticks: cells and moments would not be exact.
    """
    ticks = round(config.map.cell_size * TICKS_PER_M)
    if abs(ticks - config.map.cell_size * TICKS_PER_M) > 1e-6:
        raise ConfigError(
            f"map.cell_size: a multiple of 0.0001 m is expected, found {config.map.cell_size}"
        )
    return ticks


class PartMapBuilder:
    """Collects the scans of one cycle after another.

    Parameters
    ----------
    config
        Group `map`.
    """

    def __init__(self, config: Config) -> None:
        self._config = config.map
        depth = max(round(config.map.cuboid_depth * TICKS_PER_M), 1)
        adaptive = config.map.gap == "adaptive"
        self._as_printed = config.map.mode == "paper"
        self._limits = np.zeros(layout.N_LIMITS)
        self._limits[: layout.REGION_IN] = (
            TICKS_PER_M,
            cell_ticks(config),
            depth,
            config.map.gap_factor if adaptive else 0.0,
            max(depth, round(config.map.max_depth * TICKS_PER_M)) if adaptive else depth,
        )
        self.set_region(config.map.region)
        self._state = TileState()
        self._work = np.zeros(layout.WORK_SIZE, np.int32)
        self._directions: dict[tuple[float, float, int], Float32] = {}
        self._scratch: _Scratch | None = None
        self._stamps: list[int] = []
        self._ends: list[int] = []
        self._at_most = 0

    def set_region(self, region: tuple[float, ...] | None) -> None:
        """Set the region of interest, in `map.region_frame`, m; None for all."""
        in_base = self._config.region_frame == "base"
        where = layout.REGION_IN_BASE if in_base else layout.REGION_IN_ODOM
        self._limits[layout.REGION_IN] = layout.NO_REGION if region is None else where
        if region is not None:
            self._limits[layout.REGION : layout.NORMAL] = region

    @property
    def points(self) -> int:
        """Points binned since the last `close`."""
        return self._state.points

    @property
    def scans(self) -> int:
        """Scans added since the last `close`."""
        return len(self._stamps)

    def add(self, posed: PosedScan, keep: Bool, first: int = 0, last: int | None = None) -> None:
        """Place and bin beams of a scan.

        Parameters
        ----------
        posed
            The scan with its poses.
        keep
            bool (N,), the valid beams.
        first, last
            The beams [first, last) belong to this cycle; all by default.
        """
        scan, state = posed.scan, self._state
        n = len(scan.ranges)
        self._make_room(n)
        directions = self._bearings(scan.angle_min, scan.angle_increment, n)
        knots, T_odom_base, T_base_laser = posed.knots_ns, posed.T_odom_base, posed.T_base_laser
        if scan.time_increment < 0.0:
            knots = np.ascontiguousarray(knots[::-1])
            T_odom_base = np.ascontiguousarray(T_odom_base[::-1])
            T_base_laser = np.ascontiguousarray(T_base_laser[::-1])
        ranges, end = _writable(scan.ranges), n if last is None else last
        while True:
            points = binning.bin_scan(
                ranges, keep, directions, knots, scan.stamp_ns, scan.time_increment * 1e9,
                T_odom_base, T_base_laser, self._limits, first, end,
                abs(scan.angle_increment), self._work,
                state.records, state.directory, state.counts, state.bits, state.meta,
            )  # fmt: skip
            if points >= 0:
                break
            first = state.next_beam
            state.grow(points)
        self._end_scan(scan.stamp_ns, points)

    def add_points(self, points: Float64, stamp_ns: int = 0) -> None:
        """Bin points that are already in the map's frame, with the depth `map.cuboid_depth`.

        Parameters
        ----------
        points
            float64 (N, 3), m; points that are not finite are left out, the region is not asked.
        stamp_ns
            Their time.
        """
        n, state, first = len(points), self._state, 0
        self._make_room(n)
        flat = _writable(np.asarray(points, np.float64)).reshape(-1)
        while True:
            count = binning.bin_points(
                flat, self._limits, first, self._work,
                state.records, state.directory, state.counts, state.bits, state.meta,
            )  # fmt: skip
            if count >= 0:
                break
            first = state.next_beam
            state.grow(count)
        self._end_scan(stamp_ns, count)

    def close(self, cycle: int, start_ns: int, end_ns: int) -> PartMap:
        """Return the part map of what was added, and begin anew.

        Parameters
        ----------
        cycle
            Its number.
        start_ns, end_ns
            Time of the first and of the last used beam.
        """
        state, n = self._state, self._state.points
        scratch = self._scratch_for(n)
        n_cells = binning.list_cells(
            state.directory, state.counts, state.bits, state.meta,
            scratch.cells, scratch.starts, scratch.addresses,
        )  # fmt: skip
        points = np.empty((n, 2), np.int64)
        k = find_cuboids(
            state.records, n, *state.heights, np.array(self._ends, np.int32), n_cells,
            scratch.cells, scratch.starts, scratch.addresses, state.counts, self._as_printed,
            scratch.pairs, scratch.spare, scratch.histogram, scratch.order, scratch.scans,
            points.reshape(-1), scratch.begins, scratch.keys, scratch.bounds, scratch.firsts,
        )  # fmt: skip
        sums, seen = np.empty((n - k, 10), np.int64), np.empty((n - k, 2), np.int64)
        stamps = np.array(self._stamps, np.int64)
        sum_cuboids(
            points.reshape(-1), n, scratch.begins, stamps, sums.reshape(-1), seen.reshape(-1)
        )
        state.clear(listed=True)
        self._begin()
        return PartMap(
            cycle,
            start_ns,
            end_ns,
            self._config.cell_size,
            keys=scratch.keys[k:n].copy(),
            bounds=scratch.bounds[2 * k : 2 * n].reshape(-1, 2).copy(),
            moments=sums,
            seen_ns=seen,
            points=PartPoints(points, scratch.firsts[k:n].copy()),
        )

    def clear(self) -> None:
        """Forget what was added since the last `close`."""
        self._state.clear(listed=False)
        self._begin()

    def _begin(self) -> None:
        self._limits[layout.HAS_NORMAL] = 0.0
        self._stamps, self._ends, self._at_most = [], [], 0

    def _end_scan(self, stamp_ns: int, points: int) -> None:
        self._stamps.append(stamp_ns)
        self._ends.append(points)

    def _make_room(self, n: int) -> None:
        self._at_most += n
        if self._at_most > self._state.room:
            self._at_most = self._state.points + n
            self._state.make_room(self._at_most)

    def _scratch_for(self, n: int) -> _Scratch:
        if self._scratch is None or len(self._scratch.keys) < n:
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
    """Room for `n` cells and cuboids, kept from cycle to cycle."""

    def __init__(self, n: int) -> None:
        self.cells, self.keys = np.zeros(n, np.int64), np.zeros(n, np.int64)
        self.starts, self.addresses = np.zeros(n + 1, np.int32), np.zeros(n, np.int32)
        self.pairs, self.spare = np.zeros(n, np.uint64), np.zeros(n, np.uint64)
        self.histogram = np.zeros(HISTOGRAM_SIZE, np.int64)
        self.order, self.scans = np.zeros(n, np.int32), np.zeros(n, np.int32)
        self.begins = np.zeros(n + 1, np.int8)
        self.bounds, self.firsts = np.zeros(2 * n, np.int32), np.zeros(n, np.int32)


def _writable(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array for which kernels are compiled: read-only ones would need their own."""
    flags = array.flags
    return array if flags.writeable and flags.c_contiguous else array.copy()
