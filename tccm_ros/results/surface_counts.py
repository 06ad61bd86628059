"""How many surfaces there are, counted in one way wherever a number is shown.

A surface counts if it is above the floor and at least 0.1 m2 large: what a robot can put something
on, and what truths and evaluations speak of. Smaller ones are told apart; parts of the floor are
no count of anything.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Protocol

__all__ = ["COUNTED_AREA", "SurfaceCounts", "count_surfaces"]

COUNTED_AREA = 0.1
"""Surfaces that are smaller (m2) are called small, and counted apart."""


class _Surface(Protocol):
    @property
    def label(self) -> str: ...

    @property
    def area(self) -> float: ...


class SurfaceCounts(NamedTuple):
    """Numbers of surfaces above the floor: of those that count, and of small ones."""

    counted: int
    small: int

    def text(self) -> str:
        """Return the numbers for people."""
        text = f"{self.counted} surface{'' if self.counted == 1 else 's'}"
        return text + (f" (and {self.small} below {COUNTED_AREA} m²)" if self.small else "")


def count_surfaces(surfaces: Iterable[_Surface]) -> SurfaceCounts:
    """Count surfaces above the floor."""
    areas = [s.area for s in surfaces if s.label != "floor"]
    counted = sum(area >= COUNTED_AREA for area in areas)
    return SurfaceCounts(counted, len(areas) - counted)
