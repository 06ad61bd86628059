"""Building part maps: scans are placed and binned as they come, so that little is left to do when
the cycle ends, namely to unite the intervals of each cell and to sum the moments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.errors import ConfigError
from tccm_ros.mapping import binning
from tccm_ros.mapping.cuboids import TICKS_PER_M
from tccm_ros.mapping.part import PartMap, PartPoints
from tccm_ros.mapping.tile_state import TileState
from tccm_ros.mapping.union import (
    MAX_BINS,
    finish_cuboids,
    gather_points,
    unite_cells,
    unite_cells_as_printed,
)
from tccm_ros.records import PosedScan

__all__ = ["PartMapBuilder", "cell_ticks"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_NOWHERE = np.zeros(3)

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
        self._depth = depth
        self._limits = np.zeros(binning.N_LIMITS)
        self._limits[: binning.REGION_IN] = (
            TICKS_PER_M,
            cell_ticks(config),
            depth,
            config.map.gap_factor if adaptive else 0.0,
            max(depth, round(config.map.max_depth * TICKS_PER_M)) if adaptive else depth,
        )
        self.set_region(config.map.region)
        self._state = TileState()
        self._work = np.zeros((4, 0), np.float32)
        self._directions: dict[tuple[float, float, int], Float32] = {}
        self._bins = np.zeros(MAX_BINS, np.int64)
        self._scratch: _Scratch | None = None
        self._stamps: list[int] = []
        self._ends: list[int] = []
        self._at_most = 0

    def set_region(self, region: tuple[float, ...] | None) -> None:
        """Set the region of interest, in `map.region_frame`, m; None for all."""
        in_base = self._config.region_frame == "base"
        where = binning.REGION_IN_BASE if in_base else binning.REGION_IN_ODOM
        self._limits[binning.REGION_IN] = binning.NO_REGION if region is None else where
        if region is not None:
            self._limits[binning.REGION : binning.NORMAL] = region

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
            wanted = binning.bin_scan(
                ranges, keep, directions, knots, scan.stamp_ns, scan.time_increment * 1e9,
                T_odom_base, T_base_laser, self._limits, first, end,
                abs(scan.angle_increment), self._work,
                state.records, state.directory, state.tiles, state.counts, state.bits, state.meta,
            )  # fmt: skip
            if wanted == binning.DONE:
                break
            first = state.next_beam
            state.grow(wanted)
        self._end_scan(scan.stamp_ns)

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
        columns = points.T
        keep = np.isfinite(columns[0] + columns[1] + columns[2])
        nothing = self._work[3, :n]
        nothing[:] = 0.0
        while True:
            wanted = binning.bin_points(
                columns, nothing, keep, _NOWHERE, _NOWHERE, nothing, 0.0, self._limits, first, n,
                state.records, state.directory, state.tiles, state.counts, state.bits, state.meta,
            )  # fmt: skip
            if wanted == binning.DONE:
                break
            first = state.next_beam
            state.grow(wanted)
        self._end_scan(stamp_ns)

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
        ends = np.array(self._ends, np.int32)
        gather_points(state.records, len(ends), ends, state.counts, points)
        unite = unite_cells_as_printed if self._config.mode == "paper" else unite_cells
        k = unite(
            points, n_cells, scratch.starts, scratch.addresses, state.counts, self._depth,
            self._bins, state.records, scratch.bounds, scratch.moments, scratch.scans,
        )  # fmt: skip
        part = self._finish(cycle, start_ns, end_ns, len(scratch.bounds) - k, points)
        state.clear(listed=True)
        self._begin()
        return part

    def clear(self) -> None:
        """Forget what was added since the last `close`."""
        self._state.clear(listed=False)
        self._begin()

    def _begin(self) -> None:
        self._limits[binning.HAS_NORMAL] = 0.0
        self._stamps, self._ends, self._at_most = [], [], 0

    def _finish(
        self, cycle: int, start_ns: int, end_ns: int, m: int, points: NDArray[np.int64]
    ) -> PartMap:
        scratch = self._scratch_for(0)
        keys, spans = np.empty(m, np.int64), np.empty((m, 2), np.int32)
        sums, seen = np.empty((m, 10), np.int64), np.empty((m, 2), np.int64)
        firsts = np.empty(m, np.int32)
        stamps = np.array(self._stamps, np.int64)
        finish_cuboids(
            scratch.cells, scratch.bounds, scratch.moments, scratch.scans, stamps,
            keys, spans, sums, seen, firsts,
        )  # fmt: skip
        return PartMap(
            cycle, start_ns, end_ns, self._config.cell_size, keys, spans, sums, seen,
            points=PartPoints(points, firsts),
        )  # fmt: skip

    def _end_scan(self, stamp_ns: int) -> None:
        self._stamps.append(stamp_ns)
        self._ends.append(self._state.points)

    def _make_room(self, n: int) -> None:
        self._at_most += n
        if self._at_most > len(self._state.records):
            self._at_most = self._state.points + n
            self._state.make_room(self._at_most)
        if n > self._work.shape[1]:
            self._work = np.zeros((4, n), np.float32)

    def _scratch_for(self, n: int) -> _Scratch:
        if self._scratch is None or len(self._scratch.bounds) < n:
            self._scratch = _Scratch(2 * n)
        return self._scratch

    def _bearings(self, angle_min: float, angle_increment: float, n: int) -> Float32:
        key = (angle_min, angle_increment, n)
        found = self._directions.get(key)
        if found is None:
            if len(self._directions) >= _MAX_GEOMETRIES:
                self._directions.clear()
            number = np.arange(n)
            bearings = angle_min + angle_increment * number
            found = np.stack([np.cos(bearings), np.sin(bearings), number]).astype(np.float32)
            self._directions[key] = found
        return found


class _Scratch:
    """Room for `n` cells and cuboids, kept from cycle to cycle."""

    def __init__(self, n: int) -> None:
        self.cells = np.zeros((n, 2), np.int32)
        self.starts = np.zeros(n + 1, np.int32)
        self.addresses = np.zeros(n, np.int32)
        self.bounds = np.zeros((n, 4), np.int32)
        self.moments = np.zeros((n, 10), np.int64)
        self.scans = np.zeros((n, 2), np.int32)


def _writable(array: Float32) -> Float32:
    """Return an array for which kernels are compiled: read-only ones would need their own."""
    flags = array.flags
    return array if flags.writeable and flags.c_contiguous else array.copy()
