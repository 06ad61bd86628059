"""Graphs that are optimised incrementally by ISAM2 (surface mapping paper, III.B).

ISAM2 (Kaess et al. 2012) keeps the factorised graph as a tree of cliques. An update eliminates the
cliques that new factors touch and those above them again, and linearises again what has moved.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import gtsam

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.graph.assembly import add_factors, insert_poses
from tccm_ros.slam.graph.pose_graph import poses_of

RELINEARIZE = 0.1
"""A variable that moved by more (m, rad) than this is linearised anew (GTSAM's default)."""


class Isam:
    """ISAM2 with factors and variables of ours.

    Parameters
    ----------
    relinearize
        A variable that moved by more (m, rad) is linearised anew.
    factorization
        ``CHOLESKY`` or ``QR``. Cholesky gives up ("indeterminate") where a row of the square-root
        information falls below 1/4096 of another: a robot that is 30 m uncertain after a long
        corridor, with a heading known from scan to scan to 2 mrad, is such a case. QR takes it, and
        nearly twice the time.
    wildfire
        Variables that move by less (m, rad) do not pass the change on.
    """

    def __init__(
        self, relinearize: float, factorization: str = "CHOLESKY", wildfire: float | None = None
    ) -> None:
        params = gtsam.ISAM2Params()
        params.setRelinearizeThreshold(relinearize)
        params.relinearizeSkip = 1
        params.setFactorization(factorization)
        if wildfire is not None:
            steps = gtsam.ISAM2GaussNewtonParams()
            steps.setWildfireThreshold(wildfire)
            params.setOptimizationParams(steps)
        self.isam = gtsam.ISAM2(params)

    def update(
        self,
        factors: Iterable[Factor],
        poses: Mapping[Key, Float64],
        gone: Sequence[int] = (),
    ) -> list[list[int]]:
        """Add factors and variables, and take factors out.

        Parameters
        ----------
        factors
            New ones. Landmarks that are new are started by them, from poses in the graph.
        poses
            Start values (3,) or (4, 4); those of poses in the graph are passed over.
        gone
            Indices of factors to take out.

        Returns
        -------
        list of list of int
            The indices in the graph of each of `factors`
        """
        graph, values, is_known = (
            gtsam.NonlinearFactorGraph(),
            gtsam.Values(),
            self.isam.valueExists,
        )
        fresh = {key: pose for key, pose in poses.items() if not is_known(key.symbol)}
        starts = insert_poses(values, fresh)

        def pose_of(key: Key) -> Float64:
            if key in starts:
                return starts[key]
            return key.from_value(self.isam.calculateEstimatePose3(key.symbol))

        ends = add_factors(graph, values, factors, pose_of, is_known)
        result = self.isam.update(graph, values, list(gone))
        numbers = list(result.getNewFactorsIndices())
        return [numbers[a:b] for a, b in pairwise([0, *ends])]


class IncrementalGraph:
    """A graph that grows, whose poses can be read at any time."""

    def __init__(self) -> None:
        self._steps: list[tuple[list[Factor], dict[Key, Float64]]] = []
        self._isam = Isam(RELINEARIZE)

    def add(self, factors: Iterable[Factor], poses: Mapping[Key, Float64]) -> None:
        """Add factors and new poses, with start values (3,) or (4, 4), and update."""
        step = list(factors), dict(poses)
        self._steps.append(step)
        try:
            self._isam.update(*step)
        except RuntimeError:
            self._isam = Isam(RELINEARIZE, "QR")
            for earlier in self._steps:
                self._isam.update(*earlier)

    def planar_poses(self, keys: Sequence[Key]) -> Float64:
        """Return planar poses float64 (N, 3)."""
        return poses_of(self._isam.isam.calculateEstimate(), keys)
