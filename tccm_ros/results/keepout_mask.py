"""Where furniture stands over the floor, as a mask for costmap filters of Nav2.

A level laser sees the legs of a table alone; the board is higher than the robot's base and lower
than its head.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.records import Surface
from tccm_ros.slam.occupancy import OccupancyGrid
from tccm_ros.surfaces.base_poses import cells_under

MAX_HEIGHT_M = 1.8
"""Surfaces that are higher over the floor hinder no robot, m. Chosen: as for obstacles."""


def keepout_mask(
    grid: OccupancyGrid, surfaces: Sequence[Surface], floor_z: float | None
) -> OccupancyGrid:
    """Return a mask of the cells that are under a surface.

    Parameters
    ----------
    grid
        Gives resolution, origin and size.
    surfaces
        In map.
    floor_z
        Height of the floor in map, m; None where it was never seen: heights count from 0.

    Returns
    -------
    OccupancyGrid
        100 under a surface other than the floor, 0 elsewhere; no cell is unknown.
    """
    low = [s for s in surfaces if s.height - (floor_z or 0.0) <= MAX_HEIGHT_M]
    cells = np.where(cells_under(low, grid), 100, 0).astype(np.int8)
    return OccupancyGrid(cells, grid.resolution, grid.origin)
