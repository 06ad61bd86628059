"""Planes of the published detectors as `PlaneFits`, for tracking and later steps."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, CuboidArrays, Cuboids
from tccm_ros.cuboids.moments import moments_about
from tccm_ros.planes import PlaneFits
from tccm_ros.planes.arrays import PLANE

Group = tuple[Int64, Float64, float]
"""The cuboids of a plane, its unit normal and its offset, ``normal . p = offset``, m."""


def fits_of_groups(
    cuboids: Cuboids, groups: Sequence[Group], config: Config, viewpoint: ArrayLike
) -> PlaneFits:
    """Return the planes found by a detector as `PlaneFits`.

    Parameters
    ----------
    cuboids
        The map.
    groups
        The planes; no cuboid is in two of them.
    config
        Uses `planes.min_points` and `planes.horizontal_angle`.
    viewpoint
        (3,), m: normals of planes that are not horizontal point towards it.

    Returns
    -------
    PlaneFits
        Planes with enough points, by falling support.
    """
    eye = np.ascontiguousarray(viewpoint, float)
    origin = np.rint(eye * TICKS_PER_M)
    moments = moments_about(CuboidArrays(*cuboids.arrays), origin)
    support = np.array([cuboids.count[members].sum() for members, _, _ in groups])
    order = np.argsort(-support, kind="stable")
    order = order[support[order] >= config.planes.min_points]
    labels, rows = np.full(len(cuboids), -1, np.int32), np.zeros(len(order), PLANE)
    for index, k in enumerate(order):
        members, normal, offset = groups[k]
        labels[members] = index
        pooled, row = moments[members].sum(axis=0), rows[index]
        is_horizontal = abs(normal[2]) >= math.cos(config.planes.horizontal_angle)
        side = normal[2] if is_horizontal else offset - normal @ eye
        sign = -1.0 if (side < 0.0) == is_horizontal else 1.0
        row["normal"], row["offset"] = sign * normal, sign * offset
        row["variances"] = _variances(pooled, normal, offset - normal @ (origin * TICK))
        row["support"], row["moments"] = support[k], pooled
        row["is_horizontal"] = is_horizontal
    return PlaneFits(cuboids, labels, rows, origin * TICK)


def _variances(moments: Float64, normal: Float64, offset: float) -> Float64:
    """Return the variances along the plane, falling, and across it, float64 (3,), m2."""
    mean = moments[1:4] / moments[0]
    upper = moments[4:] / moments[0]
    second = np.empty((3, 3))
    second[np.triu_indices(3)] = upper
    second.T[np.triu_indices(3)] = upper
    cov = second - np.outer(mean, mean)
    along = np.linalg.eigvalsh(cov)
    about = normal @ cov @ normal + (normal @ mean - offset) ** 2
    return np.array([along[2], along[1], max(float(about), 0.0)])
