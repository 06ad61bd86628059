"""Contact between patches: the connected components of patches that touch and agree in height.

Two patches touch if any two of their points are within a distance of each other. They *meet* at
points within that distance in x and y, at any height: at a step, the few points that touch would
not show the difference in height. Patches that touch and agree in height where they meet, directly
or through other patches, form one component. Pairs that are already connected are skipped. The
result equals that of a brute-force search bit by bit.

Heights are compared at the points where patches meet, not by the planes alone: sensor errors bend a
large patch, and the plane of a sparse patch is uncertain at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.surfaces.patch_planes import GATE, PatchPlanes
from tccm_ros.surfaces.plane_errors import FLATNESS
from tccm_ros.union_find import find_root, merge_sets

SLACK = 1.0 + 1e-9
"""Factor by which boxes and cells are wider than the distance. Chosen: no pair is then missed due
to float64 rounding."""


class PatchClouds(NamedTuple):
    """The points of P patches in map; a named tuple, as kernels take no other class.

    Attributes
    ----------
    points
        float64 (N, 3), m; patch p holds ``points[offsets[p]:offsets[p + 1]]``.
    offsets
        int64 (P + 1,).
    boxes
        float64 (P, 2, 3), lower and upper corners; +inf and -inf for an empty patch.
    """

    points: Float64
    offsets: Int64
    boxes: Float64


def patch_clouds(clouds: Sequence[Float64]) -> PatchClouds:
    """Concatenate the clouds of patches, each float64 (N, 3)."""
    points = np.concatenate([np.zeros((0, 3)), *clouds])
    boxes = [
        (cloud.min(axis=0, initial=np.inf), cloud.max(axis=0, initial=-np.inf)) for cloud in clouds
    ]
    offsets = np.cumsum([0, *map(len, clouds)])
    return PatchClouds(points, offsets, np.array(boxes).reshape(-1, 2, 3))


@kernel
def _near_boxes(boxes: Float64, order: Int64, distance: float, pairs: Int64) -> int:
    """Write the pairs of boxes within `distance` along every axis; return their number."""
    found = 0
    for a in range(len(order)):
        i = order[a]
        for b in range(a + 1, len(order)):
            j = order[b]
            if boxes[j, 0, 0] - boxes[i, 1, 0] > distance:
                break
            is_near = True
            for k in range(1, 3):
                gap = max(boxes[j, 0, k] - boxes[i, 1, k], boxes[i, 0, k] - boxes[j, 1, k])
                is_near &= gap <= distance
            if is_near:
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
        float64 (P, 2, 3), lower and upper corners, m.
    distance
        Max gap along any axis, m.

    Returns
    -------
    int64 (M, 2)
    """
    full = np.flatnonzero(np.isfinite(boxes[:, 0, 0]))
    order = full[np.argsort(boxes[full, 0, 0], kind="stable")]
    pairs = np.empty((16 * len(boxes) + 16, 2), np.int64)
    found = _near_boxes(boxes, order, distance * SLACK, pairs)
    if found > len(pairs):
        pairs = np.empty((found, 2), np.int64)
        _near_boxes(boxes, order, distance * SLACK, pairs)
    pairs = pairs[:found]
    return pairs[np.lexsort((pairs[:, 0], pairs[:, 1]))]


class _Grid(NamedTuple):
    """The points of one patch, sorted into square cells in x and y.

    Attributes
    ----------
    box
        float64 (2, 3), lower and upper corner of the points, m; cells begin at the lower one.
    edge, nx, ny
        Edge of a cell, m, and number of cells along x and y.
    starts, indices
        int64 (nx * ny + 1,) and (N,): cell c holds the points
        ``indices[starts[c]:starts[c + 1]]``.
    """

    box: Float64
    edge: float
    nx: int
    ny: int
    starts: Int64
    indices: Int64


@kernel
def _shape(box: Float64, count: int, edge: float) -> tuple[float, int, int]:
    """Choose the edge of a patch's grid, at least `edge`, so that it has few empty cells."""
    while True:
        nx = int((box[1, 0] - box[0, 0]) / edge) + 1
        ny = int((box[1, 1] - box[0, 1]) / edge) + 1
        if nx * ny <= 4 * count + 16:
            return edge, nx, ny
        edge *= 2.0


@kernel
def _grid(clouds: PatchClouds, p: int, min_edge: float) -> _Grid:
    """Sort the points of a patch into cells."""
    points, box = clouds.points, clouds.boxes[p]
    start, stop = clouds.offsets[p], clouds.offsets[p + 1]
    edge, nx, ny = _shape(box, stop - start, min_edge)
    starts = np.zeros(nx * ny + 1, np.int64)
    cells = np.empty(stop - start, np.int64)
    for i in range(start, stop):
        cell = int((points[i, 0] - box[0, 0]) / edge) * ny + int((points[i, 1] - box[0, 1]) / edge)
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
    return _Grid(box, edge, nx, ny, starts, indices)


