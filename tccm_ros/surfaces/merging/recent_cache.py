"""A cache of results by their inputs; it drops what several solutions did not use."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Result = TypeVar("Result")

KEPT_ROUNDS = 3
"""Number of rounds after which an unused result is dropped. Chosen: each solution takes two rounds,
with poses before and after registration, and a pose may alternate between two steps."""


class RecentCache(Generic[Result]):
    """Results of the last rounds.

    Attributes
    ----------
    made
        Number of results that the current round computed because they were not known.
    """

    def __init__(self) -> None:
        self._known: dict[Hashable, tuple[int, Result]] = {}
        self._round = 0
        self.made = 0

    def begin_round(self) -> None:
        """Drop the results that the last rounds did not use."""
        self._round += 1
        self._known = {k: e for k, e in self._known.items() if self._round - e[0] <= KEPT_ROUNDS}
        self.made = 0

    def get(self, key: Hashable, make: Callable[[], Result]) -> Result:
        """Return the result of a key, from `make` if it is not known.

        Parameters
        ----------
        key
            All inputs of the result. Views and patches count by identity.
        make
            Computes it.
        """
        known = self._known.get(key)
        if known is None:
            self.made += 1
        result = make() if known is None else known[1]
        self._known[key] = self._round, result
        return result
