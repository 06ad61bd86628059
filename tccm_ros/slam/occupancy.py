"""Occupancy grid for navigation, from level scans at their optimised poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64, Int32
from tccm_ros.geometry import transform2
from tccm_ros.kernels import kernel

RESOLUTION_M = 0.05
"""Edge of a cell, m; chosen: that of an ordinary costmap."""

MIN_HIT_FRACTION = 0.35
"""Minimum fraction of a cell's beams that end in it for an occupied cell; chosen."""

MIN_BEAMS = 2
"""Minimum number of beams of a known cell; chosen."""

MARGIN_M = 0.5
"""Unknown border around the scans, m; chosen."""


OCCUPIED = 100
"""Value of an occupied cell, as in nav_msgs/OccupancyGrid."""


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """Cells with the values of nav_msgs/OccupancyGrid.

    Attributes
    ----------
    cells
        int8 (height, width), row 0 at the lowest y: 0 free, 100 occupied, -1 unknown.
    resolution
        Edge of a cell, m.
    origin
        float64 (2,), outer corner of cell (0, 0) in map, m.
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: Float64


def occupancy_grid(
    keyframes: Mapping[str, NDArray[Any]], resolution: float = RESOLUTION_M
) -> OccupancyGrid | None:
    """Return the grid of the keyframes' scans; None without a level laser.

    Parameters
    ----------
    keyframes
        Arrays of the wall SLAM: ``keyframe_pose`` (K, 3) in map, ``scan_points`` (N, 2) and
        ``scan_origin`` (K, 2) in the base frame, m, and ``scan_count`` (K,), points per scan.
    resolution
        Edge of a cell, m.
    """
    if not len(keyframes.get("keyframe_pose", ())) or not len(keyframes["scan_points"]):
        return None
    ends = np.cumsum(keyframes["scan_count"])
    scans = np.split(keyframes["scan_points"].astype(np.float64), ends[:-1])
    poses = keyframes["keyframe_pose"]
    points = np.concatenate([transform2(p, s) for p, s in zip(poses, scans)])
    origins = transform2(poses, keyframes["scan_origin"][:, None])[:, 0]
    starts = np.repeat(origins, keyframes["scan_count"], axis=0)
    low = np.floor((np.minimum(points.min(0), starts.min(0)) - MARGIN_M) / resolution) * resolution
    size = np.ceil((np.maximum(points.max(0), starts.max(0)) + MARGIN_M - low) / resolution)
    hits, passed = np.zeros((2, int(size[1]), int(size[0])), np.int32)
    _trace((starts - low) / resolution, (points - low) / resolution, hits, passed)
    seen = hits + passed
    cells = np.where(hits >= MIN_HIT_FRACTION * seen, np.int8(OCCUPIED), np.int8(0))
    cells[(seen < MIN_BEAMS) & (hits == 0)] = -1
    return OccupancyGrid(cells, resolution, low)


@kernel
def _trace(starts: Float64, ends: Float64, hits: Int32, passed: Int32) -> None:
    """Count the beams that end in each cell (row y, column x), and that pass through it.

    Beams are straight lines from `starts` to `ends` (N, 2), in cells, all inside the grid.
    """
    for n in range(len(starts)):
        x, y = int(np.floor(starts[n, 0])), int(np.floor(starts[n, 1]))
        last_x, last_y = int(np.floor(ends[n, 0])), int(np.floor(ends[n, 1]))
        dx, dy = ends[n, 0] - starts[n, 0], ends[n, 1] - starts[n, 1]
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        next_x = (x + (dx > 0) - starts[n, 0]) / dx if dx != 0.0 else np.inf
        next_y = (y + (dy > 0) - starts[n, 1]) / dy if dy != 0.0 else np.inf
        for _ in range(abs(last_x - x) + abs(last_y - y)):
            passed[y, x] += 1
            if next_x < next_y:
                x += step_x
                next_x += step_x / dx
            else:
                y += step_y
                next_y += step_y / dy
        hits[last_y, last_x] += 1
