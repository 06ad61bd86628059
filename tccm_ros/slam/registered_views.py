"""Factors between views in a graph that goes on: a view keeps its variable.

Who registers views numbers them anew each time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, view_key
from tccm_ros.slam.factors.views import BetweenViews


class RegisteredViews:
    """The variables of views, and the newest factors between them.

    Parameters
    ----------
    stamps_ns
        Of the views that are in the graph, in the order of their variables.
    """

    def __init__(self, stamps_ns: Sequence[int]) -> None:
        self._numbers = {stamp: number for number, stamp in enumerate(stamps_ns)}
        self._factors: list[Factor] = []

    def keys(self, stamps_ns: Sequence[int]) -> list[Key]:
        """Return the variables of views; others that come or go do not change them."""
        for stamp in stamps_ns:
            self._numbers.setdefault(stamp, len(self._numbers))
        return [view_key(self._numbers[stamp]) for stamp in stamps_ns]

    def take(self, stamps_ns: Sequence[int], factors: Iterable[Factor]) -> None:
        """Take factors in the place of those before; they number views by `stamps_ns`."""
        numbers = [key.number for key in self.keys(stamps_ns)]
        self._factors = [
            replace(factor, i=numbers[factor.i], j=numbers[factor.j])
            if isinstance(factor, BetweenViews)
            else factor
            for factor in factors
        ]

    def factors(self, views: Collection[Key]) -> list[Factor]:
        """Return the newest factors between views that are still there."""
        there = {key.number for key in views}
        return [f for f in self._factors if _views_of(f) <= there]


def _views_of(factor: Factor) -> set[int]:
    return {factor.i, factor.j} if isinstance(factor, BetweenViews) else set()
