"""Poses from an external localisation: its map -> odom over time."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import compose2, planar, wrap_angle
from tccm_ros.records import MapOdom
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.front_end import GraphKeyframe

ROUNDS = 10
"""Number of reweighting iterations; weights converge earlier."""


class MapOdomTrack:
    """Poses of the odometry frame in map, by stamp; each transform holds until the next."""

    def __init__(self) -> None:
        self._samples: list[tuple[int, tuple[float, float, float]]] = []

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: MapOdom) -> None:
        """Add a transform, in any order."""
        x, y, yaw = planar(sample.T_map_odom).tolist()
        insort(self._samples, (sample.stamp_ns, (x, y, yaw)))

    def newest(self) -> Float64:
        """Return the newest transform, planar pose (3,)."""
        return np.array(self._samples[-1][1])

    def before(self, stamp_ns: int) -> Float64:
        """Return the newest transform (3,) before a stamp, else the first one."""
        return np.array(self._samples[max(self._count_before(stamp_ns) - 1, 0)][1])

    def _count_before(self, stamp_ns: int) -> int:
        return bisect_right(self._samples, (stamp_ns,))

    def poses_of(
        self, keyframes: Sequence[GraphKeyframe], sigma: tuple[float, float]
    ) -> dict[int, tuple[Float64, Float64]]:
        """Return the external poses of keyframes, by id.

        Each is the median over the transforms until the next keyframe. Their errors are correlated,
        so that the covariance does not decrease with their number. Without transforms in that
        interval, the previous one is used; keyframes before the first transform get no pose.

        Parameters
        ----------
        keyframes
            Keyframes in order.
        sigma
            Standard deviation of position (m) and yaw (rad).

        Returns
        -------
        poses float64 (3,) in map and covariances float64 (3, 3) of (x, y, yaw) in map
        """
        cov = np.diag(np.square([sigma[0], sigma[0], sigma[1]]))
        begins = [self._count_before(k.scan.stamp_ns) for k in keyframes]
        external = {}
        for keyframe, begin, end in zip(keyframes, begins, [*begins[1:], len(self._samples)]):
            held = self._samples[max(begin - 1, 0) if end <= begin else begin : end]
            if held:
                poses = compose2(np.array([pose for _, pose in held]), keyframe.scan.odom)
                poses[:, 2] = poses[-1, 2] + wrap_angle(poses[:, 2] - poses[-1, 2])
                external[keyframe.id] = np.median(poses, axis=0), cov
        return external


def reweigh(chain: Chain) -> None:
    """Reweight the external poses of keyframes by their consistency with odometry.

    A localisation that jumps was wrong before or after the jump. Iteratively reweighted least
    squares with Geman-McClure weights, starting from the convex solution (Z. Zhang, *Parameter
    Estimation Techniques*, 1997), increases the covariance of outliers.

    Parameters
    ----------
    chain
        Chain whose `external_poses` covariances are updated.
    """
    external = {k: chain.external_poses[k] for k in sorted(chain.external_poses)}
    if not external:
        return
    kept = np.array(list(external))
    poses = np.array([keyframe.pose for keyframe in chain.keyframes])
    expected = np.array([pose for pose, _ in external.values()])
    for _ in range(ROUNDS):
        poses = chain.graph(poses, {0}).optimise().planar_poses(chain.keys)
        error = poses[kept] - expected
        error[:, 2] = wrap_angle(error[:, 2])
        variances = np.array([np.diag(cov) for _, cov in external.values()])
        weights = (1.0 + (error**2 / variances).sum(1) / error.shape[1]) ** -2
        chain.external_poses = {
            k: (pose, cov / weight) for (k, (pose, cov)), weight in zip(external.items(), weights)
        }
