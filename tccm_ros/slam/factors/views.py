"""Factors of views: anchored to keyframes, and registered to each other."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.base_attitude import LEVEL, Attitude, with_attitude
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key, rotation_z
from tccm_ros.slam.factors.noise import gaussian, huber, planar_covariance

Z_ROLL_PITCH_SIGMAS = (0.005, 0.00524, 0.00524)
"""Standard deviations of z (m), roll and pitch (rad) of a moving base: 5 mm and 0.3 deg (chosen;
docs/design/wall_slam.md, "Views in the graph")."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeView(NoLandmark):
    """The pose of a view, anchored to a keyframe.

    Attributes
    ----------
    keyframe, view
        Variables.
    delta
        float64 (3,), planar pose of the view in the keyframe, m and rad.
    cov
        float64 (3, 3) of (x, y, yaw) in the view's frame.
    sigma_z_roll_pitch
        Standard deviations of the view's z (m), roll and pitch (rad) relative to the keyframe,
        whose are zero.
    attitude
        z (m), roll and pitch (rad) of the view; 0 where unknown.
    """

    keyframe: Key
    view: Key
    delta: Float64
    cov: Float64
    sigma_z_roll_pitch: tuple[float, float, float] = Z_ROLL_PITCH_SIGMAS
    attitude: Attitude = LEVEL

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor in all six degrees of freedom."""
        noise = gaussian(planar_covariance(np.asarray(self.cov), self.sigma_z_roll_pitch))
        T = with_attitude(self.delta, self.attitude)
        delta = gtsam.Pose3(rotation_z(-self.keyframe.yaw_offset) @ T)
        keys = self.keyframe.symbol, self.view.symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, delta, noise))


@dataclass(frozen=True, slots=True, eq=False)
class BetweenViews(NoLandmark):
    """The registration of two views; robust (Huber).

    Attributes
    ----------
    i, j
        Variables of the views.
    T_i_j
        float64 (4, 4), pose of view j in view i.
    cov
        float64 (6, 6) of (roll, pitch, yaw, x, y, z) in j's frame, rad and m.
    """

    i: Key
    j: Key
    T_i_j: Float64
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a robust between factor."""
        noise = huber(gaussian(self.cov))
        keys = self.i.symbol, self.j.symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, gtsam.Pose3(np.asarray(self.T_i_j)), noise))
