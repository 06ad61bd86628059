"""Agreement of several recordings on one rig: compare the estimates of single recordings.

Between two recordings, the laser may have been moved, or the zero of the tilt changed. One rig
fitted to both would be wrong for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc

from tccm_ros.calibrate.estimate import Estimate
from tccm_ros.calibrate.observability import UNITS, columns
from tccm_ros.errors import BagError
from tccm_ros.results.numbers import plain

MIN_PROBABILITY = 1e-4
"""Minimum probability of a disagreement between recordings of one rig (chosen)."""


@dataclass(frozen=True, slots=True)
class ComparedQuantity:
    """One parameter as estimated from several recordings.

    Attributes
    ----------
    name
        Name as in `UNITS`.
    bags
        Names of the recordings that determine it.
    values, sigmas
        Estimates and their standard deviations, rad, 1, m or s.
    """

    name: str
    bags: tuple[str, ...]
    values: tuple[float, ...]
    sigmas: tuple[float, ...]

    @property
    def chi_square(self) -> float:
        """Sum of squared deviations over variances; its mean is the number of recordings - 1."""
        values, weights = np.array(self.values), 1.0 / np.array(self.sigmas) ** 2
        return float(np.sum(weights * (values - np.average(values, weights=weights)) ** 2))

    @property
    def probability(self) -> float:
        """Probability of at least this disagreement between recordings of one rig."""
        return float(chdtrc(len(self.values) - 1, self.chi_square))

    def text(self) -> str:
        """Return a line with the smallest and the largest value, and their bags."""
        unit, factor = UNITS[self.name]
        low, high = int(np.argmin(self.values)), int(np.argmax(self.values))
        shown = [
            f"{self.values[i] * factor:.4g} +- {self.sigmas[i] * factor:.2g} {unit}".rstrip()
            + f" in {self.bags[i]}"
            for i in (low, high)
        ]
        return f"{self.name} is {' and '.join(shown)}"


@dataclass(frozen=True, slots=True)
class Agreement:
    """The parameters that at least two recordings determine.

    Attributes
    ----------
    compared
        In the order of `UNITS`.
    """

    compared: tuple[ComparedQuantity, ...]

    @property
    def differing(self) -> tuple[ComparedQuantity, ...]:
        """Parameters that differ between recordings, the most significant first."""
        off = [one for one in self.compared if one.probability < MIN_PROBABILITY]
        return tuple(sorted(off, key=lambda one: -one.chi_square / len(one.values)))

    def check(self) -> None:
        """Raise an error that names differing parameters, if there are any.

        Raises
        ------
        BagError
            If the recordings are not of one rig.
        """
        if self.differing:
            found = "; ".join(one.text() for one in self.differing)
            raise BagError(f"the recordings are not of one rig: {found}; calibrate them separately")

    def to_json(self) -> list[dict[str, Any]]:
        """Return all values as plain numbers."""
        return [
            {
                **plain(one),
                "chi_square": round(one.chi_square, 3),
                "probability": float(f"{one.probability:.3g}"),
            }
            for one in self.compared
        ]


def compare(bags: Sequence[str], estimates: Sequence[Estimate]) -> Agreement:
    """Compare the estimates of single recordings.

    Weak parameters are not fixed: a wrong fixed value would bias the others.
    """
    found = [_free(estimate) for estimate in estimates]
    result = []
    for name in UNITS:
        shown = [(bag, *one[name]) for bag, one in zip(bags, found) if name in one]
        if len(shown) > 1:
            names, values, sigmas = zip(*shown)
            result.append(ComparedQuantity(name, names, values, sigmas))
    return Agreement(tuple(result))


def _free(estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Return values and standard deviations of the free parameters, by name."""
    sigmas = estimate.standard_deviations
    return {
        name: (float(estimate.solution.x[column]), float(sigmas[column]))
        for name, column in columns(estimate.problem.layout).items()
        if estimate.free[column]
    }
