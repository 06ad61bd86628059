"""Shortest paths between keyframes, along sessions and over loop closures.

The length of a path bounds the drift between two keyframes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from tccm_ros.arrays import Float64
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
    _loops: dict[tuple[int, int], float] = field(default_factory=dict)

    def add(self, keyframe: GraphKeyframe, *, starts: bool) -> None:
        """Append a keyframe; with `starts`, it is the first of its session."""
        x, y, yaw = keyframe.delta
        step = float(np.hypot(x, y) + YAW_LENGTH * abs(yaw))
        before = self.driven[-1] if len(self.driven) else 0.0
        self.driven = np.append(self.driven, step + before)
        self._steps = np.append(self._steps, np.inf if starts else step)

    def add_loops(self, loops: Iterable[Proposal], drift: float) -> None:
        """Add loop closures; a length is the path on which drift reaches their largest sigma.

        `drift` is ``loops.drift``, m per m of path.
        """
        for p in loops:
            length = max(MIN_LOOP_LENGTH, p.max_position_variance**0.5 / drift)
            self._loops[p.a, p.b] = min(length, self._loops.get((p.a, p.b), np.inf))

    def shortest_to(self, k: int) -> Float64:
        """Return the shortest path from each keyframe up to `k` to `k`, float64 (k + 1,), m."""
        return lengths_from(k, self._steps[: k + 1], self._loops)


def lengths_from(start: int, steps: Float64, loops: Mapping[tuple[int, int], float]) -> Float64:
    """Return the length of the shortest path from one keyframe to all, float64 (K,), m.

    Parameters
    ----------
    start
        Keyframe at which the paths begin.
    steps
        float64 (K,), distance from the previous keyframe, m; infinite at the start of a session.
    loops
        Length of the loop closure between two keyframes a < b, m.
    """
    chain = np.flatnonzero(np.isfinite(steps[1:]))
    a, b = np.array([*loops], np.int64).reshape(-1, 2).T
    lengths = np.concatenate([steps[1:][chain], np.array([*loops.values()], float)])
    ends = np.concatenate([chain, a]), np.concatenate([chain + 1, b])
    graph = coo_matrix((lengths, ends), (len(steps), len(steps))).tocsr()
    return np.asarray(dijkstra(graph, directed=False, indices=start))
