"""Level scans of robots without a level laser, projected from depth images or point clouds.

For each bearing in the base frame the range is that of the nearest vertical surface within a band
of heights: the mean of its points, of which the nearest alone would be too near by the noise of
many. A horizontal surface has no range: where the edge of the view cuts a table top, the nearest
point moves with the head, and a scan with such points moves a robot that stands.
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
"""Between the beams of the level scan, rad: as many level lasers have."""

BEAMS = 720
"""All around: what was not looked at is nan."""

SLAB, SLAB_PER_RANGE_SQUARED = 0.06, 0.012
"""Ranges are counted in slabs of this width, m, and of this more per range squared, 1/m, where that
is more: six times the noise of a depth camera."""

NEAR = math.sqrt(SLAB / SLAB_PER_RANGE_SQUARED)
"""From this range on, m, a step of the slabs is one of the inverse range."""

MIN_EXTENT = 0.1
"""A surface whose points reach this far in height, m, is vertical (chosen: more than the edge of a
table top, less than two rings of a lidar with 16 on a wall 3 m away)."""

MIN_POINTS = 2
"""Points that make a range: a single one may be a flying pixel."""

MIN_RANGE = 0.05
MAX_RANGE = 30.0
"""Limits of the level scan, m."""


class LevelProjector:
    """Makes level scans of posed images or clouds.

    Parameters
    ----------
    config
        Group `sensors`.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        kinds = {"points": PosedCloud, "depth": PosedImage, "none": None}
        source = "none" if config.localisation.is_external else config.sensors.level_from
        self._kind: type[Posed] | None = kinds[source]

    @property
    def is_on(self) -> bool:
        """Whether level scans are made."""
        return self._kind is not None

    def project(self, event: Event) -> Scan | None:
        """Return the level scan of a posed record, None for other events."""
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
        """Return what was seen, in odom, without the robot itself; noisy points too."""
        if isinstance(posed, PosedImage):
            return seen_points(posed, self._config)
        assert isinstance(posed, PosedCloud)
        points, nothing = placed_points(posed, self._config).points, np.zeros((0, 3))
        measured = MeasuredPoints(points, None, nothing, nothing, np.zeros(0, np.bool_), 0.0)
        return without_robot(measured, posed, self._config).points


def _stamp_index(posed: Posed) -> int:
    """Return the pose sample nearest to the record's stamp."""
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
    float64 (BEAMS,), m: +inf where only what lies outside the band was seen, nan where nothing was
    and where all that was seen in the band is horizontal.
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
    """Return the slab of a range: equal steps of the range, then of its inverse."""
    if r < NEAR:
        return np.int64(r / SLAB)
    return np.int64(NEAR / SLAB + (1.0 / NEAR - 1.0 / r) / SLAB_PER_RANGE_SQUARED)
