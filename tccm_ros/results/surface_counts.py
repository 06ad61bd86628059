"""Count surfaces above the floor, in the same way for all displayed numbers.

A surface counts if it is above the floor and has at least 0.1 m2, so that a robot can put an object
on it; evaluations count the same. Smaller ones are counted separately; pieces of the floor are not
counted.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Protocol

MIN_COUNTED_AREA_M2 = 0.1
"""Minimum area of a counted surface, m2. Chosen: a hand-sized object fits on it."""


class _Surface(Protocol):
    @property
    def label(self) -> str: ...

    @property
    def area(self) -> float: ...


class SurfaceCounts(NamedTuple):
    """Numbers of surfaces above the floor.

    Attributes
    ----------
    counted
        Surfaces of at least `MIN_COUNTED_AREA_M2`.
    small
        Smaller surfaces.
    """

    counted: int
    small: int

    def text(self) -> str:
        """Return the numbers as text."""
        text = f"{self.counted} surface{'' if self.counted == 1 else 's'}"
        return text + (f" (and {self.small} below {MIN_COUNTED_AREA_M2} m²)" if self.small else "")


def count_surfaces(surfaces: Iterable[_Surface]) -> SurfaceCounts:
    """Count surfaces above the floor."""
    areas = [s.area for s in surfaces if s.label != "floor"]
    counted = sum(area >= MIN_COUNTED_AREA_M2 for area in areas)
    return SurfaceCounts(counted, len(areas) - counted)
