"""Collision-free base poses from which the arm reaches a place, by the occupancy grid."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage

from tccm_ros.arrays import Bool, Float64
from tccm_ros.records import Surface
from tccm_ros.slam.occupancy import OccupancyGrid


@dataclass(frozen=True, slots=True)
class BasePose:
    """A free pose of the base near a place.

    Attributes
    ----------
    x, y, yaw
        Pose of the base in map, m and rad; its x axis points to the place.
    distance
        Horizontal distance from the place, m.
    clearance
        Distance of the robot's circle from the nearest cell that is not free, m.
    """

    x: float
    y: float
    yaw: float
    distance: float
    clearance: float


class FreeFloor:
    """Distance transform of the free cells of an occupancy grid.

    Parameters
    ----------
    grid
        Occupancy grid in map.
    surfaces
        Cells under these surfaces, except the floor, are not free. A level laser sees only the
        legs of furniture.
    """

    def __init__(self, grid: OccupancyGrid, surfaces: Sequence[Surface] = ()):
        # Cells outside of the grid are unknown, so they are not free.
        free = np.pad((grid.cells == 0) & ~cells_under(surfaces, grid), 1)
        distances = ndimage.distance_transform_edt(free)[1:-1, 1:-1]
        # From the cell's centre to the nearest corner of the other cell: a lower bound.
        self._distance = np.maximum(distances - math.sqrt(0.5), 0.0) * grid.resolution
        self._resolution, self._origin = grid.resolution, grid.origin

    def base_poses(
        self, place: Float64, reach: float, robot_radius: float, max_count: int
    ) -> list[BasePose]:
        """Return free base poses near a place, the nearest first.

        Parameters
        ----------
        place
            float64 (2,) or (3,), in map, m.
        reach
            Max horizontal distance of the base's origin from the place, m, > 0.
        robot_radius
            Radius of the free circle around the base's origin, m.
        max_count
            Maximum number of poses; any two are at least a robot radius from each other.
        """
        low = np.floor((place[:2] - reach - self._origin) / self._resolution).astype(int)
        high = np.ceil((place[:2] + reach - self._origin) / self._resolution).astype(int) + 1
        low, high = np.maximum(low, 0), np.maximum(high, 0)
        near = self._distance[low[1] : high[1], low[0] : high[0]]
        rows, columns = np.nonzero(near > robot_radius)
        xy = self._origin + (np.column_stack([columns, rows]) + low + 0.5) * self._resolution
        distances = np.hypot(*(xy - place[:2]).T)
        clearances = near[rows, columns] - robot_radius
        order = np.argsort(distances, kind="stable")
        order = order[distances[order] <= reach]
        found: list[BasePose] = []
        while len(order) and len(found) < max_count:
            k = order[0]
            yaw = math.atan2(*(place[:2] - xy[k])[::-1])
            x, y = xy[k].tolist()
            found.append(BasePose(x, y, yaw, float(distances[k]), float(clearances[k])))
            is_far = np.hypot(*(xy[order] - xy[k]).T) >= max(robot_radius, self._resolution)
            order = order[is_far]
        return found


def cells_under(surfaces: Sequence[Surface], grid: OccupancyGrid) -> Bool:
    """Return the cells of a grid whose centre is under a surface other than the floor.

    Parameters
    ----------
    surfaces
        Surfaces in map.
    grid
        Grid in map.

    Returns
    -------
    bool (height, width)
    """
    return cells_within([s.boundary for s in surfaces if s.label != "floor"], grid)


def cells_within(outlines: Iterable[Float64], grid: OccupancyGrid) -> Bool:
    """Return the cells of a grid whose centre is inside any of the outlines.

    Parameters
    ----------
    outlines
        float64 (N, 2 or 3) each, in the frame of the grid, m.
    grid
        Defines origin, resolution and shape; cell values are not used.

    Returns
    -------
    bool (height, width)
    """
    within = np.zeros(grid.cells.shape, bool)
    for outline in outlines:
        ring = (outline[:, :2] - grid.origin) / grid.resolution
        low = np.maximum(np.floor(ring.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(ring.max(axis=0)).astype(int), within.shape[::-1])
        if (low >= high).any():
            continue
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        polygon = shapely.make_valid(shapely.Polygon(ring))
        within[low[1] : high[1], low[0] : high[0]] |= shapely.contains_xy(polygon, x, y)
    return within
