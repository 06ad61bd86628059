"""The outline of the approached surface, in the plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.geometry import compose2, transform2, wrap_angle

OWN_M = 0.06
"""Points within this of the outline belong to the surface, m: the middle of a cube of ~/obstacles
is up to 4 cm from a point in it, and 2 cm are the error of the pose."""

STEP_M = 0.05
"""Spacing of the candidate points along an edge, m: the edge of a cell of the occupancy grid."""


@dataclass(frozen=True, eq=False)
class Target:
    """The top of a piece of furniture.

    Attributes
    ----------
    outline
        float64 (N, 2), counter-clockwise, m.
    pose
        float64 (3,), pose of the surface's own frame: its middle, x along its longer side.
    height
        Height of the top over z = 0 of the base frame, m.
    is_round
        Whether the outline is a circle.
    """

    outline: Float64
    pose: Float64
    height: float
    is_round: bool = False

    def moved(self, motion: Float64) -> Target:
        """Return the target after a rigid motion (3,), which moves a point p to motion * p."""
        outline = transform2(motion, self.outline)
        return Target(outline, compose2(motion, self.pose), self.height, self.is_round)

    @cached_property
    def polygon(self) -> Polygon:
        """The outline as a valid polygon."""
        polygon = shapely.make_valid(Polygon(self.outline))
        shapely.prepare(polygon)
        return polygon

    @cached_property
    def own_region(self) -> Polygon:
        """The polygon grown by `OWN_M`: obstacles in it belong to the surface."""
        region = self.polygon.buffer(OWN_M)
        shapely.prepare(region)
        return region

    @property
    def middle(self) -> Float64:
        """The middle (2,) of a round top."""
        return np.asarray(self.outline.mean(axis=0))

    @property
    def radius(self) -> float:
        """Radius of a round top, m: that of the circle of the same area."""
        return float(np.sqrt(Polygon(self.outline).area / np.pi))

    @cached_property
    def edge_points(self) -> tuple[Float64, Float64, Float64]:
        """The candidate points of an approach on the outline.

        Returns
        -------
        points : float64 (M, 2)
            On the outline, `STEP_M` from each other or nearer.
        normals : float64 (M, 2)
            Outwards, of unit length.
        off_middle : float64 (M,)
            Distance from the middle of their side, m; 0 on a round top.
        """
        if self.is_round:
            count = max(int(2.0 * np.pi * self.radius / STEP_M), 8)
            angles = np.arange(count) * 2.0 * np.pi / count + self.pose[2]
            outwards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            return self.middle + self.radius * outwards, outwards, np.zeros(count)
        points: list[Float64] = []
        normals: list[Float64] = []
        off: list[Float64] = []
        ends = np.roll(self.outline, -1, axis=0)
        for start, end in zip(self.outline, ends):
            length = float(np.hypot(*(end - start)))
            if length < STEP_M:
                continue
            count = int(length / STEP_M) | 1  # the middle is one of them
            along = (np.arange(count) + 0.5) * length / count
            unit = (end - start) / length
            points.append(start + along[:, None] * unit)
            normals.append(np.tile([unit[1], -unit[0]], (count, 1)))
            off.append(np.abs(along - 0.5 * length))
        if not points:
            return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
        return np.concatenate(points), np.concatenate(normals), np.concatenate(off)

    def side_of(self, normals: Float64, side: float) -> Float64:
        """Return angles (M,) between normals (M, 2) and a direction in the surface's frame, rad."""
        wanted = self.pose[2] + side
        return np.abs(wrap_angle(np.arctan2(normals[:, 1], normals[:, 0]) - wanted))
