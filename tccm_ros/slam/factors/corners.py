"""Corners: where walls meet, as keyframes see them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key, turn_matrix
from tccm_ros.slam.factors.noise import BLIND, gaussian, planar_covariance

__all__ = ["CornerObservation", "WallThroughCorner"]


CORNER_LEVEL = 1e-3
"""Roll, pitch (rad) and z (m) of a corner, which has none of them."""


@dataclass(frozen=True, slots=True, eq=False)
class CornerObservation:
    """Keyframe `keyframe` saw a corner at `point` (2,), m, in its base frame.

    `sigma` is its standard deviation in x and y, m. A corner is a level pose whose heading means
    nothing.
    """

    keyframe: Key
    corner: Key
    point: Float64
    sigma: float

    @property
    def landmark(self) -> Key:
        """The corner."""
        return self.corner

    def _pose(self) -> Float64:
        return spatial(np.array([self.point[0], self.point[1], 0.0]))

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor that is blind to the corner's heading."""
        level = (CORNER_LEVEL, CORNER_LEVEL, CORNER_LEVEL)
        cov = planar_covariance(np.diag([self.sigma**2, self.sigma**2, 1.0]), level)
        delta = gtsam.Pose3(turn_matrix(-self.keyframe.turn) @ self._pose())
        keys = self.keyframe.symbol, self.corner.symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, delta, gaussian(cov)))

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start the corner where the first of its factors sees it."""
        return [(self.corner, gtsam.Pose3(pose_of(self.keyframe) @ self._pose()))]


@dataclass(frozen=True, slots=True, eq=False)
class WallThroughCorner(NoLandmark):
    """A wall passes through a corner within `sigma`, m; `phi` is its normal's direction in map."""

    corner: Key
    wall: Key
    phi: float
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor that is blind to the angle."""
        measured = np.array([np.cos(self.phi), np.sin(self.phi), 0.0, 0.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([BLIND, BLIND, self.sigma]))
        keys = self.corner.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, noise, *keys))
