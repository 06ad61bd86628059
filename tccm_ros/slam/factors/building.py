"""The building's own frame: walls that are parallel or at right angles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.factors.noise import BLIND, PLANAR_SIGMA
from tccm_ros.slam.factors.poses import PriorPose

__all__ = ["Building", "WallDirection"]


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """The building's own frame: a heading `yaw` (rad, a start value) that walls share."""

    key: Key
    yaw: float

    @property
    def landmark(self) -> Key:
        """The frame."""
        return self.key

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior that holds the frame at the origin and leaves its heading free."""
        cov = np.diag([PLANAR_SIGMA**2, PLANAR_SIGMA**2, BLIND**2])
        PriorPose(self.key, np.array([0.0, 0.0, self.yaw]), cov).add_to(graph)

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start at `yaw`."""
        return [(self.key, self.key.turned(spatial(np.array([0.0, 0.0, self.yaw]))))]


@dataclass(frozen=True, slots=True, eq=False)
class WallDirection(NoLandmark):
    """The structure prior: a wall's normal is at `angle` (rad) in the building's own frame.

    The building's frame is a pose whose heading is estimated with everything else, so the prior
    ties walls to each other and none to the map's axes.
    """

    building: Key
    wall: Key
    angle: float
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor that is blind to the distance."""
        angle = self.angle - self.building.turn
        measured = np.array([np.cos(angle), np.sin(angle), 0.0, 0.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([self.sigma, self.sigma, BLIND]))
        keys = self.building.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, noise, *keys))
