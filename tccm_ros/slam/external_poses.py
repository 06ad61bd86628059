"""Poses from an external localisation: its map -> odom over time."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import compose2, planar, wrap_angle
from tccm_ros.records import MapOdom, PoseCovariance
from tccm_ros.robust import median_sigma
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.front_end import GraphKeyframe

MEDIAN_VARIANCE = 0.5 * np.pi
"""Variance of the median of many normal variates, over that of their mean."""

ROUNDS = 10
"""Number of reweighting iterations; weights converge earlier."""


class MapOdomTrack:
    """Poses of the odometry frame in map, by stamp; each transform holds until the next."""

    def __init__(self) -> None:
        self._samples: list[tuple[int, tuple[float, float, float]]] = []
        self._covariances: dict[int, Float64] = {}

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: MapOdom) -> None:
        """Add a transform, in any order."""
        x, y, yaw = planar(sample.T_map_odom).tolist()
        insort(self._samples, (sample.stamp_ns, (x, y, yaw)))

    def add_covariance(self, record: PoseCovariance) -> None:
        """Add the covariance of an external pose, in any order; each holds until the next."""
        self._covariances[record.stamp_ns] = record.cov

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

        Each is the median over the transforms until the next keyframe. Without transforms in that
        interval, the previous one is used; keyframes before the first transform get no pose.

        The error of a transform has two parts. One is independent of the next transform's; its
        variance follows from successive differences (von Neumann), and decreases with the number of
        transforms. The rest of the variance is common to all transforms of a keyframe.

        Parameters
        ----------
        keyframes
            Keyframes in order.
        sigma
            Standard deviation of position (m) and yaw (rad) of one transform, without covariances.

        Returns
        -------
        poses float64 (3,) in map and covariances float64 (3, 3) of (x, y, yaw) in map
        """
        begins = [self._count_before(k.scan.stamp_ns) for k in keyframes]
        samples: dict[int, Float64] = {}
        for keyframe, begin, end in zip(keyframes, begins, [*begins[1:], len(self._samples)]):
            held = self._samples[max(begin - 1, 0) if end <= begin else begin : end]
            if held:
                poses = compose2(np.array([pose for _, pose in held]), keyframe.scan.odom)
                poses[:, 2] = poses[-1, 2] + wrap_angle(poses[:, 2] - poses[-1, 2])
                samples[keyframe.id] = poses
        white = white_variance([*samples.values()])
        stated = self._covariances_at(
            [k.scan.stamp_ns for k in keyframes if k.id in samples], sigma
        )
        external = {}
        for (k, poses), cov in zip(samples.items(), stated):
            variance = np.diag(cov)
            mean = white * min(1.0, MEDIAN_VARIANCE / len(poses))
            scale = np.sqrt((np.maximum(variance - white, 0.0) + mean) / variance)
            external[k] = np.median(poses, axis=0), cov * np.outer(scale, scale)
        return external

    def _covariances_at(self, stamps_ns: Sequence[int], sigma: tuple[float, float]) -> Float64:
        """Return the newest covariances (K, 3, 3) at stamps, else the first; by sigma without."""
        if not self._covariances:
            cov = np.diag(np.square([sigma[0], sigma[0], sigma[1]]))
            return np.broadcast_to(cov, (len(stamps_ns), 3, 3))
        known = sorted(self._covariances)
        rows = [max(bisect_right(known, stamp) - 1, 0) for stamp in stamps_ns]
        return np.array([self._covariances[known[i]] for i in rows])


def white_variance(groups: Sequence[Float64]) -> Float64:
    """Return the variance of the independent part of the errors of poses that should be equal.

    Parameters
    ----------
    groups
        Poses float64 (N, 3) of one base pose each, in order of stamps, yaw without wraps.

    Returns
    -------
    float64 (3,) of (x, y, yaw): half the square of a robust standard deviation of successive
    differences; zero for poses that are mostly repeated
    """
    steps = np.concatenate([np.zeros((0, 3)), *(np.diff(poses, axis=0) for poses in groups)])
    if not len(steps):
        return np.zeros(3)
    return np.array([0.5 * median_sigma(step) ** 2 for step in steps.T])


def reweigh(chain: KeyframeChain) -> None:
    """Reweight the external poses of keyframes by their consistency with odometry.

    A localisation that jumps was wrong before or after the jump. Iteratively reweighted least
    squares with Geman-McClure weights, starting from the convex solution (Z. Zhang, *Parameter
    Estimation Techniques*, 1997), increases the covariance of outliers.

    Parameters
    ----------
    chain
        Keyframes whose `external_poses` covariances are updated.
    """
    external = {k: chain.external_poses[k] for k in sorted(chain.external_poses)}
    if not external:
        return
    kept = np.array(list(external))
    poses = np.array([keyframe.pose for keyframe in chain.keyframes])
    expected = np.array([pose for pose, _ in external.values()])
    for _ in range(ROUNDS):
        poses = chain.graph(poses, {}).optimise().planar_poses(chain.keys)
        error = poses[kept] - expected
        error[:, 2] = wrap_angle(error[:, 2])
        variances = np.array([np.diag(cov) for _, cov in external.values()])
        weights = (1.0 + (error**2 / variances).sum(1) / error.shape[1]) ** -2
        chain.external_poses = {
            k: (pose, cov / weight) for (k, (pose, cov)), weight in zip(external.items(), weights)
        }
