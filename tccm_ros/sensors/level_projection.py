"""Level scans for robots without a level laser, projected from depth images or point clouds.

For each bearing in the base frame, the range is that of the nearest vertical surface in a band of
heights: the mean of its points, as the minimum would be biased by noise. Horizontal surfaces have
no range: where the edge of the view cuts a table top, the nearest point moves with the head, and
matching would move a robot at rest.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.kernels import kernel
from tccm_ros.records import Event, Posed, Scan
from tccm_ros.sensors.depth_image import PosedImage, seen_points
from tccm_ros.sensors.measured import MeasuredPoints, without_robot
from tccm_ros.sensors.point_cloud import PosedCloud, placed_points

BEARING_STEP = math.radians(0.5)
"""Angle between the beams of the level scan, rad, as of many level lasers."""

BEAMS = 720
"""Number of beams over 360 deg; unobserved bearings are NaN."""

SLAB, SLAB_PER_RANGE_SQUARED = 0.06, 0.012
"""Width of a range bin, m, and its increase per range squared, 1/m, where that is larger: six times
the noise of a depth camera."""

NEAR = math.sqrt(SLAB / SLAB_PER_RANGE_SQUARED)
"""Range, m, from which on bins are uniform in inverse range."""

MIN_EXTENT = 0.1
"""Minimum height of a vertical surface, m (chosen: more than the edge of a table top, less than two
rings of a 16-ring lidar on a wall 3 m away)."""

MIN_POINTS = 2
"""Minimum number of points of a range: a single one may be a flying pixel."""

MIN_RANGE = 0.05
MAX_RANGE = 30.0
"""Range limits of the level scan, m."""


class LevelProjector:
    """Projects posed images or clouds to level scans.

    Parameters
    ----------
    config
        Group `sensors`.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        kinds = {"points": PosedCloud, "depth": PosedImage, "none": None}
        self._kind: type[Posed] | None = kinds[config.sensors.level_from]

    @property
    def is_on(self) -> bool:
        """Whether level scans are enabled."""
        return self._kind is not None

    def project(self, event: Event) -> Scan | None:
        """Return the level scan of a posed record; None for other events."""
        if self._kind is None or not isinstance(event, self._kind):
            return None
        points = self._points(event)
        points = transform(inverse(event.T_odom_base[_stamp_index(event)]), points)
        low, high = self._config.sensors.level_band
        ranges = nearest_ranges(np.ascontiguousarray(points), low, high).astype(np.float32)
        return Scan(
            event.stamp_ns,
            event.base_frame,
            -math.pi,
            BEARING_STEP,
            0.0,
            MIN_RANGE,
            MAX_RANGE,
            ranges,
        )

    def _points(self, posed: Posed) -> Float64:
        """Return all points in odom without the robot itself, including noisy ones."""
        if isinstance(posed, PosedImage):
            return seen_points(posed, self._config)
        assert isinstance(posed, PosedCloud)
        points, nothing = placed_points(posed, self._config).points, np.zeros((0, 3))
        measured = MeasuredPoints(points, None, nothing, nothing, np.zeros(0, np.bool_), 0.0)
        return without_robot(measured, posed, self._config).points


def _stamp_index(posed: Posed) -> int:
    """Return the index of the pose sample nearest to the record's stamp."""
    return int(np.argmin(np.abs(posed.pose_stamps_ns - posed.stamp_ns)))


@kernel
def nearest_ranges(points: Any, low: Any, high: Any) -> Any:
    """Return the ranges of a level scan around the base.

    Parameters
    ----------
    points
        float64 (N, 3), m, in the base frame.
    low, high
        Heights of the band, m.

    Returns
    -------
    float64 (BEAMS,), m: +inf where all points are outside the band, NaN where there are no points,
    or where all points in the band are on horizontal surfaces.
    """
    slabs = _slab(MAX_RANGE) + 2
    lowest = np.full((BEAMS, slabs), np.float32(np.inf))
    highest = np.full((BEAMS, slabs), np.float32(-np.inf))
    total, count = np.zeros((BEAMS, slabs)), np.zeros((BEAMS, slabs), np.int32)
    ranges = np.full(BEAMS, np.nan)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        r = np.sqrt(x * x + y * y)
        beam = np.int32(np.floor((np.arctan2(y, x) + np.pi) / BEARING_STEP + 0.5)) % BEAMS
        if not (low <= z <= high and MIN_RANGE < r < MAX_RANGE):
            ranges[beam] = np.inf
            continue
        k = _slab(r)
        lowest[beam, k] = min(lowest[beam, k], z)
        highest[beam, k] = max(highest[beam, k], z)
        total[beam, k] += r
        count[beam, k] += 1
    for b in range(BEAMS):
        for k in range(slabs - 1):
            n = count[b, k] + count[b, k + 1]
            if n > 0:
                ranges[b] = np.nan
            extent = max(highest[b, k], highest[b, k + 1]) - min(lowest[b, k], lowest[b, k + 1])
            if n >= MIN_POINTS and extent >= MIN_EXTENT:
                ranges[b] = (total[b, k] + total[b, k + 1]) / n
                break
    return ranges


@kernel
def _slab(r: Any) -> Any:
    """Return the bin of a range: uniform in range, then in inverse range."""
    if r < NEAR:
        return np.int64(r / SLAB)
    return np.int64(NEAR / SLAB + (1.0 / NEAR - 1.0 / r) / SLAB_PER_RANGE_SQUARED)
