"""Factors of door signs: bearings from pictures, and incidence with walls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import pose
from tccm_ros.records import SIGN
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.factors.landmarks import LandmarkFactor, register_landmark
from tccm_ros.slam.factors.noise import gaussian, huber

START_RANGE = 2.0
"""Range (m) of the start value from a single bearing (chosen: readable plates are near)."""

_NORMALISED = gtsam.Cal3_S2(1.0, 1.0, 0.0, 0.0, 0.0)


@register_landmark
class SignBearing(LandmarkFactor):
    """The bearing of a sign in one picture: the projection of a point into a camera.

    The measurement is (x, y, z, dx, dy, dz): position of the camera in the base, m, and unit vector
    from it to the sign, in the base frame. The camera is rotated about its position to look along
    that vector: the projection residual is then the angle between bearing and sign, rad,
    independent of the lens. Robust (Huber).
    """

    kind, letter = SIGN, "g"

    def T_base_camera(self) -> Float64:
        """Return the pose (4, 4) in the base of a camera that looks along the bearing."""
        return pose(tangents(self.measurement[3:]), self.measurement[:3])

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a projection factor; a point behind the camera has the error of a right angle."""
        T = self.T_base_camera()
        across = T[:3, :2]
        noise = huber(gaussian(across.T @ self.covariance[3:, 3:] @ across))
        keys = self.pose.symbol, self.landmark.symbol
        graph.add(
            gtsam.GenericProjectionFactorCal3_S2(
                np.zeros(2), noise, *keys, _NORMALISED, False, False, gtsam.Pose3(T)
            )
        )

    def start(self, T_map_base: Float64) -> Float64:
        """Return a point on the bearing."""
        point = self.measurement[:3] + START_RANGE * self.measurement[3:]
        return np.asarray(T_map_base[:3, :3] @ point + T_map_base[:3, 3])


def tangents(direction: Float64) -> Float64:
    """Return a rotation (3, 3) whose third column is a unit vector (3,)."""
    first = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first), direction], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class SignStart(NoLandmark):
    """Start value of a sign, its triangulated point; adds no factor.

    Attributes
    ----------
    sign
        Variable.
    position
        float64 (3,), in map, m.
    """

    sign: Key
    position: Float64

    @property
    def landmark(self) -> Key:
        """The variable of the sign."""
        return self.sign

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add no factor."""

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return the point as start value."""
        return [(self.sign, self.position)]


@dataclass(frozen=True, slots=True, eq=False)
class SignOnWall(NoLandmark):
    """Incidence of a sign and its wall.

    The residual is the distance ``n . p + d`` (m) of the point p from the plane (n, d). With B the
    basis (3, 2) of the tangents of n, its derivatives are n by p, and (p B, 1) by the plane.

    Attributes
    ----------
    sign, wall
        Variables.
    sigma
        Standard deviation of the distance, m.
    """

    sign: Key
    wall: Key
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a custom factor with residual and derivatives."""
        keys = self.sign.symbol, self.wall.symbol

        def residual(
            _: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Float64] | None
        ) -> Float64:
            point, plane = values.atPoint3(keys[0]), values.atOrientedPlane3(keys[1])
            *normal, offset = plane.planeCoefficients()
            if jacobians is not None:
                jacobians[0] = np.array([normal])
                jacobians[1] = np.array([[*(point @ plane.normal().basis()), 1.0]])
            return np.array([point @ np.array(normal) + offset])

        noise = huber(gtsam.noiseModel.Isotropic.Sigma(1, self.sigma))
        graph.add(gtsam.CustomFactor(noise, list(keys), residual))
