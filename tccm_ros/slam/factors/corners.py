"""Factors of corners: observations by keyframes, and incidence with walls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key, rotation_z
from tccm_ros.slam.factors.noise import OPEN_SIGMA, gaussian, planar_covariance

CORNER_LEVEL = 1e-3
"""Standard deviation of roll, pitch (rad) and z (m) of a corner, which are zero (chosen)."""

HEADING_VARIANCE = 1.0
"""Variance of a corner's heading, rad^2; the heading is meaningless, but must be determined
(chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class CornerObservation:
    """An observation of a corner by a keyframe.

    A corner is a planar pose with a meaningless heading.

    Attributes
    ----------
    keyframe, corner
        Variables.
    point
        float64 (2,), the corner in the keyframe's base frame, m.
    sigma
        Standard deviation of `point` in x and y, m.
    """

    keyframe: Key
    corner: Key
    point: Float64
    sigma: float

    @property
    def landmark(self) -> Key:
        """The variable of the corner."""
        return self.corner

    def _pose(self) -> Float64:
        return spatial(np.array([self.point[0], self.point[1], 0.0]))

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor without a measurement of the corner's heading."""
        level = (CORNER_LEVEL, CORNER_LEVEL, CORNER_LEVEL)
        cov = planar_covariance(np.diag([self.sigma**2, self.sigma**2, HEADING_VARIANCE]), level)
        delta = gtsam.Pose3(rotation_z(-self.keyframe.yaw_offset) @ self._pose())
        keys = self.keyframe.symbol, self.corner.symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, delta, gaussian(cov)))

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return the corner as seen by this factor as start value."""
        return [(self.corner, gtsam.Pose3(pose_of(self.keyframe) @ self._pose()))]


@dataclass(frozen=True, slots=True, eq=False)
class WallThroughCorner(NoLandmark):
    """A wall passes through a corner.

    Attributes
    ----------
    corner, wall
        Variables.
    phi
        Direction of the wall's normal in map, rad.
    sigma
        Standard deviation of the corner's distance from the wall, m.
    """

    corner: Key
    wall: Key
    phi: float
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor without a measurement of the angle."""
        measured = np.array([np.cos(self.phi), np.sin(self.phi), 0.0, 0.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([OPEN_SIGMA, OPEN_SIGMA, self.sigma]))
        keys = self.corner.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, noise, *keys))
