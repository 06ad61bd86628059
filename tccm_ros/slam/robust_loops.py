"""Graduated non-convexity for loop closures (Yang et al. 2020), truncated least squares.

Solves the graph again and again with reweighted loops: the weights start nearly equal and end at
zero or one. No factor needs a robust model of its own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tccm_ros.slam.graph import GraphSolution

__all__ = ["graduate"]

Float64 = NDArray[np.float64]

CHI2_LIMIT = 16.3
"""A loop whose squared Mahalanobis distance is larger is wrong: 99.9 % of three degrees."""

STEP = 2.0
"""Factor of the control parameter from one solution to the next."""

MOST_ROUNDS = 15
LEAST_WEIGHT = 1e-4
"""A weight of zero would take a factor's information away altogether."""


def graduate(
    solve: Callable[[Float64], GraphSolution],
    chi2: Callable[[GraphSolution], Float64],
    count: int,
    limit: float = CHI2_LIMIT,
) -> tuple[GraphSolution, Float64]:
    """Find the weights of `count` doubtful factors.

    Parameters
    ----------
    solve
        Optimises the graph with given weights float64 (count,).
    chi2
        Gives the factors' squared Mahalanobis distances, unweighted, float64 (count,).
    count
        Doubtful factors.
    limit
        Squared distance of an inlier.

    Returns
    -------
    The last solution, and weights float64 (count,): `LEAST_WEIGHT` or 1.
    """
    weights = np.ones(count)
    solution = solve(weights)
    if not count:
        return solution, weights
    r2 = chi2(solution)
    if r2.max() <= limit:
        return solution, weights
    mu = max(limit / (2.0 * float(r2.max()) - limit), 1e-3)
    for _ in range(MOST_ROUNDS):
        new = _weights(r2, mu, limit)
        settled = np.all((new <= LEAST_WEIGHT) | (new >= 1.0)) and np.array_equal(new, weights)
        weights = new
        solution = solve(weights)
        r2 = chi2(solution)
        if settled:
            break
        mu *= STEP
    final = np.where(r2 <= limit, 1.0, LEAST_WEIGHT)
    return (solution if np.array_equal(final, weights) else solve(final)), final


def _weights(r2: Float64, mu: float, limit: float) -> Float64:
    """Return Eq. (14) of the paper: weights of truncated least squares at control `mu`."""
    middle = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(r2, 1e-12)) - mu
    weights = np.where(r2 >= (mu + 1.0) / mu * limit, 0.0, middle)
    weights = np.where(r2 <= mu / (mu + 1.0) * limit, 1.0, weights)
    return np.asarray(np.clip(weights, LEAST_WEIGHT, 1.0))
