"""The keyframes of all sessions as variables and factors of a graph, and poses hung on them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors import (
    BetweenKeyframes,
    Factor,
    Key,
    KeyframeView,
    Planar,
    PriorPose,
    keyframe_key,
)
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.graph import PoseGraph
from tccm_ros.slam.se2 import compose

__all__ = ["Chain", "HungPose", "turn_for"]


START_SIGMA = 1e-4
"""The first pose defines the map: its standard deviation (m, rad) is only not zero."""

TURN_STEPS = 18
"""Turns of a keyframe that are tried, over a quarter turn: 5 degrees apart."""


@dataclass(frozen=True, slots=True, eq=False)
class HungPose:
    """A pose (3,) in keyframe `keyframe`, with covariance (3, 3): of a view or an observation."""

    keyframe: int
    pose: Float64
    cov: Float64


def turn_for(phi: Float64) -> float:
    """Return the turn of a keyframe that keeps lines at phi (L,) far from its x and y axes."""
    if not len(phi):
        return 0.0
    turns = np.arange(TURN_STEPS) * (0.5 * np.pi / TURN_STEPS)
    clearance = np.abs(np.sin(2.0 * (phi[None, :] - turns[:, None]))).min(axis=1)
    return float(turns[np.argmax(clearance)])


@dataclass(slots=True)
class Chain:
    """Keyframes, each tied to the one before it in its session.

    `fixed` holds the poses of keyframes that must not move: the map in localisation.
    """

    keyframes: list[GraphKeyframe] = field(default_factory=list)
    keys: list[Key] = field(default_factory=list)
    fixed: dict[int, Float64] = field(default_factory=dict)

    def add(self, keyframe: GraphKeyframe, phi: Float64) -> None:
        """Append a keyframe that sees lines at `phi` (L,)."""
        self.keys.append(keyframe_key(keyframe.id, turn_for(phi)))
        self.keyframes.append(keyframe)

    def starts(self, k: int) -> bool:
        """Return whether keyframe `k` is the first of its session."""
        return k == 0 or self.keyframes[k].session != self.keyframes[k - 1].session

    def factors_of(self, k: int) -> list[Factor]:
        """Return the factors that hold keyframe `k`: the first of a later session is free."""
        keyframe, key = self.keyframes[k], self.keys[k]
        if k in self.fixed:
            return [_pinned(key, self.fixed[k])]
        if k == 0:
            return [_pinned(key, keyframe.pose)]
        planar = Planar(key, keyframe.pose)
        if self.starts(k):
            return [planar]
        return [BetweenKeyframes(self.keys[k - 1], key, keyframe.delta, keyframe.cov), planar]

    def graph(
        self,
        poses: Sequence[Float64] | Float64,
        tied: Collection[int],
        hung: Mapping[Key, HungPose] | None = None,
    ) -> PoseGraph:
        """Build the graph of all keyframes and of what hangs on them.

        Parameters
        ----------
        poses
            Planar start poses (3,), one for each keyframe.
        tied
            Sessions that loop closures tie to the first; the others are pinned where they began.
        hung
            Poses by their variables.
        """
        starts: dict[Key, Float64] = dict(zip(self.keys, poses))
        factors = [factor for k in range(len(self.keys)) for factor in self.factors_of(k)]
        for k, keyframe in enumerate(self.keyframes):
            if k and self.starts(k) and keyframe.session not in tied:
                factors.append(_pinned(self.keys[k], keyframe.pose))
        for key, pose in (hung or {}).items():
            starts[key], factor = self.hang(key, pose, poses)
            factors.append(factor)
        return PoseGraph(factors, starts)

    def hang(
        self, key: Key, hung: HungPose, poses: Sequence[Float64] | Float64
    ) -> tuple[Float64, Factor]:
        """Return where a hung pose starts, (3,), and the factor that ties it to its keyframe."""
        start = compose(np.asarray(poses[hung.keyframe]), hung.pose)
        return start, KeyframeView(self.keys[hung.keyframe], key, hung.pose, hung.cov)


def _pinned(key: Key, pose: Float64) -> PriorPose:
    return PriorPose(key, pose, np.eye(3) * START_SIGMA**2)
