"""A solved graph that goes on: what is new is added, what has changed is replaced."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import chain
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.graph.incremental import Isam
from tccm_ros.slam.graph.pose_graph import GraphSolution

RELINEARIZE = 0.005
"""A variable that moved by more (m, rad) is linearised anew. Chosen: the error of a linearisation
grows with the square, and is 0.01 mm over a metre here."""

WILDFIRE = 1e-6
"""Variables that move by less (m, rad) do not pass the change on (chosen)."""

MAX_ROUNDS = 2
"""Updates at most until no variable has moved by `RELINEARIZE`; the next solution goes on (chosen:
where loop closures are everywhere, each takes as long as a step of the batch)."""

SAME_MEASUREMENT, SAME_COVARIANCE = 1e-4, 0.2
"""A factor stays in place of another whose measurements (m, rad) differ by no more, and whose
covariance by no more than this fraction (chosen)."""

MORE_FACTORS = 1.5
"""A covariance is computed again, one after each update, when its variable has so many times as
many factors: a variable becomes more certain, so that the old one is on the safe side (chosen)."""


@dataclass(frozen=True, eq=False)
class KeptSolution(GraphSolution):
    """The state of a `KeptGraph`; covariances are those that it remembers.

    Attributes
    ----------
    kept
        The graph.
    """

    kept: KeptGraph

    def covariance(self, key: Key) -> Float64:
        """Return the marginal covariance in GTSAM's tangent order of the variable."""
        return self.kept.covariance(key)


class KeptGraph:
    """A graph that is updated by ISAM2.

    Parameters
    ----------
    covariances
        Marginal covariances that are known of the variables to come, in GTSAM's tangent order.
    """

    def __init__(self, covariances: Mapping[Key, Float64]) -> None:
        self._isam = Isam(RELINEARIZE, wildfire=WILDFIRE)
        self._values = gtsam.Values()
        # Of each variable: how many factors it has, and how many it had when its covariance came.
        self._uses: Counter[int] = Counter()
        self._covariances = {key.symbol: (cov, 0) for key, cov in covariances.items()}
        self._may_refresh = True
        # The factors that may change and those of groups, with their indices in the graph.
        self._revisable: dict[Hashable, tuple[Factor, list[int]]] = {}
        self._groups: dict[Hashable, list[int]] = {}

    def update(
        self,
        factors: Iterable[Factor],
        poses: Mapping[Key, Float64],
        revisable: Iterable[Factor] = (),
        groups: Mapping[Hashable, Sequence[Factor]] | None = None,
    ) -> list[list[int]]:
        """Add factors and new poses, replace what has changed, and optimise.

        Parameters
        ----------
        factors
            New ones, which stay.
        poses
            Start values (3,) or (4, 4) of poses; those that are in the graph are left as they are.
            Landmarks that are new are started by their factors.
        revisable
            All factors that may change: the graph has these afterwards, and none of those that were
            given here before.
        groups
            Factors by the name of their group, in the place of those that the group had before.

        Returns
        -------
        list of list of int
            The indices in the graph of each of `factors`

        Raises
        ------
        RuntimeError
            Where the graph does not determine its variables; it is of no use then.
        """
        wanted, together = _by_identity(revisable), groups or {}
        gone = [i for name in together for i in self._groups.pop(name, [])]
        for name, (factor, indices) in list(self._revisable.items()):
            if name not in wanted or not _is_same(factor, wanted[name]):
                gone += indices
                del self._revisable[name]
        fresh = {name: f for name, f in wanted.items() if name not in self._revisable}
        added = [*factors]
        grouped = [factor for group in together.values() for factor in group]
        numbers = self._add([*added, *fresh.values(), *grouped], poses, gone)
        rest = iter(numbers[len(added) :])
        for name, factor in fresh.items():
            self._revisable[name] = factor, next(rest)
        for name, group in together.items():
            self._groups[name] = [i for _ in group for i in next(rest)]
        if numbers or gone:
            self._relinearise()
        return numbers[: len(added)]

    def remove(self, indices: Iterable[int]) -> None:
        """Take factors out by their indices; each of their variables must have others."""
        self._add([], {}, list(indices))
        self._relinearise()

    def _add(
        self, factors: list[Factor], poses: Mapping[Key, Float64], gone: list[int]
    ) -> list[list[int]]:
        numbers = self._isam.update(factors, poses, gone)
        graph = self._isam.isam.getFactorsUnsafe()
        for i in chain.from_iterable(numbers):
            self._uses.update(graph.at(i).keys())
        return numbers

    def _relinearise(self) -> None:
        """Linearise anew what has moved, until nothing has."""
        self._may_refresh = True
        for _ in range(MAX_ROUNDS):
            result = self._isam.isam.update()
            if not result.getVariablesRelinearized():
                break
        self._values = self._isam.isam.calculateBestEstimate()

    def solution(self) -> KeptSolution:
        """Return the estimates of all variables."""
        return KeptSolution(self._values, self._isam.isam.getFactorsUnsafe(), 0, self)

    def covariance(self, key: Key) -> Float64:
        """Return the marginal covariance in GTSAM's tangent order, as of `MORE_FACTORS`."""
        symbol, uses = key.symbol, self._uses[key.symbol]
        cov, then = self._covariances.get(symbol, (None, 0))
        is_old = bool(then) and uses > MORE_FACTORS * then and self._may_refresh
        if cov is None or is_old:
            cov, then = self._isam.isam.marginalCovariance(symbol), uses
            self._may_refresh = self._may_refresh and not is_old
        self._covariances[symbol] = cov, then or uses
        return cov


def _by_identity(factors: Iterable[Factor]) -> dict[Hashable, Factor]:
    """Name factors by their kind and variables, those of the same ones by their order."""
    named: dict[Hashable, Factor] = {}
    many: Counter[Hashable] = Counter()
    for factor in factors:
        values = _fields(factor)
        variables = tuple(v for v in values.values() if isinstance(v, (Key, int)))
        name = type(factor), variables
        named[name, many[name]] = factor
        many[name] += 1
    return named


def _is_same(one: Factor, other: Factor) -> bool:
    """Return whether two factors of the same variables say nearly the same."""
    values = _fields(other)
    for name, value in _fields(one).items():
        if isinstance(value, (Key, int)):
            continue
        a, b = np.asarray(value, float), np.asarray(values[name], float)
        limit = SAME_COVARIANCE * np.abs(a).max() if name.startswith("cov") else SAME_MEASUREMENT
        if a.shape != b.shape or np.abs(a - b).max(initial=0.0) > limit:
            return False
    return True


def _fields(factor: Any) -> dict[str, Any]:
    return {field.name: getattr(factor, field.name) for field in fields(factor)}
