"""Bin the endpoints of beams in cells, scan by scan.

Beams are processed in blocks: first all arithmetic (`beam_endpoints`), then all random memory
access, beam by beam.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tccm_ros.cuboids.beam_endpoints import (
    BEYOND,
    BLOCK,
    CELL_OF,
    DEPTH_OF,
    HEIGHT,
    IN_CELL,
    TILE_OF,
    USED,
    Beams,
    RegionFrame,
    ScanSegment,
    angle_between_lines,
    extend_box,
    mark_inside,
    mark_kept,
    poses_in_beams,
    project_beams,
    quantise,
    region_in_segment,
)
from tccm_ros.cuboids.intrinsics import lowest_bit
from tccm_ros.cuboids.tiles import CELLS_PER_TILE, GROW_SLOTS, GROW_TILES, TILE, Tiles
from tccm_ros.kernels import kernel

_U0, _U1, _U2, _U3 = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(3)


@kernel
def _count(low: Any, high: Any, work: Any, tiles: Any) -> Any:
    """Append the used beams [low, high) of a block to the records and count them in their cells.

    Returns `high`, or the first beam whose tile has no memory yet.
    """
    records, directory, counts, bits = tiles.records, tiles.directory, tiles.counts, tiles.bits
    counters = tiles.counters[0]
    n, slots = np.uint64(counters.points), counters.slots
    at = high
    for j in range(np.uint64(low), np.uint64(high)):
        if work[USED + j] == 0:
            continue
        tile = np.uint64(work[TILE_OF + j])
        slot = np.int64(directory[tile])
        if slot < 0:
            if (slots + 1) * CELLS_PER_TILE > len(counts):
                at = np.int64(j)
                break
            slot = slots
            directory[tile] = slot
            slots += 1
        cell = np.int64(work[CELL_OF + j])
        address = slot * CELLS_PER_TILE + cell
        counts[np.uint64(address)] += 1
        bits[np.uint64(address >> 6)] |= _U1 << np.uint64(cell & 63)
        place = np.int64(np.uint32(work[IN_CELL + j]))
        records[_U2 * n] = (np.int64(work[HEIGHT + j]) << 32) | place
        records[_U2 * n + _U1] = (np.int64(work[DEPTH_OF + j]) << 32) | address
        n += _U1
    counters.points, counters.slots = n, slots
    return at


@kernel
def bin_points(points: Any, gaps: Any, first: Any, settings: Any, work: Any, arrays: Any) -> Any:
    """Bin points in the map's frame; points that are not finite are left out.

    Parameters
    ----------
    points
        float64 (3 N,), x y z of each point, m.
    gaps
        float64 (N,), distance to the next scan line, m; empty for dense points.
    first
        Index of the first point to bin.
    settings, work, arrays
        As in `bin_scan`; the depth of a point grows with its gap, or is the minimum.

    Returns
    -------
    int
        As in `bin_scan`.
    """
    tiles, own = Tiles(*arrays), settings[0]
    counters = tiles.counters[0]
    ticks, depth, n = own.ticks, own.depth, len(points) // 3
    growth = own.depth_per_range * own.ticks
    per_tick, cell = 1.0 / own.cell_ticks, np.int64(own.cell_ticks)
    for begin in range(first, n, BLOCK):
        count = min(n - begin, BLOCK)
        grid = per_tick, cell, counters.tile_x0, counters.tile_y0, counters.tiles_y
        x0 = y0 = BEYOND
        x1 = y1 = -BEYOND
        for j in range(np.uint64(count)):
            i = _U3 * (np.uint64(begin) + j)
            x, y, z = points[i], points[i + _U1], points[i + _U2]
            d = depth
            if len(gaps):
                d = min(max(growth * gaps[np.uint64(begin) + j], depth), own.max_depth)
            used, tx, ty = quantise(work, j, True, x * ticks, y * ticks, z * ticks, d, grid)
            x0, x1 = min(x0, tx if used else BEYOND), max(x1, tx if used else -BEYOND)
            y0, y1 = min(y0, ty if used else BEYOND), max(y1, ty if used else -BEYOND)
        counters.next_beam = begin
        if not extend_box(counters, (x0, x1), (y0, y1)):
            return GROW_TILES
        done = _count(0, count, work, tiles)
        if done < count:
            counters.next_beam = begin + done
            return GROW_SLOTS
    return counters.points


@kernel
def bin_scan(scan: Any, poses: Any, settings: Any, work: Any, arrays: Any) -> Any:
    """Compute the endpoints of a scan's beams, and bin those inside the region.

    Parameters
    ----------
    scan
        The fields of `Beams`.
    poses
        Arguments of `poses_in_beams`; stamps decrease if the period is negative.
    settings
        Element of `SETTINGS`; the angle between this scan's plane and the previous one is the step
        between scan lines. This scan's plane is written to it.
    work
        int32 (WORK_SIZE,), scratch.
    arrays
        The fields of `Tiles`.

    Returns
    -------
    int
        Number of records, or the code of the array to enlarge before the call is repeated from the
        counters' `next_beam`.
    """
    beams, tiles, own = Beams(*scan), Tiles(*arrays), settings[0]
    counters = tiles.counters[0]
    times, T = poses_in_beams(*poses)
    growth = own.depth_per_range * own.ticks * angle_between_lines(T, own, beams.step)
    n, start = len(times), beams.first
    has_region, seen = own.region_frame != RegionFrame.NONE, np.empty((7, 3), np.float32)
    for k in range(max(n - 1, 1)):
        end, f0, df, j = beams.last, 0.0, 0.0, k
        if n > 1:
            j = k + 1
            df = 1.0 / (times[j] - times[k])
            f0 = -times[k] * df
            if j < n - 1:
                end = min(max(np.int64(np.ceil(times[j])), start), beams.last)
        segment = ScanSegment(T[k], T[j], f0, df)
        if has_region and start < end:
            region_in_segment(poses[3], segment, own, seen)
        for begin in range(start, end, BLOCK):
            low, high = np.int64(0), min(end - begin, np.int64(BLOCK))
            if has_region:
                # Most of a scan is outside the region: project only the range of beams inside.
                low, high = mark_inside(beams, seen, begin, high, work)
            else:
                mark_kept(beams.keep, begin, high, work)
            if low >= high:
                continue
            covered = project_beams(beams, segment, growth, own, (begin, low, high), work, counters)
            counters.next_beam = begin
            if not covered:
                return GROW_TILES
            done = _count(low, high, work, tiles)
            if done < high:
                counters.next_beam = begin + done
                return GROW_SLOTS
        start = end
    for i in range(3):
        own.normal[i] = T[len(T) // 2, i, 2]
    own.has_normal = True
    return counters.points


@kernel
def list_cells(arrays: Any, keys: Any, starts: Any, addresses: Any) -> Any:
    """List the counted cells in order of (ix, iy), and turn their counts into start positions.

    Parameters
    ----------
    arrays
        The fields of `Tiles`. `counts` become the cells' start positions; `bits` are cleared.
    keys
        int64 (N,), written: the cells, see `cuboids.cell_keys`.
    starts
        int32 (N + 1,), written: start position of each cell and, last, the number of points.
    addresses
        int32 (N,), written: the cells' addresses.

    Returns
    -------
    int
        Number of cells.
    """
    tiles = Tiles(*arrays)
    directory, counts, bits, counters = tiles.directory, tiles.counts, tiles.bits, tiles.counters[0]
    n_x, n_y = counters.tiles_x, counters.tiles_y
    slots, columns = np.empty(n_y, np.int64), np.empty(n_y, np.int64)
    n = _U0
    position = np.int64(0)
    for tx in range(n_x):
        in_row = 0
        for ty in range(n_y):
            slot = directory[np.uint64(tx * n_y + ty)]
            if slot >= 0:
                slots[in_row], columns[in_row] = slot, ty
                in_row += 1
        if in_row == 0:
            continue
        for lx in range(TILE):
            ix = (counters.tile_x0 + tx) * TILE + lx
            for j in range(in_row):
                row = slots[j] * TILE + lx
                word = bits[np.uint64(row)]
                bits[np.uint64(row)] = _U0
                key = (ix << 32) + (counters.tile_y0 + columns[j]) * TILE
                while word != _U0:
                    bit = lowest_bit(word)
                    word &= word - _U1
                    address = row * TILE + bit
                    keys[n] = key + bit
                    starts[n], addresses[n] = position, address
                    count = counts[np.uint64(address)]
                    counts[np.uint64(address)] = position
                    position += count
                    n += _U1
    starts[n] = position
    return np.int64(n)
