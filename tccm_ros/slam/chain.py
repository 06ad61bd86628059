"""Keyframes of all sessions in a pose graph, and poses anchored to keyframes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.base_attitude import LEVEL, Attitude
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, keyframe_key
from tccm_ros.slam.factors.noise import rotate_frame
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.factors.views import Z_ROLL_PITCH_SIGMAS, KeyframeView
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.se2 import compose_se2

START_SIGMA = 1e-4
"""Standard deviation (m, rad) of the first pose, which defines the map frame: small, but not zero
(chosen)."""

YAW_STEPS = 18
"""Number of candidate yaw offsets of a keyframe over 90 degrees: every 5 degrees (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class AnchoredPose:
    """The pose of a view or of an observation, relative to a keyframe.

    Attributes
    ----------
    keyframe
        Id of the keyframe.
    pose
        float64 (3,), planar pose in the keyframe, m and rad.
    cov
        float64 (3, 3) of (x, y, yaw) in the frame of `pose`.
    sigma_z_roll_pitch
        Standard deviations of z (m), roll and pitch (rad) relative to the keyframe, whose are zero.
    attitude
        Height by odometry, m, and roll and pitch by an IMU or odometry, rad.
    """

    keyframe: int
    pose: Float64
    cov: Float64
    sigma_z_roll_pitch: tuple[float, float, float] = Z_ROLL_PITCH_SIGMAS
    attitude: Attitude = LEVEL


def yaw_offset_for(phi: Float64) -> float:
    """Return the yaw offset (rad) of a keyframe that keeps lines at phi (L,) off its axes."""
    if not len(phi):
        return 0.0
    offsets = np.arange(YAW_STEPS) * (0.5 * np.pi / YAW_STEPS)
    clearance = np.abs(np.sin(2.0 * (phi[None, :] - offsets[:, None]))).min(axis=1)
    return float(offsets[np.argmax(clearance)])


@dataclass(slots=True)
class KeyframeChain:
    """Keyframes, each with a factor to the previous one of its session.

    Attributes
    ----------
    keyframes
        Keyframes of all sessions, in the order of ids.
    keys
        Their variables in the graph.
    fixed
        Poses float64 (3,) of fixed keyframes, by id: those of the map in localisation.
    external_poses
        Poses float64 (3,) in map from an external localisation, and their covariances (3, 3) of (x,
        y, yaw) in map, by id.
    """

    keyframes: list[GraphKeyframe] = field(default_factory=list)
    keys: list[Key] = field(default_factory=list)
    fixed: dict[int, Float64] = field(default_factory=dict)
    external_poses: dict[int, tuple[Float64, Float64]] = field(default_factory=dict)

    def add(self, keyframe: GraphKeyframe, phi: Float64) -> None:
        """Append a keyframe that observes lines at `phi`, float64 (L,), rad."""
        self.keys.append(keyframe_key(keyframe.id, yaw_offset_for(phi)))
        self.keyframes.append(keyframe)

    def starts(self, k: int) -> bool:
        """Return whether keyframe `k` is the first of its session."""
        return k == 0 or self.keyframes[k].session != self.keyframes[k - 1].session

    def factors_of(self, k: int) -> list[Factor]:
        """Return the factors of keyframe `k`; the first of a later session is free in the plane."""
        keyframe, key = self.keyframes[k], self.keys[k]
        if k in self.fixed:
            return [_pinned(key, self.fixed[k])]
        if k == 0 and not self.external_poses:
            return [_pinned(key, keyframe.pose)]
        factors: list[Factor] = [Planar(key, keyframe.pose)]
        if k in self.external_poses:
            pose, cov = self.external_poses[k]
            own = rotate_frame(cov, float(pose[2]))
            factors.append(PriorPose(key, pose, own, is_robust=True))
        if not self.starts(k):
            step = BetweenKeyframes(self.keys[k - 1], key, keyframe.delta, keyframe.cov)
            factors.insert(0, step)
        return factors

    def graph(
        self,
        poses: Sequence[Float64] | Float64,
        fixed_starts: Mapping[int, Float64],
        anchored: Mapping[Key, AnchoredPose] | None = None,
    ) -> PoseGraph:
        """Build the graph of all keyframes and anchored poses.

        Parameters
        ----------
        poses
            Planar start poses (3,), one per keyframe.
        fixed_starts
            Poses float64 (3,) of the first keyframes of sessions that no factor connects, by id.
        anchored
            Poses anchored to keyframes, by variable.
        """
        starts, anchors = self.anchor(anchored or {}, poses)
        factors = [*self.factors(fixed_starts), *anchors]
        return PoseGraph(factors, {**dict(zip(self.keys, poses)), **starts})

    def factors(self, fixed_starts: Mapping[int, Float64]) -> list[Factor]:
        """Return the factors of all keyframes; arguments as in `graph`."""
        factors = [factor for k in range(len(self.keys)) for factor in self.factors_of(k)]
        return factors + [_pinned(self.keys[k], pose) for k, pose in fixed_starts.items()]

    def anchor(
        self, anchored: Mapping[Key, AnchoredPose], poses: Sequence[Float64] | Float64
    ) -> tuple[dict[Key, Float64], list[Factor]]:
        """Return the start values (4, 4) in map of anchored poses, and their factors.

        Parameters
        ----------
        anchored
            Poses in their keyframes, by variable.
        poses
            float64 (K, 3), poses of the keyframes in map.
        """
        starts: dict[Key, Float64] = {}
        factors: list[Factor] = []
        for key, on in anchored.items():
            planar_start = compose_se2(np.asarray(poses[on.keyframe]), on.pose)
            starts[key] = spatial(planar_start, on.attitude[0])
            keys, sigmas = (self.keys[on.keyframe], key), on.sigma_z_roll_pitch
            factors.append(KeyframeView(*keys, on.pose, on.cov, sigmas, on.attitude))
        return starts, factors


def _pinned(key: Key, pose: Float64) -> PriorPose:
    return PriorPose(key, pose, np.eye(3) * START_SIGMA**2)
