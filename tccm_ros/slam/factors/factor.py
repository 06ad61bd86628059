"""The interface of factors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from dataclasses import fields
from typing import Any, Protocol

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import Key


class Factor(Protocol):
    """A factor that can be added to a graph: a dataclass of variables, measurements and noise."""

    @property
    def landmark(self) -> Key | None:
        """The landmark that this factor can initialise; None for none."""

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add the factor in GTSAM's form."""

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return start values of landmarks that have none yet."""


SAME_MEASUREMENT, SAME_NOISE = 1e-4, 0.2
"""Two factors are equal if their measurements (m, rad) differ by at most `SAME_MEASUREMENT`, and
their variances by at most `SAME_NOISE` as a fraction (chosen)."""


def by_variables(factors: Iterable[Factor], label: str = "") -> dict[Hashable, Factor]:
    """Return factors by a name of label, type and variables, numbered where several are equal."""
    named: dict[Hashable, Factor] = {}
    numbers: Counter[Hashable] = Counter()
    for factor in factors:
        variables = tuple(v for v in _values(factor).values() if isinstance(v, Key))
        name = label, type(factor), variables
        named[name, numbers[name]] = factor
        numbers[name] += 1
    return named


def is_same(one: Factor, other: Factor) -> bool:
    """Return whether two factors of one type and of the same variables are equal within tolerance.

    The tolerances are `SAME_MEASUREMENT` and `SAME_NOISE`.
    """
    values = _values(other)
    for name, value in _values(one).items():
        if isinstance(value, Key):
            continue
        a, b = np.asarray(value, float), np.asarray(values[name], float)
        if name.startswith("sigma"):
            a, b = a**2, b**2
        is_noise = name.startswith(("cov", "sigma"))
        limit = SAME_NOISE * np.abs(a).max() if is_noise else SAME_MEASUREMENT
        if a.shape != b.shape or np.abs(a - b).max(initial=0.0) > limit:
            return False
    return True


def _values(factor: Any) -> dict[str, Any]:
    return {field.name: getattr(factor, field.name) for field in fields(factor)}


class NoLandmark:
    """Base of factors that initialise no variable."""

    @property
    def landmark(self) -> Key | None:
        """None."""
        return None

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return no start values."""
        return []
