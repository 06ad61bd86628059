"""Which surfaces touch: exact to the bit of a brute-force search, and fast.

A point cloud is a set of patches, stored one after the other. Two patches touch where any of their
points come within a distance of each other. They *meet* where they do so in x and y, whatever their
heights: of a step, the points that happen to touch would tell too little. Patches that touch and
agree in height where they meet, directly or over others, are one component; a pair that is already
connected need not be searched.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.surfaces.patch_planes import PatchPlanes, agree
from tccm_ros.union_find import find_root, unite

__all__ = ["box_pairs", "connect", "patch_boxes"]

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

SLACK = 1.0 + 1e-9
"""Boxes and cells are wider than the distance by this, so that rounding never hides a pair."""


@njit(nogil=True, cache=True)
def patch_boxes(points: Float64, offsets: Int64) -> Float64:
    """Return the boxes of patches, (P, 6) x_min y_min z_min x_max y_max z_max; empty: +inf..-inf.

    Parameters
    ----------
    points
        float64 (N, 3), m; patch p holds ``points[offsets[p]:offsets[p + 1]]``.
    offsets
        int64 (P + 1,).
    """
    boxes = np.empty((len(offsets) - 1, 6))
    for p in range(len(boxes)):
        boxes[p, :3] = np.inf
        boxes[p, 3:] = -np.inf
        for i in range(offsets[p], offsets[p + 1]):
            for k in range(3):
                value = points[i, k]
                boxes[p, k] = min(boxes[p, k], value)
                boxes[p, k + 3] = max(boxes[p, k + 3], value)
    return boxes


@njit(nogil=True, cache=True)
def _sweep(boxes: Float64, order: Int64, distance: float, pairs: Int64) -> int:
    """Write the pairs of boxes within `distance` along every axis; return how many there are."""
    found = 0
    for a in range(len(order)):
        i = order[a]
        for b in range(a + 1, len(order)):
            j = order[b]
            if boxes[j, 0] - boxes[i, 3] > distance:
                break
            apart = False
            for k in range(1, 3):
                gap = max(boxes[j, k] - boxes[i, k + 3], boxes[i, k] - boxes[j, k + 3])
                apart |= gap > distance
            if not apart:
                if found < len(pairs):
                    pairs[found, 0] = min(i, j)
                    pairs[found, 1] = max(i, j)
                found += 1
    return found


def box_pairs(boxes: Float64, distance: float) -> Int64:
    """Return the pairs (q, p), q < p, of boxes within `distance` of each other, sorted by (p, q).

    Parameters
    ----------
    boxes
        float64 (P, 6) of `patch_boxes`, m.
    distance
        Largest gap along any axis, m.

    Returns
    -------
    int64 (M, 2)
    """
    full = np.flatnonzero(np.isfinite(boxes[:, 0]))
    order = full[np.argsort(boxes[full, 0], kind="stable")]
    pairs = np.empty((16 * len(boxes) + 16, 2), np.int64)
    found = _sweep(boxes, order, distance * SLACK, pairs)
    if found > len(pairs):
        pairs = np.empty((found, 2), np.int64)
        _sweep(boxes, order, distance * SLACK, pairs)
    pairs = pairs[:found]
    return pairs[np.lexsort((pairs[:, 0], pairs[:, 1]))]


class _Grid(NamedTuple):
    """The points of one patch, sorted into square cells in x and y.

    Attributes
    ----------
    edge, nx, ny
        Of a cell, m, and how many cells there are along x and y.
    starts, indices
        int64 (nx * ny + 1,) and (N,): cell c holds the points
        ``indices[starts[c]:starts[c + 1]]``.
    """

    edge: float
    nx: int
    ny: int
    starts: Int64
    indices: Int64


@njit(nogil=True, cache=True)
def _shape(box: Float64, count: int, edge: float) -> tuple[float, int, int]:
    """Choose the edge of a patch's grid, at least `edge`, so that it has few empty cells."""
    while True:
        nx = int((box[3] - box[0]) / edge) + 1
        ny = int((box[4] - box[1]) / edge) + 1
        if nx * ny <= 4 * count + 16:
            return edge, nx, ny
        edge *= 2.0


