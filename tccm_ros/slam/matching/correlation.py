"""Correlative scan matching: the best pose of a scan within a window, by branch and bound.

The result equals that of an exhaustive search. A likelihood grid rates each point of the scan.
Coarser levels contain the maximum over 2 x 2, 4 x 4, ... cells: a coarse score is an upper bound of
all finer scores below it, so that regions of poses are skipped (after Olson 2009 and Hess et al.
2016).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int32, UInt8
from tccm_ros.kernels import kernel
from tccm_ros.slam.matching.likelihood_grid import CELL, UNKNOWN, LikelihoodGrid

SEARCH_WEIGHT = 0.01
"""Loss of score at one standard deviation from the expected pose: without it, along a corridor, the
match with the largest overlap would win (chosen)."""

ANGLE_STEPS, MIN_RMS_DISTANCE = (0.004, 0.03), 0.5
"""Range of the yaw step of a search, rad, and minimum rms distance of its points, m (chosen)."""


class Correlation(NamedTuple):
    """The result of `correlate`.

    Attributes
    ----------
    pose
        float64 (3,), pose of the scan in the map.
    score
        Mean likelihood in 0..1, minus the penalty; -1 for no result.
    """

    pose: Float64
    score: float


def correlate(
    grid: LikelihoodGrid,
    points: Float64,
    centre: Float64,
    window: tuple[float, float],
    *,
    angle_step: float = 0.0,
    penalty: tuple[float, float] = (0.0, 0.0),
    min_score: float = 0.0,
    exclude: tuple[Float64, float, float] | None = None,
) -> Correlation:
    """Return the pose of a scan with the largest mean likelihood.

    Parameters
    ----------
    grid
        Likelihood grid of the map.
    points
        float64 (N, 2), points of the scan.
    centre
        float64 (3,), middle of the window, in the map.
    window
        Half widths: m in x and y, rad in yaw.
    angle_step
        Yaw step, rad; 0 for one cell at the rms distance of the points.
    penalty
        Loss of score per m^2 and rad^2 of distance from the centre; a prior from odometry.
    min_score
        Minimum score, 0..1.
    exclude
        A pose (3,) and the distances (m, rad) around it that are excluded.

    Returns
    -------
    Correlation
        ``score`` is -1 if no pose is better than `min_score`.
    """
    if not len(points):
        return Correlation(np.array(centre, float), -1.0)
    if angle_step <= 0.0:
        far = float(np.sqrt((points * points).sum() / len(points)))
        angle_step = float(np.clip(CELL / max(far, MIN_RMS_DISTANCE), *ANGLE_STEPS))
    middle, cells = np.asarray(centre, float), int(np.ceil(window[0] / CELL))
    depth = min(grid.levels.shape[0] - 1, max(0, int(np.log2(max(cells, 1))) - 1))
    pose, distance, dyaw = exclude or (middle, -1.0, -1.0)
    search = _Search(
        middle, cells, int(np.ceil(window[1] / angle_step)), float(angle_step), *penalty,
        float(min_score), depth, np.asarray(pose, float) - middle, float(distance), float(dyaw),
    )  # fmt: skip
    return Correlation(*_branch_and_bound(grid, np.ascontiguousarray(points), search))


class _Search(NamedTuple):
    """A window of `half` cells and `yaws` yaw steps to either side of a pose.

    The penalties are per m^2 and rad^2; `depth` is the coarsest level to search. Poses within
    `excluded_m` and `excluded_rad` of `excluded`, relative to the centre, give no result.
    """

    centre: Float64
    half: int
    yaws: int
    angle_step: float
    shift_penalty: float
    yaw_penalty: float
    min_score: float
    depth: int
    excluded: Float64
    excluded_m: float
    excluded_rad: float


@kernel
def _score(level: UInt8, cells: Int32, dx: int, dy: int, outside: int) -> float:
    """Return the mean likelihood of points shifted by (dx, dy) cells."""
    total = 0
    for i in range(len(cells)):
        x, y = cells[i, 0] + dx, cells[i, 1] + dy
        if 0 <= x < level.shape[0] and 0 <= y < level.shape[1]:
            total += level[x, y]
        else:
            total += outside
    return total / (255.0 * len(cells))


@kernel
def _score_blocks(
    level: UInt8, cells: Int32, half: int, width: int, outside: int, totals: Int32
) -> None:
    """Add the likelihoods of all points for all shifts -half + i width.

    The outer loop is over points: neighbouring shifts of a point are adjacent in memory.
    """
    blocks = totals.shape[0]
    span = (blocks - 1) * width
    totals[:] = 0
    for p in range(len(cells)):
        x0, y0 = cells[p, 0] - half, cells[p, 1] - half
        if x0 >= 0 and y0 >= 0 and x0 + span < level.shape[0] and y0 + span < level.shape[1]:
            for i in range(blocks):
                row, total = level[x0 + i * width], totals[i]
                if width == 1:
                    for j in range(blocks):
                        total[j] += row[y0 + j]
                else:
                    for j in range(blocks):
                        total[j] += row[y0 + j * width]
            continue
        for i in range(blocks):
            x = x0 + i * width
            for j in range(blocks):
                y = y0 + j * width
                if 0 <= x < level.shape[0] and 0 <= y < level.shape[1]:
                    totals[i, j] += level[x, y]
                else:
                    totals[i, j] += outside


def support(grid: LikelihoodGrid, points: Float64, pose: Float64) -> tuple[float, float]:
    """Return the fractions of a scan's points on walls and in free space.

    Parameters
    ----------
    grid
        Likelihood grid of the map, with free space.
    points
        float64 (N, 2), points of the scan, m.
    pose
        float64 (3,), pose of the scan in the map.
    """
    found = _likelihoods(grid, points, np.asarray(pose, float))
    near, free = np.count_nonzero(found > UNKNOWN), np.count_nonzero(found == 0)
    return near / max(len(points), 1), free / max(len(points), 1)


def known_likelihood(grid: LikelihoodGrid, points: Float64, pose: Float64) -> float:
    """Return the mean likelihood, 0..1, of a scan's points in observed cells.

    Parameters
    ----------
    grid
        Likelihood grid of the map, with free space.
    points
        float64 (N, 2), points of the scan, m.
    pose
        float64 (3,), pose of the scan in the map.

    Returns
    -------
    float
        0 if no point is in an observed cell.
    """
    found = _likelihoods(grid, points, np.asarray(pose, float))
    known = found[found != UNKNOWN]
    return int(known.sum(dtype=np.int64)) / (255.0 * max(len(known), 1))


@kernel
def _likelihoods(grid: LikelihoodGrid, points: Float64, pose: Float64) -> UInt8:
    """Return the likelihood 0..255 of each point; `UNKNOWN` outside the grid."""
    finest, cells = grid.levels[0], np.empty((len(points), 2), np.int32)
    _rotate(points, grid.origin, pose, pose[2], cells)
    found = np.full(len(points), UNKNOWN, np.uint8)
    for i in range(len(points)):
        x, y = cells[i, 0], cells[i, 1]
        if 0 <= x < finest.shape[0] and 0 <= y < finest.shape[1]:
            found[i] = finest[x, y]
    return found


@kernel
def _min_square(low: int, high: int) -> int:
    """Return the smallest k*k for k in low..high."""
    if low > 0:
        return low * low
    return high * high if high < 0 else 0


@kernel
def _rotate(points: Float64, origin: Float64, centre: Float64, angle: float, cells: Int32) -> None:
    c, s = np.cos(angle), np.sin(angle)
    for i in range(len(points)):
        x = c * points[i, 0] - s * points[i, 1] + centre[0] - origin[0]
        y = s * points[i, 0] + c * points[i, 1] + centre[1] - origin[1]
        cells[i, 0], cells[i, 1] = int(np.floor(x / CELL)), int(np.floor(y / CELL))


@kernel
def _branch_and_bound(
    grid: LikelihoodGrid, points: Float64, search: _Search
) -> tuple[Float64, float]:
    """Search blocks of shifts depth-first, the best block first, for each yaw."""
    levels, outside = grid.levels, grid.outside
    centre, half, yaws, angle_step = search.centre, search.half, search.yaws, search.angle_step
    yaw_penalty, depth = search.yaw_penalty, search.depth
    width = 1 << depth
    blocks = (2 * half) // width + 1
    angles = 2 * yaws + 1
    cells = np.empty((angles, len(points), 2), np.int32)
    bounds = np.empty(angles * blocks * blocks)
    totals = np.empty((blocks, blocks), np.int32)
    per_cell = search.shift_penalty * CELL * CELL
    for a in range(angles):
        dyaw = (a - yaws) * angle_step
        _rotate(points, grid.origin, centre, centre[2] + dyaw, cells[a])
        _score_blocks(levels[depth], cells[a], half, width, outside, totals)
        for i in range(blocks):
            x = -half + i * width
            for j in range(blocks):
                y = -half + j * width
                far = _min_square(x, x + width - 1) + _min_square(y, y + width - 1)
                bounds[(a * blocks + i) * blocks + j] = (
                    totals[i, j] / (255.0 * len(points))
                    - per_cell * far
                    - yaw_penalty * dyaw * dyaw
                )
    likely = np.flatnonzero(bounds > search.min_score)
    order = likely[np.argsort(-bounds[likely], kind="mergesort")]
    best, result = search.min_score, np.array([0.0, 0.0, 0.0])
    found = False
    stack = np.empty((4 * (depth + 1) + 4, 3), np.int64)
    for k in order:
        if bounds[k] <= best:
            break
        a, i, j = k // (blocks * blocks), (k // blocks) % blocks, k % blocks
        dyaw = (a - yaws) * angle_step
        top = 0
        stack[0, 0], stack[0, 1], stack[0, 2] = depth, -half + i * width, -half + j * width
        while top >= 0:
            h, x, y = stack[top]
            top -= 1
            size = 1 << h
            far = _min_square(x, x + size - 1) + _min_square(y, y + size - 1)
            bound = (
                _score(levels[h], cells[a], x, y, outside)
                - per_cell * far
                - yaw_penalty * dyaw * dyaw
            )
            if bound <= best:
                continue
            if h == 0:
                away, limit = search.excluded, search.excluded_m * abs(search.excluded_m)
                dx, dy, dt = x * CELL - away[0], y * CELL - away[1], dyaw - away[2]
                dt = np.arctan2(np.sin(dt), np.cos(dt))
                if dx * dx + dy * dy <= limit and abs(dt) <= search.excluded_rad:
                    continue
                best, found = bound, True
                result[0], result[1], result[2] = x * CELL, y * CELL, dyaw
                continue
            step = size >> 1
            for child in range(4):
                top += 1
                stack[top, 0] = h - 1
                stack[top, 1] = x + step * (child & 1)
                stack[top, 2] = y + step * (child >> 1)
    pose = centre + result
    return pose, best if found else -1.0
