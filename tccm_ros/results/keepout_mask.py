"""Keepout mask of furniture over the floor, for costmap filters of Nav2.

A level laser sees only the legs of a table, while the table top is higher than the robot's base and
lower than its head.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.records import Surface
from tccm_ros.scene.base_poses import cells_under
from tccm_ros.slam.occupancy import RESOLUTION_M, OccupancyGrid

MAX_HEIGHT_M = 1.8
"""Maximum height over the floor of surfaces that obstruct a robot, m. Chosen: as for obstacles."""


def keepout_mask(
    grid: OccupancyGrid | None, surfaces: Sequence[Surface], floor_z: float | None
) -> OccupancyGrid:
    """Return a mask of the cells below surfaces.

    Parameters
    ----------
    grid
        Grid with the resolution, origin and size of the mask; None for the smallest around the
        surfaces.
    surfaces
        Surfaces in map.
    floor_z
        Height of the floor in map, m; None if it was never seen, in which case it counts as 0.

    Returns
    -------
    OccupancyGrid
        100 below a surface other than the floor, 0 elsewhere; no cell is unknown.
    """
    low = obstructing(surfaces, floor_z)
    grid = _grid_around(low) if grid is None else grid
    cells = np.where(cells_under(low, grid), 100, 0).astype(np.int8)
    return OccupancyGrid(cells, grid.resolution, grid.origin)


def obstructing(surfaces: Sequence[Surface], floor_z: float | None) -> list[Surface]:
    """Return the surfaces other than the floor up to `MAX_HEIGHT_M` over it."""
    return [
        s for s in surfaces if s.label != "floor" and s.height - (floor_z or 0.0) <= MAX_HEIGHT_M
    ]


def _grid_around(surfaces: Sequence[Surface]) -> OccupancyGrid:
    """Return the smallest grid around surfaces; one cell without any."""
    points = [s.boundary[:, :2] for s in surfaces] or [np.zeros((1, 2))]
    corners = np.concatenate(points)
    origin = np.floor(corners.min(axis=0) / RESOLUTION_M) * RESOLUTION_M
    size = np.floor((corners.max(axis=0) - origin) / RESOLUTION_M).astype(int) + 1
    return OccupancyGrid(np.zeros(tuple(size[::-1].tolist()), np.int8), RESOLUTION_M, origin)
