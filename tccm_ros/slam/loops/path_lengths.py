"""Shortest paths between keyframes, along sessions and over loop closures.

The length of a path bounds the drift between two keyframes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.loops.matching import Proposal

MIN_LOOP_LENGTH = 0.5
"""Minimum length (m) of a loop closure: shorter paths constrain its ends as well (chosen)."""

YAW_LENGTH = 0.2
"""Path length of a rotation in place, m/rad (chosen)."""


@dataclass(slots=True)
class PathLengths:
    """Path lengths in the graph of all sessions and the loop closures between them.

    Attributes
    ----------
    driven
        float64 (K,), path from the first keyframe of all to each, m.
    """

    driven: Float64 = field(default_factory=lambda: np.zeros(0))
    _steps: Float64 = field(default_factory=lambda: np.zeros(0))
    _loops: Int64 = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    _loop_lengths: Float64 = field(default_factory=lambda: np.zeros(0))

    def add(self, keyframe: GraphKeyframe, *, starts: bool) -> None:
        """Append a keyframe; with `starts`, it is the first of its session."""
        x, y, yaw = keyframe.delta
        step = float(np.hypot(x, y) + YAW_LENGTH * abs(yaw))
        before = self.driven[-1] if len(self.driven) else 0.0
        self.driven = np.append(self.driven, step + before)
        self._steps = np.append(self._steps, np.inf if starts else step)

    def add_loops(self, loops: Sequence[Proposal], drift: float) -> None:
        """Add loop closures; a length is the path on which drift reaches their largest sigma.

        `drift` is ``loops.drift``, m per m of path.
        """
        ends = np.array([(p.a, p.b) for p in loops], np.int64).reshape(-1, 2)
        loop_lengths = np.array(
            [max(MIN_LOOP_LENGTH, p.max_position_variance**0.5 / drift) for p in loops]
        )
        self._loops = np.concatenate([self._loops, ends])
        self._loop_lengths = np.concatenate([self._loop_lengths, loop_lengths])

    def shortest_to(self, k: int) -> Float64:
        """Return the shortest path from each keyframe up to `k` to `k`, float64 (k + 1,), m."""
        return lengths_from(k, self._steps[: k + 1], self._loops, self._loop_lengths)


@kernel
def lengths_from(start: int, steps: Float64, loops: Int64, loop_lengths: Float64) -> Float64:
    """Return the length of the shortest path from one keyframe to all, float64 (K,), m.

    Bellman's relaxation in passes along the chain; the number of passes is that of the loop
    closures on the shortest path with the most.

    Parameters
    ----------
    start
        Keyframe at which the paths begin.
    steps
        float64 (K,), distance from the previous keyframe, m; infinite at the start of a session.
    loops
        int64 (L, 2), keyframes of each loop closure.
    loop_lengths
        float64 (L,), the length of each loop closure, m.
    """
    lengths = np.full(len(steps), np.inf)
    lengths[start] = 0.0
    changed = True
    while changed:
        for k in range(len(steps) - 1, 0, -1):
            lengths[k - 1] = min(lengths[k - 1], lengths[k] + steps[k])
        for k in range(1, len(steps)):
            lengths[k] = min(lengths[k], lengths[k - 1] + steps[k])
        changed = False
        for i in range(len(loops)):
            a, b = loops[i, 0], loops[i, 1]
            if lengths[b] + loop_lengths[i] < lengths[a]:
                lengths[a], changed = lengths[b] + loop_lengths[i], True
            if lengths[a] + loop_lengths[i] < lengths[b]:
                lengths[b], changed = lengths[a] + loop_lengths[i], True
    return lengths
