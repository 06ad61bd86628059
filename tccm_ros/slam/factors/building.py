"""Structure prior: walls that are parallel or at right angles to a building's frame."""

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
    """The building's frame at the map's origin; its yaw is estimated.

    Attributes
    ----------
    key
        Its variable.
    yaw
        Start value in map, rad.
    """

    key: Key
    yaw: float

    @property
    def landmark(self) -> Key:
        """The frame."""
        return self.key

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior that holds the frame at the origin and leaves its heading free."""
        cov = np.diag([PLANAR_SIGMA**2, PLANAR_SIGMA**2, OPEN_SIGMA**2])
        PriorPose(self.key, np.array([0.0, 0.0, self.yaw]), cov).add_to(graph)

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start at `yaw`."""
        return [(self.key, self.key.to_value(spatial(np.array([0.0, 0.0, self.yaw]))))]


@dataclass(frozen=True, slots=True, eq=False)
class WallDirection(NoLandmark):
    """The direction of a wall's normal in the building's frame.

    The yaw of the building's frame is estimated with everything else, so that the prior constrains
    walls to each other and not to the map's axes.

    Attributes
    ----------
    building, wall
        Variables.
    angle
        Of the normal in the building's frame, rad.
    sigma
        Its standard deviation, rad.
    """

    building: Key
    wall: Key
    angle: float
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor that does not measure the distance."""
        angle = self.angle - self.building.yaw_offset
        measured = np.array([np.cos(angle), np.sin(angle), 0.0, 0.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([self.sigma, self.sigma, OPEN_SIGMA]))
        keys = self.building.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, noise, *keys))
