"""Likelihood grids of a local map, with a pyramid of maxima for branch and bound."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, UInt8
from tccm_ros.kernels import kernel
from tccm_ros.slam.matching.buckets import extent_near_median

CELL = 0.05
"""Edge of a cell, m (chosen)."""

BLUR = 0.06
"""Standard deviation of the likelihood around a map point, m (chosen)."""

STAMP = 3
"""Half size of a point's likelihood stamp, cells. Chosen: 2.5 standard deviations, beyond which the
likelihood is below 5 % of the maximum."""

MAX_CELLS = 1600
"""Maximum number of cells along a side. Chosen: 80 m, beyond the range of indoor lasers."""

LEVELS = 5
"""Number of levels of the pyramid: cells of 5 cm to 80 cm (chosen)."""

UNKNOWN = 64
"""Likelihood (of 255) of an unobserved cell: neutral for the score of a pose (chosen)."""

SHORT = 0.15
"""A beam marks free space up to this distance (m) before its end (chosen)."""


class LikelihoodGrid(NamedTuple):
    """Likelihood of a point in each cell; passed to compiled code.

    Attributes
    ----------
    levels
        uint8 (levels, rows, columns), 0..255: cell (i, j) of level h contains the maximum of the
        finest level over i..i + 2^h - 1 and j..j + 2^h - 1.
    origin
        float64 (2,), corner of cell (0, 0) in the map, m.
    outside
        Likelihood outside the grid.
    """

    levels: UInt8
    origin: Float64
    outside: int = 0


def make_likelihood_grid(
    points: Float64, levels: int = LEVELS, rays: tuple[Float64, Float64] | None = None
) -> LikelihoodGrid:
    """Return a grid of map points (N, 2) with its pyramid.

    Parameters
    ----------
    points
        float64 (N, 2), m.
    levels
        Number of levels.
    rays
        Origins and ends, float64 (M, 2) each, of beams: traversed cells have likelihood 0,
        unobserved cells `UNKNOWN`. Without rays, all cells away from points are 0.
    """
    outside = UNKNOWN if rays is not None else 0
    if not len(points):
        return LikelihoodGrid(np.full((levels, 1, 1), outside, np.uint8), np.zeros(2), outside)
    near, low, high = extent_near_median(points, 0.5 * MAX_CELLS * CELL)
    margin = (STAMP + 1 + 2**levels) * CELL
    origin = low - margin
    shape = ((high + margin - origin) / CELL).astype(np.int64) + 1
    grid = np.empty((levels, shape[0], shape[1]), np.uint8)
    grid[0] = outside
    if rays is not None:
        _clear(grid[0], rays[0], rays[1], origin)
    _draw(grid[0], points[near], origin, _BLURRED)
    _build_levels(grid)
    return LikelihoodGrid(grid, origin, outside)


def with_unknown(grid: LikelihoodGrid, likelihood: float) -> LikelihoodGrid:
    """Return a grid whose unobserved cells have another likelihood, 0..1."""
    value = np.uint8(np.clip(np.rint(255.0 * likelihood), 0, 255))
    levels = np.empty_like(grid.levels)
    levels[0] = np.where(grid.levels[0] == UNKNOWN, value, grid.levels[0])
    _build_levels(levels)
    return LikelihoodGrid(levels, grid.origin, int(value))


def _blurred_point() -> UInt8:
    """Return the likelihoods in the cells around a map point."""
    offsets = np.arange(-STAMP, STAMP + 1) * CELL
    squares = offsets[:, None] ** 2 + offsets[None, :] ** 2
    stamp = np.rint(255.0 * np.exp(-0.5 * squares / BLUR**2)).astype(np.uint8)
    # A cell with a point is observed.
    return np.where(stamp == UNKNOWN, np.uint8(UNKNOWN - 1), stamp)


_BLURRED = _blurred_point()


@kernel
def _clear(grid: UInt8, origins: Float64, ends: Float64, corner: Float64) -> None:
    """Set traversed cells of beams to 0, sampled once per cell width."""
    for i in range(len(ends)):
        dx, dy = ends[i, 0] - origins[i, 0], ends[i, 1] - origins[i, 1]
        length = np.hypot(dx, dy)
        steps = int((length - SHORT) / CELL)
        ux, uy = dx / max(length, 1e-9) * CELL, dy / max(length, 1e-9) * CELL
        x, y = origins[i, 0] - corner[0], origins[i, 1] - corner[1]
        for _ in range(steps):
            cx, cy = int(np.floor(x / CELL)), int(np.floor(y / CELL))
            if 0 <= cx < grid.shape[0] and 0 <= cy < grid.shape[1]:
                grid[cx, cy] = 0
            x, y = x + ux, y + uy


@kernel
def _draw(grid: UInt8, points: Float64, origin: Float64, stamp: UInt8) -> None:
    for i in range(len(points)):
        cx = int((points[i, 0] - origin[0]) / CELL)
        cy = int((points[i, 1] - origin[1]) / CELL)
        for a in range(2 * STAMP + 1):
            for b in range(2 * STAMP + 1):
                x, y = cx + a - STAMP, cy + b - STAMP
                if stamp[a, b] > grid[x, y]:
                    grid[x, y] = stamp[a, b]


def _build_levels(grid: UInt8) -> None:
    """Fill each level with maxima over 2 x 2 cells of the previous one, clamped at the border."""
    pairs = np.empty_like(grid[0])
    for h in range(1, len(grid)):
        step = 1 << (h - 1)
        below, above = grid[h - 1], grid[h]
        np.maximum(below[:-step], below[step:], out=pairs[:-step])
        np.maximum(below[-step:], below[-1], out=pairs[-step:])
        np.maximum(pairs[:, :-step], pairs[:, step:], out=above[:, :-step])
        np.maximum(pairs[:, -step:], pairs[:, -1:], out=above[:, -step:])
