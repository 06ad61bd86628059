"""Errors of measured points: independent for each point, and common to all points of a view.

A point's error has three parts. White noise is independent between points: an average over N points
has 1 / N of its variance. A systematic part is common to all points of a view: a range error of the
form ``offset + scale r + bend r^2``, and an error of the sensor's direction. Averaging does not
reduce it. The error of the view's pose is also common to them, and is known from the graph.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import SensorKind

LASER_SIGMA = 0.008
"""Standard deviation of a range of lasers, m: as in `calibrate.layout`."""


def range_sigma(distance: float, sensor: SensorKind, config: Config) -> float:
    """Return the standard deviation of a range, m.

    Parameters
    ----------
    distance
        Distance of the point, m.
    sensor
        Kind of sensor.
    config
        Uses `sensors.depth_sigma`.
    """
    if sensor != SensorKind.DEPTH_IMAGE:
        return LASER_SIGMA
    return float(depth_noise(np.array(distance), config))


def depth_noise(depth: Float64, config: Config) -> Float64:
    """Return the standard deviation of depths, m, by `sensors.depth_sigma`."""
    a, b, c = config.sensors.depth_sigma
    return np.asarray(a + b * (depth - c) ** 2)


def systematic_errors(
    points: Float64, viewpoint: Float64, sensor: SensorKind, config: Config
) -> Float64:
    """Return the displacement of points by one sigma of each systematic error.

    The systematic errors are independent of each other: the covariance between points i and j is
    the sum of ``e[i, k] e[j, k]'`` over the errors k.

    Parameters
    ----------
    points
        float64 (N, 3), m.
    viewpoint
        float64 (3,), position of the sensor in the same frame.
    sensor
        Kind of sensor.
    config
        Group `sensors`: `laser_systematic`, `depth_systematic` and `cloud_systematic`.

    Returns
    -------
    float64 (N, 5, 3), m: displacement of each point by each error (offset, scale, bend, and
    rotations of the sensor about x and y)
    """
    sigmas = {
        SensorKind.LASER: config.sensors.laser_systematic,
        SensorKind.DEPTH_IMAGE: config.sensors.depth_systematic,
        SensorKind.POINT_CLOUD: config.sensors.cloud_systematic,
    }[sensor]
    beams = np.asarray(points, float) - viewpoint
    ranges = np.linalg.norm(beams, axis=1)
    rays = beams / np.maximum(ranges, np.finfo(float).tiny)[:, None]
    terms = np.stack([np.ones_like(ranges), ranges, ranges**2], axis=1) * sigmas[:3]
    rotations = np.cross(sigmas[3] * np.eye(3)[:2], beams[:, None])
    return np.concatenate([terms[:, :, None] * rays[:, None, :], rotations], axis=1)
