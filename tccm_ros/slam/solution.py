"""The result of `WallSlam.solve`: poses, walls, loop closures and covariances."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int64
from tccm_ros.geometry import wrap_angle
from tccm_ros.records import Keyframe, Landmark, Loop, RefusedSign, Sign, Wall
from tccm_ros.slam.base_attitude import interpolate, with_attitude


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The result of an optimisation of the graph.

    Attributes
    ----------
    keyframes, walls, loops
        In the order of ids; loop closures in order of discovery, including rejected ones.
    stamps_ns, poses
        int64 (N,) and float64 (N, 3): planar pose of the base in map for each level scan, or for
        each odometry sample without a level laser.
    T_map_views
        float64 (V, 4, 4), poses of the views in the order of the given stamps.
    cov_views
        float64 (V, 6, 6) of (roll, pitch, yaw, x, y, z) in each view's own frame, rad and m.
    view_keyframes
        int64 (V,), id of the keyframe that each view is anchored to.
    cov_keyframes
        float64 (K, 3, 3) of (x, y, yaw) in each keyframe's own frame; NaN for all but the newest if
        `is_batch` is false.
    unit_variance
        Factor to apply to the graph's covariances, including `cov_views`, as those of its factors
        are conservative. `cov_keyframes` already contains it, and the error of odometry's scale,
        which is in no factor.
    landmarks
        In the order of kinds and ids, including those of earlier sessions.
    signs
        Door signs by id; each is a landmark as well.
    refused_signs
        Rejected readings of room numbers.
    attitudes
        float64 (N, 3), z (m), roll and pitch (rad) of the base at `stamps_ns` by odometry; empty if
        all are 0.
    is_batch
        Whether it is a function of the records alone, and not continued from another solution.
    is_chain
        Whether only the steps between keyframes determine the poses.
    """

    keyframes: list[Keyframe]
    walls: list[Wall]
    loops: list[Loop]
    stamps_ns: Int64
    poses: Float64
    T_map_views: Float64
    cov_views: Float64
    view_keyframes: Int64
    cov_keyframes: Float64
    unit_variance: float = 1.0
    landmarks: tuple[Landmark, ...] = ()
    signs: tuple[Sign, ...] = ()
    is_batch: bool = True
    refused_signs: tuple[RefusedSign, ...] = ()
    attitudes: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    is_chain: bool = False

    def pose_at(self, stamps_ns: ArrayLike) -> Float64:
        """Return planar poses (M, 3) at stamps int64 (M,), interpolated; held at the ends."""
        unwrapped = np.column_stack([self.poses[:, :2], np.unwrap(self.poses[:, 2])])
        poses = interpolate(self.stamps_ns, unwrapped, stamps_ns)
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses

    def attitude_at(self, stamps_ns: ArrayLike) -> Float64:
        """Return z (m), roll and pitch (rad) of the base at stamps int64 (M,), as `pose_at`."""
        return interpolate(self.stamps_ns, self.attitudes, stamps_ns)

    def T_map_base_at(self, stamps_ns: ArrayLike) -> Float64:
        """Return poses (M, 4, 4) of the base in map at stamps int64 (M,), as `pose_at`."""
        return with_attitude(self.pose_at(stamps_ns), self.attitude_at(stamps_ns))


def empty_solution(views: int) -> Solution:
    """Return the solution without records, with V views at the origin."""
    T = np.broadcast_to(np.eye(4), (views, 4, 4)).copy()
    none = np.zeros(0, np.int64)
    zeros = np.zeros((views, 6, 6))
    return Solution(
        [], [], [], none, np.zeros((0, 3)), T, zeros, np.zeros(views, np.int64), np.zeros((0, 3, 3))
    )
