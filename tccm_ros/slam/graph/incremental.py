"""Graphs optimised incrementally by ISAM2 (surface mapping paper, III.B).

ISAM2 (Kaess et al. 2012) stores the factorised graph as a tree of cliques. An update re-eliminates
the cliques that new factors affect and their ancestors, and relinearises variables that have moved.
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
"""Threshold of motion (m, rad) for relinearisation of a variable (GTSAM's default)."""


class Isam:
    """ISAM2 with this package's factors and variables.

    Parameters
    ----------
    relinearize
        Threshold of motion (m, rad) for relinearisation of a variable.
    factorization
        ``CHOLESKY`` or ``QR``. Cholesky fails ("indeterminate") if a row of the square-root
        information is below 1/4096 of another: for example with a position uncertainty of 30 m
        after a long corridor, and a scan-to-scan heading uncertainty of 2 mrad. QR succeeds, at
        nearly twice the time.
    wildfire
        Threshold of motion (m, rad) below which a change is not propagated.
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
        """Add factors and variables, and remove factors.

        Parameters
        ----------
        factors
            New factors, which also initialise new landmarks from poses in the graph.
        poses
            Start values (3,) or (4, 4); those of poses in the graph are ignored.
        gone
            Indices of factors to remove.

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
    """A growing graph whose poses can be read at any time."""

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
