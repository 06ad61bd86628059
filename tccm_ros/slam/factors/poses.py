"""Keyframes: where the first is, that they are level, and how they lie to each other."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key, turn_matrix
from tccm_ros.slam.factors.noise import PLANAR_SIGMA, gaussian, planar_covariance, turn_covariance

__all__ = ["BetweenKeyframes", "Planar", "PriorPose"]


@dataclass(frozen=True, slots=True, eq=False)
class PriorPose(NoLandmark):
    """Where a keyframe is: planar pose (3,) and covariance (3, 3) of (x, y, yaw) in its frame."""

    key: Key
    pose: Float64
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior that also holds roll, pitch and z at zero."""
        cov = turn_covariance(self.cov, self.key.turn)
        noise = gaussian(planar_covariance(cov, (PLANAR_SIGMA,) * 3))
        value = self.key.turned(spatial(self.pose))
        graph.add(gtsam.PriorFactorPose3(self.key.symbol, value, noise))


@dataclass(frozen=True, slots=True, eq=False)
class Planar(NoLandmark):
    """A pose keeps roll, pitch and z at zero; (x, y, yaw) stay free."""

    key: Key
    pose: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior at the start value that is blind along the plane."""
        sigmas = np.array([PLANAR_SIGMA, PLANAR_SIGMA, 1e3, 1e6, 1e6, PLANAR_SIGMA])
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        value = self.key.turned(spatial(self.pose))
        graph.add(gtsam.PriorFactorPose3(self.key.symbol, value, noise))


@dataclass(frozen=True, slots=True, eq=False)
class BetweenKeyframes(NoLandmark):
    """Planar pose (3,) of `b` in `a`, with covariance (3, 3) of (x, y, yaw) in b's frame.

    `weight` scales the information: GNC reweights loop closures between optimisations.
    """

    a: Key
    b: Key
    delta: Float64
    cov: Float64
    weight: float = 1.0

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor; roll, pitch and z follow, loosely (`Planar` holds them)."""
        cov = turn_covariance(np.asarray(self.cov) / self.weight, self.b.turn)
        noise = gaussian(planar_covariance(cov, (1.0, 1.0, 1.0)))
        delta = gtsam.Pose3(
            turn_matrix(-self.a.turn) @ spatial(self.delta) @ turn_matrix(self.b.turn)
        )
        graph.add(gtsam.BetweenFactorPose3(self.a.symbol, self.b.symbol, delta, noise))
