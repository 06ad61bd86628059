"""Factors of keyframe poses: priors, planar motion, and relative poses."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key, rotation_z
from tccm_ros.slam.factors.noise import (
    FREE_POSITION_SIGMA,
    LOOSE_SIGMA,
    OPEN_SIGMA,
    PLANAR_SIGMA,
    gaussian,
    huber,
    planar_covariance,
    rotate_frame,
)


@dataclass(frozen=True, slots=True, eq=False)
class PriorPose(NoLandmark):
    """A prior on the pose of a keyframe.

    Attributes
    ----------
    key
        Variable of the keyframe.
    pose
        float64 (3,), planar pose in map, m and rad.
    cov
        float64 (3, 3) of (x, y, yaw) in the keyframe's own frame.
    is_robust
        Whether to use a robust (Huber) noise model.
    """

    key: Key
    pose: Float64
    cov: Float64
    is_robust: bool = False

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior, which also keeps roll, pitch and z at zero."""
        cov = rotate_frame(self.cov, self.key.yaw_offset)
        plain = gaussian(planar_covariance(cov, (PLANAR_SIGMA,) * 3))
        noise = huber(plain) if self.is_robust else plain
        value = self.key.to_value(spatial(self.pose))
        graph.add(gtsam.PriorFactorPose3(self.key.symbol, value, noise))


@dataclass(frozen=True, slots=True, eq=False)
class Planar(NoLandmark):
    """Zero roll, pitch and z of a keyframe; (x, y, yaw) remain free.

    Attributes
    ----------
    key
        Variable of the keyframe.
    pose
        float64 (3,), planar pose in map near the estimate, m and rad.
    """

    key: Key
    pose: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior at `pose` without a measurement of (x, y, yaw)."""
        roll_pitch_yaw = PLANAR_SIGMA, PLANAR_SIGMA, OPEN_SIGMA
        sigmas = np.array([*roll_pitch_yaw, FREE_POSITION_SIGMA, FREE_POSITION_SIGMA, PLANAR_SIGMA])
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        value = self.key.to_value(spatial(self.pose))
        graph.add(gtsam.PriorFactorPose3(self.key.symbol, value, noise))


@dataclass(frozen=True, slots=True, eq=False)
class BetweenKeyframes(NoLandmark):
    """The relative pose of two keyframes: odometry, matching or a loop closure.

    Attributes
    ----------
    a, b
        Variables of the keyframes.
    delta
        float64 (3,), planar pose of `b` in `a`, m and rad.
    cov
        float64 (3, 3) of (x, y, yaw) in the frame of `b`.
    weight
        Factor on the information; GNC changes it for loop closures between optimisations.
    """

    a: Key
    b: Key
    delta: Float64
    cov: Float64
    weight: float = 1.0

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor with loose roll, pitch and z, which `Planar` fixes."""
        cov = rotate_frame(np.asarray(self.cov) / self.weight, self.b.yaw_offset)
        noise = gaussian(planar_covariance(cov, (LOOSE_SIGMA,) * 3))
        delta = gtsam.Pose3(
            rotation_z(-self.a.yaw_offset) @ spatial(self.delta) @ rotation_z(self.b.yaw_offset)
        )
        graph.add(gtsam.BetweenFactorPose3(self.a.symbol, self.b.symbol, delta, noise))
