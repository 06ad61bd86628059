"""Errors of measured points, of each alone and of all points of a view together.

A point's error has three parts. White noise is independent from point to point, and an average over
N points has 1 / N of its variance. A systematic part is shared by all points of a view: an error of
the range of the form ``offset + scale r + bend r^2``, and one of the sensor's direction. No number
of points makes it smaller. The error of the view's pose is shared by them, too, and is known from
the graph.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import SensorKind


def systematic_errors(
    points: Float64, viewpoint: Float64, sensor: SensorKind, config: Config
) -> Float64:
    """Return how points move where one part of the systematic error is off by one sigma.

    The parts are independent of each other: the covariance that points i and j share is the sum of
    ``e[i, k] e[j, k]'`` over the parts k.

    Parameters
    ----------
    points
        float64 (N, 3), m.
    viewpoint
        float64 (3,), position of the sensor in the same frame.
    sensor
        Kind of the sensor.
    config
        Uses `sensors.laser_systematic`, `sensors.depth_systematic` and `sensors.cloud_systematic`.

    Returns
    -------
    float64 (N, 5, 3), m: for each point and each part (offset, scale, bend, and rotations of the
    sensor about x and y) a displacement
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
