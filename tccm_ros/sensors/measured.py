"""Measured points of one record, and its rays through free space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.kernels import kernel
from tccm_ros.records import Posed, SelfShapes
from tccm_ros.sensors.laser_scan_kernels import mark_inside


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPoints:
    """The thinned points of one record in odom, and a sample of its rays.

    Attributes
    ----------
    points
        float64 (N, 3), m, in odom.
    stamps_ns
        int64 (N,), time of each point; None if all points have the record's stamp.
    origins, ends
        float64 (L, 3), m, in odom: start and end of each ray.
    hits
        bool (L,), whether the ray ends on a surface.
    line_angle
        Angle between neighbouring rays, rad.
    gaps
        float64 (N,), distance of each point to the next scan line, m; None for dense points.
    """

    points: Float64
    stamps_ns: Int64 | None
    origins: Float64
    ends: Float64
    hits: Bool
    line_angle: float
    gaps: Float64 | None = None

    def chosen(self, keep: Bool) -> MeasuredPoints:
        """Return a copy with the points of a mask, and all rays."""
        if keep.all():
            return self
        stamps_ns = None if self.stamps_ns is None else self.stamps_ns[keep]
        gaps = None if self.gaps is None else self.gaps[keep]
        points = kept_rows(np.ascontiguousarray(self.points), keep)
        return replace(self, points=points, stamps_ns=stamps_ns, gaps=gaps)


def without_robot(measured: MeasuredPoints, posed: Posed, config: Config) -> MeasuredPoints:
    """Return the points outside the robot's own shapes.

    Parameters
    ----------
    measured
        Points in odom.
    posed
        The posed record, with the robot's shapes at its stamp.
    config
        Group `scan`: `self_padding`.
    """
    shapes = posed.own_shapes
    if shapes is None or not len(shapes.kinds) or not len(measured.points):
        return measured
    T_odom_shape = posed.T_odom_base[0] @ shapes.T_base_shape
    padding = config.scan.self_padding
    on_robot = _near_and_inside(measured.points, T_odom_shape, shapes, padding)
    ends = _near_and_inside(measured.ends, T_odom_shape, shapes, padding)
    kept = measured.chosen(~on_robot)
    if not ends.any():
        return kept
    return replace(
        kept, origins=measured.origins[~ends], ends=measured.ends[~ends], hits=measured.hits[~ends]
    )


def _near_and_inside(
    points: Float64, T_odom_shape: Float64, shapes: SelfShapes, padding: float
) -> Bool:
    """Return a mask of the points (N, 3) inside a shape; a common bounding box is tested first."""
    radius = np.linalg.norm(shapes.half + padding, axis=1)[:, None]
    low = (T_odom_shape[:, :3, 3] - radius).min(axis=0)
    high = (T_odom_shape[:, :3, 3] + radius).max(axis=0)
    inside = np.zeros(len(points), np.bool_)
    near = np.flatnonzero(mark_within(points, low, high))
    if len(near):
        T_shape_odom = inverse(T_odom_shape)
        inside[near] = mark_inside(points[near], shapes.kinds, shapes.half, T_shape_odom, padding)
    return inside


def in_region(measured: MeasuredPoints, posed: Posed, config: Config) -> MeasuredPoints:
    """Return the points within `map.region`.

    Parameters
    ----------
    measured
        Points in odom.
    posed
        The posed record, for its base pose if the region is in the base frame.
    config
        Group `map`: `region` and `region_frame`.
    """
    region = config.map.region
    if region is None:
        return measured
    points = measured.points
    if config.map.region_frame == "base":
        points = transform(inverse(posed.T_odom_base[len(posed.T_odom_base) // 2]), points)
    return measured.chosen(mark_within(points, np.array(region[::2]), np.array(region[1::2])))


@kernel
def kept_rows(points: Any, keep: Any) -> Any:
    """Return the rows of points (N, 3) for which `keep`, bool (N,), is True; fast indexing."""
    n = 0
    for i in range(len(keep)):
        n += keep[i]
    rows, k = np.empty((n, 3)), 0
    for i in range(len(keep)):
        if keep[i]:
            rows[k, 0], rows[k, 1], rows[k, 2] = points[i, 0], points[i, 1], points[i, 2]
            k += 1
    return rows


@kernel
def mark_within(points: Any, low: Any, high: Any) -> Any:
    """Return a mask (N,) of the points (N, 3) between two corners (3,); NaN is outside."""
    within = np.empty(len(points), np.bool_)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        within[i] = (
            (low[0] <= x) & (x <= high[0]) & (low[1] <= y) & (y <= high[1])
            & (low[2] <= z) & (z <= high[2])
        )  # fmt: skip
    return within
