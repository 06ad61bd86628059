"""Graphs optimised incrementally by ISAM2 (surface mapping paper, III.B).

ISAM2 (Kaess et al. 2012) stores the factorised graph as a tree of cliques. An update re-eliminates
the cliques that new factors affect and their ancestors, and relinearises variables that have moved.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import gtsam

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.factor import Factor, is_same
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.graph.pose_graph import GraphSolution, add_factors, insert_poses, poses_of

RELINEARIZE, WILDFIRE = 0.1, 1e-3
"""Thresholds of motion (m, rad) for relinearisation of a variable, and below which a change is not
propagated (GTSAM's defaults)."""

MAX_ROUNDS = 2
"""Maximum number of updates until no variable has moved by the threshold; the next solution
continues (chosen: in maps with many loop closures, an update takes as long as a batch step)."""

MORE_FACTORS = 1.5
"""A covariance is recomputed, one per update, when the number of its variable's factors has grown
by this factor: uncertainty decreases over time, so that the old covariance is conservative
(chosen)."""


@dataclass(frozen=True, eq=False)
class IncrementalSolution(GraphSolution):
    """Estimates of an `IncrementalGraph`, with its cached covariances.

    Attributes
    ----------
    source
        The graph.
    """

    source: IncrementalGraph

    def covariance(self, key: Key) -> Float64:
        """Return the marginal covariance in GTSAM's tangent order of the variable."""
        return self.source.covariance(key)


class IncrementalGraph:
    """A graph that stays optimised while its factors change; each factor has a name.

    Parameters
    ----------
    relinearize, wildfire
        Thresholds, as `RELINEARIZE` and `WILDFIRE`.
    covariances
        Known marginal covariances of future variables, in GTSAM's tangent order.
    """

    def __init__(
        self,
        relinearize: float = RELINEARIZE,
        wildfire: float = WILDFIRE,
        covariances: Mapping[Key, Float64] | None = None,
    ) -> None:
        self._thresholds = relinearize, wildfire
        self._isam = _isam(*self._thresholds)
        # The factors and their indices in the graph.
        self._held: dict[Hashable, tuple[Factor, list[int]]] = {}
        self._starts: dict[Key, Float64] = {}
        # The variables of the newest factors.
        self._newest: list[int] = []
        # Covariances, each with the number of factors of its variable when it was computed.
        self._covariances = {k.symbol: (cov, 0) for k, cov in (covariances or {}).items()}
        self._may_refresh = True

    def update(
        self, factors: Mapping[Hashable, Factor | None], poses: Mapping[Key, Float64]
    ) -> None:
        """Add, replace and remove factors, add variables, and update the estimates.

        Parameters
        ----------
        factors
            Factors by name. One that is equal to the present factor of its name is ignored
            (`is_same`); None removes the factor. New landmarks are initialised by their factors.
        poses
            Start values (3,) or (4, 4) of poses; those of poses in the graph are ignored.

        Raises
        ------
        RuntimeError
            Where the graph does not determine its variables.
        """
        new: dict[Hashable, Factor] = {}
        gone: list[int] = []
        for name, factor in factors.items():
            if name in self._held:
                if factor is not None and is_same(self._held[name][0], factor):
                    continue
                gone += self._held.pop(name)[1]
            if factor is not None:
                new[name] = factor
        for key, pose in poses.items():
            self._starts.setdefault(key, pose)
        try:
            self._insert(new, poses, gone)
        except RuntimeError:
            # Cholesky fails if a row of the square-root information is below 1/4096 of another: for
            # example with a position uncertainty of 30 m after a long corridor, and a scan-to-scan
            # heading uncertainty of 2 mrad. QR succeeds, at nearly twice the time.
            failed, self._isam = self._isam, _isam(*self._thresholds, factorization="QR")
            held = {name: factor for name, (factor, _) in self._held.items()}
            for key in filter(lambda key: failed.valueExists(key.symbol), self._starts):
                self._starts[key] = key.from_value(failed.calculateEstimatePose3(key.symbol))
            self._insert({**held, **new}, self._starts, [])

    def _insert(
        self, factors: Mapping[Hashable, Factor], poses: Mapping[Key, Float64], gone: list[int]
    ) -> None:
        isam, graph, values = self._isam, gtsam.NonlinearFactorGraph(), gtsam.Values()
        fresh = {key: pose for key, pose in poses.items() if not isam.valueExists(key.symbol)}
        starts = insert_poses(values, fresh)

        def pose_of(key: Key) -> Float64:
            if key in starts:
                return starts[key]
            return key.from_value(isam.calculateEstimatePose3(key.symbol))

        ends = add_factors(graph, values, factors.values(), pose_of, isam.valueExists)
        if graph.size():
            numbers = list(isam.update(graph, values, gone).getNewFactorsIndices())
            self._newest = list(graph.keyVector())
        else:
            numbers = []
            self._reorder(gone)
        self._may_refresh = True
        for (name, factor), (a, b) in zip(factors.items(), pairwise([0, *ends])):
            self._held[name] = factor, numbers[a:b]

    def relinearise(self, rounds: int = MAX_ROUNDS) -> None:
        """Relinearise variables that have moved, until none moves further or for some rounds."""
        for _ in range(rounds):
            if not self._reorder().getVariablesRelinearized():
                break

    def _reorder(self, gone: Sequence[int] = ()) -> gtsam.ISAM2Result:
        """Update without new factors; the newest variables stay at the root of the tree.

        ISAM2 eliminates the variables of new factors last. An update without new factors may put
        them below other variables, from where a covariance takes seconds in a large map.
        """
        last = gtsam.KeyGroupMap()
        for symbol in self._newest:
            last.insert2(symbol, 1)
        nothing = gtsam.NonlinearFactorGraph(), gtsam.Values()
        return self._isam.update(*nothing, list(gone), last)

    def planar_poses(self, keys: Sequence[Key]) -> Float64:
        """Return planar poses float64 (N, 3)."""
        return poses_of(self._isam.calculateEstimate(), keys)

    def solution(self) -> IncrementalSolution:
        """Return the estimates of all variables."""
        values, graph = self._isam.calculateBestEstimate(), self._isam.getFactorsUnsafe()
        return IncrementalSolution(values, graph, 0, self)

    def indices_of(self, names: Iterable[Hashable]) -> list[int]:
        """Return the indices in the graph of factors, each in GTSAM's form a single one."""
        return [self._held[name][1][0] for name in names]

    def covariance(self, key: Key) -> Float64:
        """Return the marginal covariance in GTSAM's tangent order; see `MORE_FACTORS`."""
        symbol = key.symbol
        uses = len(self._isam.getVariableIndex().at(symbol))
        cov, then = self._covariances.get(symbol, (None, 0))
        is_old = bool(then) and uses > MORE_FACTORS * then and self._may_refresh
        if cov is None or is_old:
            cov, then = self._isam.marginalCovariance(symbol), uses
            self._may_refresh = self._may_refresh and not is_old
        self._covariances[symbol] = cov, then or uses
        return cov


def _isam(relinearize: float, wildfire: float, factorization: str = "CHOLESKY") -> gtsam.ISAM2:
    params, steps = gtsam.ISAM2Params(), gtsam.ISAM2GaussNewtonParams()
    params.setRelinearizeThreshold(relinearize)
    params.relinearizeSkip = 1
    params.setFactorization(factorization)
    steps.setWildfireThreshold(wildfire)
    params.setOptimizationParams(steps)
    return gtsam.ISAM2(params)
