"""Model of a spinning lidar: rings of lasers rotating about an axis, each shot at its own time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.random import Generator

from tccm_ros.arrays import Float32, Float64, Int64
from tccm_sim.lasers import Laser, measure


@dataclass(frozen=True)
class SpinningLidar:
    """Lasers stacked vertically that rotate together.

    Attributes
    ----------
    laser
        Model of all rings: bearings and times of one revolution, limits and noise.
    elevations
        Elevations of the rings, rad.
    """

    laser: Laser
    elevations: tuple[float, ...]

    @cached_property
    def rays(self) -> Float64:
        """Unit vectors, float64 (beams * rings, 3): all rings of a bearing, then of the next."""
        elevations = np.array(self.elevations)
        azimuths = np.repeat(self.laser.bearings, len(elevations))
        elevations = np.tile(elevations, self.laser.beams)
        cosines = np.cos(elevations)
        return np.stack(
            [cosines * np.cos(azimuths), cosines * np.sin(azimuths), np.sin(elevations)], axis=-1
        )


def measure_points(
    lidar: SpinningLidar, exact: Float64, random: Generator
) -> tuple[Float32, Int64]:
    """Return the measured points, those with a return, in order of time.

    Parameters
    ----------
    lidar
        The lidar.
    exact
        float64 (beams * rings,), distance along each of the rays, m; +inf without a hit.
    random
        Random generator of noise; the number of draws does not depend on the ranges.

    Returns
    -------
    points, since_ns
        float32 (N, 3) in the lidar's frame, m, and int64 (N,), ns after the first shot.
    """
    ranges = measure(lidar.laser, exact, None, random)
    seen = np.isfinite(ranges) & (ranges > 0.0)
    points = lidar.rays[seen] * ranges[seen, None]
    since_ns = np.round(np.repeat(lidar.laser.offsets, len(lidar.elevations))[seen] * 1e9)
    return points.astype(np.float32), since_ns.astype(np.int64)
