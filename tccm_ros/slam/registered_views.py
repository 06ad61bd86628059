"""Factors between views in a continued graph, in which a view keeps its variable.

Callers number views anew each time.
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
        Stamps of the views in the graph, in the order of their variables.
    """

    def __init__(self, stamps_ns: Sequence[int]) -> None:
        self._numbers = {stamp: number for number, stamp in enumerate(stamps_ns)}
        self._factors: list[Factor] = []

    def keys(self, stamps_ns: Sequence[int]) -> list[Key]:
        """Return the variables of views; they do not depend on other views."""
        for stamp in stamps_ns:
            self._numbers.setdefault(stamp, len(self._numbers))
        return [view_key(self._numbers[stamp]) for stamp in stamps_ns]

    def take(self, stamps_ns: Sequence[int], factors: Iterable[Factor]) -> None:
        """Replace the factors; they number views by their index in `stamps_ns`."""
        numbers = [key.number for key in self.keys(stamps_ns)]
        self._factors = [
            replace(factor, i=numbers[factor.i], j=numbers[factor.j])
            if isinstance(factor, BetweenViews)
            else factor
            for factor in factors
        ]

    def factors(self, views: Collection[Key]) -> list[Factor]:
        """Return the newest factors between existing views."""
        there = {key.number for key in views}
        return [f for f in self._factors if _views_of(f) <= there]


def _views_of(factor: Factor) -> set[int]:
    return {factor.i, factor.j} if isinstance(factor, BetweenViews) else set()
