"""The last word on loop closures: all against all, by graduated non-convexity."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from tccm_ros.slam.chain import Chain
from tccm_ros.slam.graph import GraphSolution
from tccm_ros.slam.loop_proposals import Proposal
from tccm_ros.slam.loops import loop_factor
from tccm_ros.slam.robust_loops import graduate

__all__ = ["settle_loops"]

Float64 = NDArray[np.float64]


def settle_loops(
    chain: Chain,
    poses: Sequence[Float64] | Float64,
    tied: Collection[int],
    loops: Sequence[Proposal],
) -> tuple[Float64, NDArray[np.bool_]]:
    """Optimise the chain with its loops and find those that contradict the rest.

    Returns
    -------
    poses float64 (K, 3) and which loops are kept bool (L,)
    """
    graph = chain.graph(poses, tied)
    first = len(graph)
    graph.add([loop_factor(p, chain.keys) for p in loops])
    weights = np.ones(len(loops))

    def solve(new: Float64) -> GraphSolution:
        for i in map(int, np.flatnonzero(new != weights)):
            graph.replace(first + i, loop_factor(loops[i], chain.keys, float(new[i])))
        weights[:] = new
        return graph.optimise()

    def chi2(solution: GraphSolution) -> Float64:
        return 2.0 * solution.errors_of(range(first, first + len(loops))) / weights

    solution, final = graduate(solve, chi2, len(loops))
    return solution.planar_poses(chain.keys), final > 0.5
