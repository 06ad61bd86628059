"""Factors of wall observations by keyframes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.factors.noise import gaussian


@dataclass(frozen=True, slots=True, eq=False)
class WallObservation:
    """An observation of a wall by a keyframe.

    phi points from the robot through the wall, so that the two sides of a wall are two walls.

    Attributes
    ----------
    keyframe, wall
        Variables.
    phi, rho
        The line ``x cos phi + y sin phi = rho`` in the keyframe's base frame, rad and m.
    cov
        float64 (2, 2) of (phi, rho), with the correlation (docs/design/wall_slam.md, "Noise of a
        line").
    """

    keyframe: Key
    wall: Key
    phi: float
    rho: float
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor; its residual is (-sin dphi, 0, drho)."""
        v_phi, c, v_rho = self.cov[0, 0], self.cov[0, 1], self.cov[1, 1]
        cov = np.array([[v_phi, 0.0, -c], [0.0, v_phi, 0.0], [-c, 0.0, v_rho]])
        phi = self.phi - self.keyframe.yaw_offset
        measured = np.array([np.cos(phi), np.sin(phi), 0.0, -self.rho])
        keys = self.keyframe.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, gaussian(cov), *keys))

    @property
    def landmark(self) -> Key:
        """The variable of the wall."""
        return self.wall

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return the wall as seen by this factor as start value."""
        T = pose_of(self.keyframe)
        normal = T[:3, :3] @ np.array([np.cos(self.phi), np.sin(self.phi), 0.0])
        rho = self.rho + normal @ T[:3, 3]
        return [(self.wall, gtsam.OrientedPlane3(np.array([normal[0], normal[1], 0.0, -rho])))]
