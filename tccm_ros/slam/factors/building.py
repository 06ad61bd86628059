"""Structure prior: walls parallel or perpendicular to a building's frame."""

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
from tccm_ros.slam.factors.noise import OPEN_SIGMA, PLANAR_SIGMA
from tccm_ros.slam.factors.poses import PriorPose


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """The building's frame at the map's origin, with unknown yaw.

    Attributes
    ----------
    key
        Variable of the frame.
    yaw
        Start value in map, rad.
    """

    key: Key
    yaw: float

    @property
    def landmark(self) -> Key:
        """The variable of the frame."""
        return self.key

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior that fixes the position and leaves the yaw free."""
        cov = np.diag([PLANAR_SIGMA**2, PLANAR_SIGMA**2, OPEN_SIGMA**2])
        PriorPose(self.key, np.array([0.0, 0.0, self.yaw]), cov).add_to(graph)

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return `yaw` as start value."""
        return [(self.key, self.key.to_value(spatial(np.array([0.0, 0.0, self.yaw]))))]


@dataclass(frozen=True, slots=True, eq=False)
class WallDirection(NoLandmark):
    """The direction of a wall's normal in the building's frame.

    The building's yaw is a variable, so that the prior constrains walls relative to each other and
    not to the map's axes.

    Attributes
    ----------
    building, wall
        Variables.
    angle
        Direction of the normal in the building's frame, rad.
    sigma
        Standard deviation of the angle, rad.
    """

    building: Key
    wall: Key
    angle: float
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor without a measurement of the distance."""
        angle = self.angle - self.building.yaw_offset
        measured = np.array([np.cos(angle), np.sin(angle), 0.0, 0.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([self.sigma, self.sigma, OPEN_SIGMA]))
        keys = self.building.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, noise, *keys))
