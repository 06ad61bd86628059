"""Contact between patches: the connected components of patches that meet and agree in height.

Two patches *meet* at their points within a distance in x and y, at any height. Patches that agree
in height there, directly or through other patches, form one component. Pairs that are already
connected are skipped. The result equals that of a brute-force search.

Heights are compared at the points where patches meet, not by the planes alone: sensor errors bend a
large patch, and the plane of a sparse patch is uncertain at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import shapely

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.planes.plane_noise import FLATNESS
from tccm_ros.surfaces.merging.patch_planes import PatchPlanes, agree_in_height
from tccm_ros.surfaces.polygons import GRID


def connect(
    clouds: Sequence[Float64], planes: PatchPlanes, distance: float, max_step: float
) -> Int64:
    """Connect the patches that meet and agree in height there.

    Parameters
    ----------
    clouds
        Points of P patches, each float64 (N, 3), in map, m.
    planes
        Planes of the patches.
    distance
        Max distance in x and y of points that meet, m.
    max_step
        Max difference in height of connected patches where they meet, m.

    Returns
    -------
    int64 (P,), the first patch of each patch's component.
    """
    root = np.arange(len(clouds))

    @cache
    def grid_of(patch: int) -> _Grid:
        return _grid_of(clouds[patch], distance + GRID)

    for q, p in near_pairs(clouds, distance).tolist():
        if root[q] == root[p]:
            continue
        meets = np.array([_sum_near(clouds[i], grid_of(j), distance) for i, j in ((q, p), (p, q))])
        if meets[0, 3] and _agree(meets, planes, (q, p), max_step):
            first, second = sorted((int(root[q]), int(root[p])))
            root[root == second] = first
    return root


def near_pairs(clouds: Sequence[Float64], distance: float) -> Int64:
    """Return the pairs of patches whose boxes are within a distance.

    Parameters
    ----------
    clouds
        Points of P patches, each float64 (N, 3), m.
    distance
        Max gap along any axis, m.

    Returns
    -------
    int64 (M, 2)
        Pairs (q, p), q < p, sorted by (p, q).
    """
    full = np.array([k for k, cloud in enumerate(clouds) if len(cloud)], np.int64)
    low, high = (
        np.array([[end(axis) for axis in clouds[k].T] for k in full]).reshape(-1, 3)
        for end in (np.min, np.max)
    )
    grown = distance + GRID  # no pair is missed due to rounding
    boxes = shapely.box(*low[:, :2].T, *high[:, :2].T)
    around = shapely.box(*(low[:, :2] - grown).T, *(high[:, :2] + grown).T)
    p, q = shapely.STRtree(boxes).query(around)
    chosen = (q < p) & (np.maximum(low[q, 2] - high[p, 2], low[p, 2] - high[q, 2]) <= grown)
    p, q = full[p[chosen]], full[q[chosen]]
    return np.stack([q, p], axis=1)[np.lexsort((q, p))]


class _Grid(NamedTuple):
    """The points of a patch, sorted into square cells in x and y.

    Attributes
    ----------
    points
        float64 (N, 2), m, by cell.
    starts
        int64 (X * Y + 1,): cell (x, y) holds the points from ``starts[x * Y + y]`` up to the next
        start.
    low
        float64 (2,), lower corner of cell (0, 0), m.
    shape
        X and Y.
    edge
        Edge of a cell, m.
    """

    points: Float64
    starts: Int64
    low: Float64
    shape: tuple[int, int]
    edge: float


@kernel
def _grid_of(cloud: Float64, edge: float) -> _Grid:
    """Return the grid of points (N, 3), N > 0, by counting sort."""
    low, high = cloud[0, :2].copy(), cloud[0, :2].copy()
    for i in range(len(cloud)):
        for k in range(2):
            low[k], high[k] = min(low[k], cloud[i, k]), max(high[k], cloud[i, k])
    nx, ny = int((high[0] - low[0]) / edge) + 1, int((high[1] - low[1]) / edge) + 1
    cells, starts = np.empty(len(cloud), np.int64), np.zeros(nx * ny + 1, np.int64)
    for i in range(len(cloud)):
        x, y = int((cloud[i, 0] - low[0]) / edge), int((cloud[i, 1] - low[1]) / edge)
        cells[i] = x * ny + y
        starts[cells[i] + 1] += 1
    starts = np.cumsum(starts)
    used, points = starts[:-1].copy(), np.empty((len(cloud), 2))
    for i in range(len(cloud)):
        points[used[cells[i]]] = cloud[i, :2]
        used[cells[i]] += 1
    return _Grid(points, starts, low, (nx, ny), edge)


@kernel
def _sum_near(points: Float64, grid: _Grid, distance: float) -> Float64:
    """Return the sums of x, y, z and 1 of points (N, 3) near one of a grid in x and y."""
    total, (nx, ny) = np.zeros(4), grid.shape
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        cx = int(np.floor((x - grid.low[0]) / grid.edge))
        cy = int(np.floor((y - grid.low[1]) / grid.edge))
        first, last, is_near = max(cy - 1, 0), min(cy + 1, ny - 1), False
        for row in range(max(cx - 1, 0), min(cx + 2, nx) if first <= last else 0):
            for k in range(grid.starts[row * ny + first], grid.starts[row * ny + last + 1]):
                dx, dy = x - grid.points[k, 0], y - grid.points[k, 1]
                if dx * dx + dy * dy <= distance * distance:
                    is_near = True
                    break
            if is_near:
                total[:3] += points[i]
                total[3] += 1.0
                break
    return total


def _agree(sums: Float64, planes: PatchPlanes, pair: tuple[int, int], max_step: float) -> bool:
    """Return whether two patches agree in height where they meet, within their uncertainty.

    The height of each patch is that of its plane at the centroid of the points that meet, plus the
    mean residual of its own points there.

    Parameters
    ----------
    sums
        float64 (2, 4), of each patch the sums of x, y, z and 1 of the points that meet the other.
    planes, pair
        Planes of all patches, and the indices of the two.
    max_step
        m.
    """
    middle = sums[:, :2].sum(axis=0) / sums[:, 3].sum()
    is_one_view = planes.view_index[pair[0]] == planes.view_index[pair[1]]
    heights, shared, variance = [], [], 2.0 * FLATNESS**2
    for (x, y, z), k in zip(sums[:, :3] / sums[:, 3:], pair):
        arm = np.r_[1.0, middle - planes.centroid[k, :2]]
        heights.append(z + (middle - (x, y)) @ planes.slope[k])
        shared.append(arm @ planes.systematic[k])
        cov = planes.cov_fit[k] + (0.0 if is_one_view else planes.cov_pose[k])
        variance += float(arm @ cov @ arm)
    # Systematic errors are common to patches of one view, independent between views.
    systematic = [shared[0] - shared[1]] if is_one_view else shared
    variance += float(np.square(systematic).sum())
    return agree_in_height(heights[0] - heights[1], variance, max_step)
