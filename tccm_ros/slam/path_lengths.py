"""How far apart keyframes are along what ties them: the chain of a session, and loop closures."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["lengths_from"]

Float64 = NDArray[np.float64]


@njit(nogil=True, cache=True)
def lengths_from(
    start: int, steps: Float64, loops: NDArray[np.int64], ties: Float64
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
