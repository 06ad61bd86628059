"""A solved graph that is continued: new factors are added, changed ones replaced."""

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
"""Threshold of motion (m, rad) for relinearisation. Chosen: the linearisation error is quadratic,
and is 0.01 mm over a metre here."""

WILDFIRE = 1e-6
"""Threshold of motion (m, rad) below which a change is not propagated (chosen)."""

MAX_ROUNDS = 2
"""Maximum number of updates until no variable has moved by `RELINEARIZE`; the next solution
continues (chosen: in maps with many loop closures, an update takes as long as a batch step)."""

SAME_MEASUREMENT, SAME_COVARIANCE = 1e-4, 0.2
"""A factor is kept if the new measurements (m, rad) differ by at most the first, and the covariance
by at most the second as a fraction (chosen)."""

MORE_FACTORS = 1.5
"""A covariance is recomputed, one per update, when the number of its variable's factors has grown
by this factor: uncertainty decreases over time, so that the old covariance is conservative
(chosen)."""


@dataclass(frozen=True, eq=False)
class KeptSolution(GraphSolution):
    """The state of a `KeptGraph`, with its cached covariances.

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
    """A graph updated by ISAM2.

    Parameters
    ----------
    covariances
        Known marginal covariances of future variables, in GTSAM's tangent order.
    """

    def __init__(self, covariances: Mapping[Key, Float64]) -> None:
        self._isam = Isam(RELINEARIZE, wildfire=WILDFIRE)
        self._values = gtsam.Values()
        # Number of factors of each variable, now and when its covariance was computed.
        self._uses: Counter[int] = Counter()
        self._covariances = {key.symbol: (cov, 0) for key, cov in covariances.items()}
        self._may_refresh = True
        # Replaceable factors and factors of groups, with their indices in the graph.
        self._revisable: dict[Hashable, tuple[Factor, list[int]]] = {}
        self._groups: dict[Hashable, list[int]] = {}

    def update(
        self,
        factors: Iterable[Factor],
        poses: Mapping[Key, Float64],
        revisable: Iterable[Factor] = (),
        groups: Mapping[Hashable, Sequence[Factor]] | None = None,
    ) -> list[list[int]]:
        """Add factors and new poses, replace changed factors, and optimise.

        Parameters
        ----------
        factors
            New permanent factors.
        poses
            Start values (3,) or (4, 4) of poses; existing poses keep theirs. New landmarks are
            initialised by their factors.
        revisable
            All replaceable factors: they replace those of the previous call.
        groups
            Factors by group; they replace the previous factors of the group.

        Returns
        -------
        list of list of int
            The indices in the graph of each of `factors`

        Raises
        ------
        RuntimeError
            Where the graph does not determine its variables; the object is then unusable.
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
        """Remove factors by index; each of their variables must have other factors."""
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
        """Relinearise variables that have moved, up to `MAX_ROUNDS` times."""
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
        """Return the marginal covariance in GTSAM's tangent order; see `MORE_FACTORS`."""
        symbol, uses = key.symbol, self._uses[key.symbol]
        cov, then = self._covariances.get(symbol, (None, 0))
        is_old = bool(then) and uses > MORE_FACTORS * then and self._may_refresh
        if cov is None or is_old:
            cov, then = self._isam.isam.marginalCovariance(symbol), uses
            self._may_refresh = self._may_refresh and not is_old
        self._covariances[symbol] = cov, then or uses
        return cov


def _by_identity(factors: Iterable[Factor]) -> dict[Hashable, Factor]:
    """Return factors by type and variables, with a counter to distinguish equal ones."""
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
    """Return whether two factors of the same variables are equal within tolerance."""
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
