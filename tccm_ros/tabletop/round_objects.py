"""Boxes and vertical cylinders around footprints of objects.

An object whose footprint is round on the side that was seen is a cylinder.

The circle is the least-squares one of the corners of the convex hull (Kasa, A circle fitting
procedure and its error analysis, IEEE Transactions on Instrumentation and Measurement 25, 1976).
The chord that closes a half-seen hull has no corners, so the circle also covers the side that was
not seen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely

from tccm_ros.arrays import Float64
from tccm_ros.tabletop.footprints import convex_hull, rectangle

ROUND = 0.12
"""Maximum distance of a hull from its circle, as a fraction of the radius: the sides of a hexagon
are 13 % inside the circle through its corners, those of a heptagon 10 %."""

MIN_ARC = math.pi
"""Minimum angle of the circle that the hull follows without a gap, rad: as much of a cylinder as
one view sees. In bags/flat, hulls of boxes follow at most 155 deg."""

SAMPLES = 72
"""Number of samples of a circle; chosen: 5 deg."""


class Circle(NamedTuple):
    """A circle seen from above.

    Attributes
    ----------
    x, y
        Its centre, m.
    radius
        m.
    """

    x: float
    y: float
    radius: float


class PlanShape(NamedTuple):
    """A footprint's smallest rectangle, or its circle.

    Attributes
    ----------
    x, y
        Its centre, m.
    length, width
        Edges along its own x and y, m; both are the diameter of a circle.
    yaw
        Yaw of its x axis, in (-pi/2, pi/2], rad.
    is_round
        Whether it is a circle.
    """

    x: float
    y: float
    length: float
    width: float
    yaw: float
    is_round: bool


def plan_shape(hull: Float64) -> PlanShape:
    """Return the circle that a convex hull (H, 2), H > 2, follows, or its smallest rectangle."""
    circle = round_footprint(hull)
    if circle is None:
        return PlanShape(*rectangle(hull), False)
    return PlanShape(circle.x, circle.y, 2.0 * circle.radius, 2.0 * circle.radius, 0.0, True)


def round_footprint(hull: Float64) -> Circle | None:
    """Return the circle that a convex hull (H, 2), H > 2, follows over `MIN_ARC`; None: none."""
    middle = hull.mean(axis=0)
    local = hull - middle
    A = np.column_stack([2.0 * local, np.ones(len(local))])
    (x, y, c), *_ = np.linalg.lstsq(A, (local**2).sum(axis=1), rcond=None)
    radius = math.sqrt(c + x * x + y * y)
    angles = np.arange(SAMPLES) * (2.0 * math.pi / SAMPLES)
    points = [x, y] + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    far = shapely.distance(shapely.points(points), shapely.LinearRing(local)) > ROUND * radius
    if far.any():
        gaps = np.diff(np.flatnonzero(np.concatenate([far, far])))
        if (gaps.max() - 1) * (2.0 * math.pi / SAMPLES) < MIN_ARC:
            return None
    return Circle(float(x + middle[0]), float(y + middle[1]), radius)


def rectangle_around(boundary: Float64) -> tuple[float, float, float, float, float]:
    """Return the smallest rectangle (`rectangle`) around a ring (N, 3), seen from above."""
    return rectangle(convex_hull(np.ascontiguousarray(boundary[:, :2])))
