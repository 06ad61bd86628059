"""How far apart keyframes are along what ties them: the chain of a session, and loop closures.

A shortest path tells how far the estimate may have drifted between two keyframes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from tccm_ros.arrays import Float64, Int64
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.loop_matching import Proposal

__all__ = ["PathLengths", "lengths_from"]


LOOP_LENGTH = 0.5
"""A loop closure ties its ends at best as well as this much path (m)."""

TURN_LENGTH = 0.2
"""A turn by one rad counts as this much path, m."""


@dataclass(slots=True)
class PathLengths:
    """Lengths along the chains of all sessions and the loop closures between them.

    Attributes
    ----------
    driven
        float64 (K,), path from the first keyframe of all to each, m.
    """

    driven: Float64 = field(default_factory=lambda: np.zeros(0))
    _steps: Float64 = field(default_factory=lambda: np.zeros(0))
    _loops: Int64 = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    _ties: Float64 = field(default_factory=lambda: np.zeros(0))

    def add(self, keyframe: GraphKeyframe, *, starts: bool) -> None:
        """Append a keyframe; the first of a session `starts` a chain."""
        x, y, yaw = keyframe.delta
        step = float(np.hypot(x, y) + TURN_LENGTH * abs(yaw))
        before = self.driven[-1] if len(self.driven) else 0.0
        self.driven = np.append(self.driven, step + before)
        self._steps = np.append(self._steps, np.inf if starts else step)

    def tie(self, loops: Sequence[Proposal], drift: float) -> None:
        """Add loop closures, as long as the path that ties as well in their weakest direction.

        `drift` is ``loops.drift``, m per m of path.
        """
        ends = np.array([(p.a, p.b) for p in loops], np.int64).reshape(-1, 2)
        ties = np.array([max(LOOP_LENGTH, p.spread**0.5 / drift) for p in loops])
        self._loops = np.concatenate([self._loops, ends])
        self._ties = np.concatenate([self._ties, ties])

    def until(self, k: int) -> Float64:
        """Return the length of the shortest path from all keyframes up to `k` to it, (k + 1,)."""
        return lengths_from(k, self._steps[: k + 1], self._loops, self._ties)


@njit(nogil=True, cache=True)
def lengths_from(
    start: int, steps: Float64, loops: Int64, ties: Float64
) -> Float64:  # pragma: no cover - compiled
    """Return the length of the shortest path from one keyframe to all, float64 (K,), m.

    Bellman's relaxation, in sweeps along the chain: a sweep settles what no further loop shortens,
    so that there are as many sweeps as the longest of the paths has loops.

    Parameters
    ----------
    start
        Where the paths begin.
    steps
        float64 (K,), the way from the keyframe before, m; infinite where a session begins.
    loops
        int64 (L, 2), keyframes that a loop closure ties.
    ties
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
            if lengths[b] + ties[i] < lengths[a]:
                lengths[a], changed = lengths[b] + ties[i], True
            if lengths[a] + ties[i] < lengths[b]:
                lengths[b], changed = lengths[a] + ties[i], True
    return lengths
