"""Views: hung on keyframes, and registered to each other."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import NoLandmark
from tccm_ros.slam.factors.keys import Key, turn_matrix, view_key
from tccm_ros.slam.factors.noise import gaussian, huber, planar_covariance

__all__ = ["BetweenViews", "KeyframeView"]


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeView(NoLandmark):
    """A view hangs on a keyframe: planar pose (3,) of the view in it, covariance (3, 3).

    The view's z, roll and pitch are those of the (level) keyframe within `lean`: the base leans
    (DESIGN section 7: 5 mm and 0.3 deg).
    """

    keyframe: Key
    view: Key
    delta: Float64
    cov: Float64
    lean: tuple[float, float, float] = (0.005, 0.00524, 0.00524)

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor with the lean as sigmas of z, roll and pitch."""
        noise = gaussian(planar_covariance(np.asarray(self.cov), self.lean))
        delta = gtsam.Pose3(turn_matrix(-self.keyframe.turn) @ spatial(self.delta))
        keys = self.keyframe.symbol, self.view.symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, delta, noise))


@dataclass(frozen=True, slots=True, eq=False)
class BetweenViews(NoLandmark):
    """Registration of view `j` to view `i`: T_i_j (4, 4).

    `cov` is float64 (6, 6) of (roll, pitch, yaw, x, y, z) in j's frame, rad and m. The factor is
    robust (Huber).
    """

    i: int
    j: int
    T_i_j: Float64
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a robust between factor."""
        noise = huber(gaussian(self.cov))
        keys = view_key(self.i).symbol, view_key(self.j).symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, gtsam.Pose3(np.asarray(self.T_i_j)), noise))
