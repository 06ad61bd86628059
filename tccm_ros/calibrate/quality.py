"""Quality of floor and ceiling under a rig: tilt and flatness from all hits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.calibrate.model import CycleBeams, beams_of, join_beams
from tccm_ros.calibrate.recording import CycleScans

CELL, MIN_HITS, FEW_HITS = 0.25, 50, 8
"""Edge of a cell, m; minimum hits of a cell for the flatness, and for the plane (chosen)."""

NEAR = 0.05
"""Maximum distance of a surface's hits to its height, m (chosen)."""

AROUND = 2
"""Number of scans and beams to either side of a hit that must be near the plane as well
(chosen)."""


@dataclass(frozen=True, slots=True)
class Flatness:
    """Tilt and flatness of a roughly horizontal surface.

    Attributes
    ----------
    tilt
        Angle to the horizontal, rad.
    rms
        Root mean square distance of cell means from the plane, m; None if no cell has enough hits.
    height
        Height at the middle, m.
    cells
        Number of cells with enough hits.
    normal
        Unit normal, upwards.
    """

    tilt: float
    rms: float | None
    height: float
    cells: int
    normal: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class HitMasks:
    """Masks of the beams that hit floor and ceiling.

    Attributes
    ----------
    floor, ceiling
        bool (N,), one per beam.
    """

    floor: Bool
    ceiling: Bool


def all_beams(cycles: Sequence[CycleScans], first: int = 0) -> CycleBeams:
    """Return all valid hits of all tilt cycles, which are numbered from `first`."""
    return join_beams([beams_of(number, cycle) for number, cycle in enumerate(cycles, first)])


def select(
    cycles: Sequence[CycleScans], heights: Float64, floor: float | None, ceiling: float | None
) -> HitMasks:
    """Return the hits on floor and ceiling.

    A hit is on the floor if it and all hits around it (`AROUND`) are near the floor's height. This
    excludes the foot of objects on the floor, and mixed pixels at their edges.

    Parameters
    ----------
    cycles
        Scans by tilt cycle.
    heights
        float64 (N,), m, height of every valid hit of all tilt cycles, in the order of `all_beams`.
    floor, ceiling
        Heights of the surfaces, m; None for a missing one.
    """
    none = np.zeros(len(heights), bool)
    return HitMasks(
        none if floor is None else _inner(cycles, np.abs(heights - floor) < NEAR),
        none if ceiling is None else _inner(cycles, np.abs(heights - ceiling) < NEAR),
    )


def _inner(cycles: Sequence[CycleScans], near: Bool) -> Bool:
    """Return a mask of the hits that are near with all hits around them."""
    window, parts, first = np.ones((2 * AROUND + 1, 2 * AROUND + 1)), [], 0
    for cycle in cycles:
        seen = np.isfinite(cycle.ranges)
        grid = np.zeros(seen.shape, bool)
        grid[seen] = near[first : first + int(seen.sum())]
        first += int(seen.sum())
        parts.append(binary_erosion(grid, window, border_value=1)[seen])
    return np.concatenate(parts)


def flatness(points: Float64) -> Flatness | None:
    """Return the flatness of cell means about a plane; None with fewer than four cells.

    Parameters
    ----------
    points
        float64 (N, 3), m, of one roughly horizontal surface.
    """
    _, means, counts = cell_means(points, points[:, :2])
    if len(means) < 4:
        return None
    weights = np.minimum(counts, MIN_HITS)
    center = np.average(means, axis=0, weights=weights)
    normal = np.linalg.svd((means - center) * np.sqrt(weights)[:, None])[2][2]
    normal = normal * np.sign(normal[2])
    full = counts >= MIN_HITS
    off = (means[full] - center) @ normal
    x, y, z = normal.tolist()
    return Flatness(
        float(np.arccos(min(z, 1.0))),
        float(np.sqrt(np.mean(off**2))) if full.any() else None,
        float(center[2]),
        int(full.sum()),
        (x, y, z),
    )


def cell_means(points: Float64, at: Float64) -> tuple[Int64, Float64, Int64]:
    """Return the means of points by cell.

    Parameters
    ----------
    points
        float64 (N, 3), m.
    at
        float64 (N, 2), m, coordinates that give each point's cell of edge `CELL`.

    Returns
    -------
    tuple of arrays
        Cells int64 (C, 2) with at least `FEW_HITS` hits, their means float64 (C, 3), m, and their
        numbers of hits int64 (C,).
    """
    if len(points) == 0:
        return np.zeros((0, 2), np.int64), np.zeros((0, 3)), np.zeros(0, np.int64)
    numbers = np.floor(at / CELL).astype(np.int64)
    cells, index, counts = np.unique(numbers, axis=0, return_inverse=True, return_counts=True)
    index = index.reshape(-1)
    sums = np.stack([np.bincount(index, points[:, i]) for i in range(3)], axis=1)
    enough = counts >= FEW_HITS
    return cells[enough], sums[enough] / counts[enough, None], counts[enough]
