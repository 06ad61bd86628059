"""Level scans of robots without a level laser, projected from depth images or point clouds.

For each bearing in the base frame the nearest of what was seen within a band of heights is the
range, as pointcloud_to_laserscan does; it is the mean of the points near the nearest one, which
alone would be too near by the noise of many.
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
from tccm_ros.sensors.depth_image import PosedImage, seen_depths
from tccm_ros.sensors.measured import MeasuredPoints, without_robot
from tccm_ros.sensors.point_cloud import PosedCloud, placed_points

BEARING_STEP = math.radians(0.5)
"""Between the beams of the level scan, rad: as many level lasers have."""

BEAMS = 720
"""All around: what was not looked at is nan."""

SLAB = 0.06
"""What lies this far behind the nearest point belongs to the same surface, m,"""

SLAB_PER_RANGE_SQUARED = 0.012
"""and this more per range squared, 1/m: six times the noise of a depth camera."""

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
        self._kind: type[Posed] | None = kinds[config.sensors.level_from]

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
        if isinstance(posed, PosedCloud):
            points = placed_points(posed, self._config).points
        else:
            assert isinstance(posed, PosedImage)
            points = seen_depths(posed, self._config).points(1e6, 0.0)
        nothing = np.zeros((0, 3))
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
    float64 (BEAMS,), m: +inf where only what lies outside the band was seen, nan where nothing was.
    """
    nearest = np.full(BEAMS, np.nan)
    beams, ranges = np.empty(len(points), np.int32), np.empty(len(points))
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        ranges[i] = np.hypot(x, y)
        beams[i] = np.int32(np.floor((np.arctan2(y, x) + np.pi) / BEARING_STEP + 0.5)) % BEAMS
        inside = low <= z <= high and MIN_RANGE < ranges[i] < MAX_RANGE
        if not inside:
            ranges[i] = np.inf
        if not ranges[i] >= nearest[beams[i]]:
            nearest[beams[i]] = ranges[i]
    total, count = np.zeros(BEAMS), np.zeros(BEAMS, np.int64)
    for i in range(len(points)):
        near = nearest[beams[i]]
        if ranges[i] < np.inf and ranges[i] <= near + SLAB + SLAB_PER_RANGE_SQUARED * near * near:
            total[beams[i]] += ranges[i]
            count[beams[i]] += 1
    for k in range(BEAMS):
        if nearest[k] < np.inf:
            nearest[k] = total[k] / count[k] if count[k] >= MIN_POINTS else np.nan
    return nearest
