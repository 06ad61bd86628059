"""Factors between views in a graph that goes on: a view and a surface keep their variables.

Who registers views numbers them, and the surfaces that they share, anew each time.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Sequence
from dataclasses import replace

from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, view_key
from tccm_ros.slam.factors.surfaces import ViewPlane
from tccm_ros.slam.factors.views import BetweenViews


class RegisteredViews:
    """The variables of views and of their surfaces, and the newest factors between them.

    Parameters
    ----------
    stamps_ns
        Of the views that are in the graph, in the order of their variables.
    """

    def __init__(self, stamps_ns: Sequence[int]) -> None:
        self._numbers = {stamp: number for number, stamp in enumerate(stamps_ns)}
        self._surfaces: dict[Hashable, int] = {}
        self._next_surface = 0
        self._factors: list[Factor] = []

    def keys(self, stamps_ns: Sequence[int]) -> list[Key]:
        """Return the variables of views; others that come or go do not change them."""
        for stamp in stamps_ns:
            self._numbers.setdefault(stamp, len(self._numbers))
        return [view_key(self._numbers[stamp]) for stamp in stamps_ns]

    def take(self, stamps_ns: Sequence[int], factors: Iterable[Factor]) -> None:
        """Take factors in the place of those before; they number views by `stamps_ns`."""
        numbers = [key.number for key in self.keys(stamps_ns)]
        self._factors = []
        planes: dict[int, list[ViewPlane]] = {}
        for factor in factors:
            if isinstance(factor, ViewPlane):
                factor = replace(factor, view=numbers[factor.view])
                planes.setdefault(factor.surface, []).append(factor)
            elif isinstance(factor, BetweenViews):
                self._factors.append(replace(factor, i=numbers[factor.i], j=numbers[factor.j]))
            else:
                self._factors.append(factor)
        self._number_surfaces(planes.values())

    def _number_surfaces(self, surfaces: Iterable[list[ViewPlane]]) -> None:
        """Give each surface the number that most of its patches had, if no other has it."""
        named: dict[Hashable, int] = {}
        taken: set[int] = set()
        for patches in surfaces:
            known = [self._surfaces[_patch(p)] for p in patches if _patch(p) in self._surfaces]
            free = [number for number in known if number not in taken]
            number = max(sorted(free), key=free.count) if free else self._next_surface
            self._next_surface = max(self._next_surface, number + 1)
            taken.add(number)
            named |= {_patch(patch): number for patch in patches}
            self._factors += [replace(patch, surface=number) for patch in patches]
        self._surfaces = named

    def factors(self, views: Collection[Key]) -> list[Factor]:
        """Return the newest factors between views that are still there."""
        there = {key.number for key in views}
        return [f for f in self._factors if _views_of(f) <= there]


def _patch(plane: ViewPlane) -> Hashable:
    """Name a patch: its plane in its view does not change."""
    return plane.view, plane.point.tobytes()


def _views_of(factor: Factor) -> set[int]:
    if isinstance(factor, ViewPlane):
        return {factor.view}
    return {factor.i, factor.j} if isinstance(factor, BetweenViews) else set()
