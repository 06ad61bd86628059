"""Compile the kernels of outlines with a synthetic plane."""

from __future__ import annotations

import numpy as np

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICKS_PER_M, Cuboids
from tccm_ros.outlines.boundary import members_by_plane, outlines

SIDE = 12
"""Number of cells along each edge of the plane."""

CELL_SIZE, HEIGHT = 0.02, 0.7
"""Edge length of a cell, and height of the plane, m."""


def warm_up(_: Config) -> None:
    """Compute the outline of a horizontal square."""
    ix, iy = (a.ravel().astype(np.int32) for a in np.indices((SIDE, SIDE)))
    count, top = len(ix), round(HEIGHT * TICKS_PER_M)
    middle = np.array([0.5 * CELL_SIZE * TICKS_PER_M, 0.5 * CELL_SIZE * TICKS_PER_M, top])
    square = Cuboids(
        CELL_SIZE,
        ix,
        iy,
        np.full(count, top - 10, np.int32),
        np.full(count, top, np.int32),
        np.ones(count),
        np.tile(middle, (count, 1)),
        np.tile([middle[i] * middle[j] for i in range(3) for j in range(i, 3)], (count, 1)),
        np.zeros(count, np.int32),
        np.arange(count + 1),
    )
    members, starts = members_by_plane(np.zeros(count, np.int32), 1)
    outlines(square, members, starts, np.array([[0.0, 0.0, 1.0]]), np.array([HEIGHT]))