@njit(nogil=True, cache=True)
def _grid(points: Float64, start: int, stop: int, box: Float64, least_edge: float) -> _Grid:
    """Sort the points of a patch into cells."""
    edge, nx, ny = _shape(box, stop - start, least_edge)
    starts = np.zeros(nx * ny + 1, np.int64)
    cells = np.empty(stop - start, np.int64)
    for i in range(start, stop):
        cell = int((points[i, 0] - box[0]) / edge) * ny + int((points[i, 1] - box[1]) / edge)
        cells[i - start] = cell
        starts[cell + 1] += 1
    for c in range(nx * ny):
        starts[c + 1] += starts[c]
    fill = starts[:-1].copy()
    indices = np.empty(stop - start, np.int64)
    for i in range(start, stop):
        cell = cells[i - start]
        indices[fill[cell]] = i
        fill[cell] += 1
    return _Grid(edge, nx, ny, starts, indices)


@njit(nogil=True, cache=True)
def _mark_near(
    points: Float64,
    start: int,
    stop: int,
    box: Float64,
    grid: _Grid,
    distance: float,
    rise: float,
    near: NDArray[np.bool_],
) -> bool:
    """Mark which of the points start to stop come within the distance of a gridded patch.

    Differences in height count `rise` times: once, and then the first point found ends the
    search, or not at all. One long loop: calls for each point would cost more than all else.
    """
    square, found = distance * distance, False
    low, high = box - grid.edge, box + grid.edge
    for i in range(start, stop):
        near[i] = False
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not (low[0] <= x <= high[3] and low[1] <= y <= high[4]):
            continue
        cx, cy = int(np.floor((x - box[0]) / grid.edge)), int(np.floor((y - box[1]) / grid.edge))
        for gx in (cx, cx - 1, cx + 1):  # the middle first: most points are near one there
            for gy in (cy, cy - 1, cy + 1):
                if not (0 <= gx < grid.nx and 0 <= gy < grid.ny):
                    continue
                cell = gx * grid.ny + gy
                for k in range(grid.starts[cell], grid.starts[cell + 1]):
                    j = grid.indices[k]
                    dx, dy, dz = x - points[j, 0], y - points[j, 1], rise * (z - points[j, 2])
                    if dx * dx + dy * dy + dz * dz <= square:
                        near[i] = True
                        break
                if near[i]:
                    break
            if near[i]:
                break
        found |= near[i]
        if found and rise > 0.0:
            break
    return found


@njit(nogil=True, cache=True)
def connect(
    points: Float64,
    offsets: Int64,
    boxes: Float64,
    pairs: Int64,
    distance: float,
    planes: PatchPlanes,
    largest_step: float,
) -> Int64:
    """Connect the pairs of patches that touch and agree in height where they meet.

    Parameters
    ----------
    points, offsets
        As in `patch_boxes`.
    boxes
        float64 (P, 6), of the same patches.
    pairs
        int64 (M, 2), candidates (q, p), q < p, sorted by (p, q).
    distance
        Patches touch where two of their points are at most this far apart, m.
    planes, largest_step
        Of the patches, and m: as in `agree`.

    Returns
    -------
    int64 (P,), the least patch of each patch's component.
    """
    parent = np.arange(len(offsets) - 1)
    meets = np.zeros(len(points), np.bool_)
    edge = distance * SLACK
    gridded = -1
    grid = _Grid(edge, 1, 1, np.zeros(1, np.int64), np.zeros(1, np.int64))
    for m in range(len(pairs)):
        q, p = pairs[m, 0], pairs[m, 1]
        if find_root(parent, q) == find_root(parent, p):
            continue
        if gridded != p:
            grid = _grid(points, offsets[p], offsets[p + 1], boxes[p], edge)
            gridded = p
        first, last = offsets[q], offsets[q + 1]
        if not _mark_near(points, first, last, boxes[p], grid, distance, 1.0, meets):
            continue
        _mark_near(points, first, last, boxes[p], grid, distance, 0.0, meets)
        other = _grid(points, first, last, boxes[q], edge)
        first, last = offsets[p], offsets[p + 1]
        _mark_near(points, first, last, boxes[q], other, distance, 0.0, meets)
        if not agree(points, offsets, meets, planes, q, p, largest_step):
            continue
        unite(parent, q, p)
    for p in range(len(parent)):
        parent[p] = find_root(parent, p)
    return parent