@kernel
def _mark_near(
    clouds: PatchClouds,
    p: int,
    grid: _Grid,
    distance: float,
    height_weight: float,
    near: Bool,
) -> bool:
    """Mark the points of a patch within a distance of a gridded patch.

    Differences in height are multiplied by `height_weight`, 0 or 1. With 1 the search ends at the
    first point found. One long loop, as a call for each point would dominate the runtime.
    """
    points, origin = clouds.points, grid.box[0]
    square, found = distance * distance, False
    low, high = grid.box[0] - grid.edge, grid.box[1] + grid.edge
    for i in range(clouds.offsets[p], clouds.offsets[p + 1]):
        near[i] = False
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
            continue
        cx = int(np.floor((x - origin[0]) / grid.edge))
        cy = int(np.floor((y - origin[1]) / grid.edge))
        for gx in (cx, cx - 1, cx + 1):  # own cell first: it usually has a near point
            for gy in (cy, cy - 1, cy + 1):
                if not (0 <= gx < grid.nx and 0 <= gy < grid.ny):
                    continue
                cell = gx * grid.ny + gy
                for k in range(grid.starts[cell], grid.starts[cell + 1]):
                    j = grid.indices[k]
                    dx, dy = x - points[j, 0], y - points[j, 1]
                    dz = height_weight * (z - points[j, 2])
                    if dx * dx + dy * dy + dz * dz <= square:
                        near[i] = True
                        break
                if near[i]:
                    break
            if near[i]:
                break
        found |= near[i]
        if found and height_weight > 0.0:
            break
    return found


@kernel
def _agree(
    clouds: PatchClouds,
    meets: Bool,
    planes: PatchPlanes,
    pair: tuple[int, int],
    max_step: float,
) -> bool:
    """Return whether two patches agree in height where they meet, within their uncertainty.

    The height of each patch is that of its plane at the centroid of the points that meet, plus the
    mean residual of its own points there. Heights agree if they differ by at most GATE sigmas and
    by at most `max_step`, m. `meets` bool (N,) marks the points of each patch that meet the other,
    at least one of each.
    """
    points, offsets, (q, p) = clouds.points, clouds.offsets, pair
    x, y, count = 0.0, 0.0, 0
    for patch in (q, p):
        for i in range(offsets[patch], offsets[patch + 1]):
            if meets[i]:
                x, y, count = x + points[i, 0], y + points[i, 1], count + 1
    x, y = x / count, y / count
    step, variance = 0.0, 2.0 * FLATNESS**2
    is_one_view = planes.view_index[q] == planes.view_index[p]
    shared = np.zeros((2, planes.systematic.shape[2]))
    for side in range(2):
        patch, sign = pair[side], 1.0 - 2.0 * side
        slope, centroid = planes.slope[patch], planes.centroid[patch]
        total, count = 0.0, 0
        for i in range(offsets[patch], offsets[patch + 1]):
            if meets[i]:
                # The plane, shifted to this point, at the centroid of the points that meet.
                dx, dy = x - points[i, 0], y - points[i, 1]
                total += points[i, 2] + slope[0] * dx + slope[1] * dy
                count += 1
        step += sign * total / count
        arm = np.array([1.0, x - centroid[0], y - centroid[1]])
        variance += arm @ planes.cov_fit[patch] @ arm
        for k in range(shared.shape[1]):
            shared[side, k] = sign * (arm @ planes.systematic[patch, :, k])
        if not is_one_view:
            variance += arm @ planes.cov_pose[patch] @ arm
    # Systematic errors are common to patches of one view, independent between views.
    for k in range(shared.shape[1]):
        if is_one_view:
            variance += (shared[0, k] + shared[1, k]) ** 2
        else:
            variance += shared[0, k] ** 2 + shared[1, k] ** 2
    return abs(step) <= min(GATE * np.sqrt(variance), max_step)


@kernel
def connect(
    clouds: PatchClouds, pairs: Int64, distance: float, planes: PatchPlanes, max_step: float
) -> Int64:
    """Connect the pairs of patches that touch and agree in height where they meet.

    Parameters
    ----------
    clouds
        Points of P patches.
    pairs
        int64 (M, 2), candidates (q, p), q < p, sorted by (p, q).
    distance
        Max distance of two points that touch, m.
    planes
        Planes of the patches.
    max_step
        Max difference in height of connected patches where they meet, m.

    Returns
    -------
    int64 (P,), the first patch of each patch's component.
    """
    parent = np.arange(len(clouds.boxes))
    meets = np.zeros(len(clouds.points), np.bool_)
    edge = distance * SLACK
    gridded = -1
    grid = _Grid(np.zeros((2, 3)), edge, 1, 1, np.zeros(1, np.int64), np.zeros(1, np.int64))
    for m in range(len(pairs)):
        q, p = pairs[m, 0], pairs[m, 1]
        if find_root(parent, q) == find_root(parent, p):
            continue
        if gridded != p:
            grid = _grid(clouds, p, edge)
            gridded = p
        if not _mark_near(clouds, q, grid, distance, 1.0, meets):
            continue
        _mark_near(clouds, q, grid, distance, 0.0, meets)
        _mark_near(clouds, p, _grid(clouds, q, edge), distance, 0.0, meets)
        if not _agree(clouds, meets, planes, (q, p), max_step):
            continue
        merge_sets(parent, q, p)
    for p in range(len(parent)):
        parent[p] = find_root(parent, p)
    return parent
