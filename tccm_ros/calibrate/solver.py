"""Robust Gauss-Newton, and covariances of residuals with common errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.calibrate.problem import Linearised, Problem
from tccm_ros.robust import median_sigma

HALF_WEIGHT = 3.0
"""Scale of the Geman-McClure weights, in standard deviations (chosen)."""

ROUNDS, SMALL_STEP = 8, 1e-3
"""Maximum number of iterations, and step in standard deviations at which they end (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class SolverResult:
    """The result of `solve`.

    Attributes
    ----------
    x
        float64 (P,), parameters at the minimum.
    linearised
        Residuals and derivatives at the minimum.
    weights
        float64 (N,), robust weights of the residuals, 0 to 1.
    scale
        Robust standard deviation of the residuals, at least 1.
    """

    x: Float64
    linearised: Linearised
    weights: Float64
    scale: float


def solve(
    problem: Problem, x: Float64, free: Bool, means: Float64, sigmas: Float64
) -> SolverResult:
    """Minimise the weighted residuals over the free parameters.

    Parameters
    ----------
    problem
        The problem whose residuals are minimised.
    x
        float64 (P,), start values; fixed parameters keep them.
    free
        bool (P,), mask of the free parameters.
    means, sigmas
        Means and standard deviations of the priors, float64 (P,); infinite for no prior.
    """
    x = x.copy()
    prior = 1.0 / sigmas[free] ** 2
    for _ in range(ROUNDS):
        lin = problem.linearise(x)
        weights, scale = _weights(lin)
        root = np.sqrt(weights)[:, None] / scale
        J, r = lin.jacobian * root, lin.residuals * root[:, 0]
        H = (J.T @ J)[np.ix_(free, free)] + np.diag(prior)
        g = (J.T @ r)[free] + prior * (x - means)[free]
        step = -_solve_scaled(H, g)
        x[free] += step
        if np.all(np.abs(step) * np.sqrt(np.diag(H)) < SMALL_STEP):
            break
    lin = problem.linearise(x)
    weights, scale = _weights(lin)
    return SolverResult(x, lin, weights, scale)


def _solve_scaled(H: Float64, g: Float64) -> Float64:
    """Return s of H s = g for parameters of different scales; 0 in the null space of H."""
    size = np.sqrt(np.maximum(np.diag(H), 1e-30))
    result: Float64 = np.linalg.lstsq(H / np.outer(size, size), g / size, rcond=1e-12)[0] / size
    return result


def _weights(lin: Linearised) -> tuple[Float64, float]:
    """Return robust weights float64 (N,) and the scale of the residuals, at least 1."""
    if len(lin.residuals) == 0:
        return np.zeros(0), 1.0
    scale = max(median_sigma(lin.residuals), 1.0)
    u = lin.residuals / (scale * HALF_WEIGHT)
    return 1.0 / (1.0 + u**2) ** 2, scale


def covariance(solution: SolverResult, free: Bool, sigmas: Float64) -> Float64:
    """Return the covariance float64 (F, F) of the free parameters.

    It is the sandwich estimate over clusters of hits with common errors, with variances no smaller
    than those of independent noise.

    Parameters
    ----------
    solution
        Solution at the minimum.
    free
        bool (P,), mask of the free parameters.
    sigmas
        Standard deviations of the priors to use, float64 (P,); infinite for none.
    """
    lin, scale = solution.linearised, solution.scale
    J, w = lin.jacobian[:, free], solution.weights / scale**2
    prior = np.diag(1.0 / sigmas[free] ** 2)
    H = J.T @ (w[:, None] * J) + prior
    size = np.sqrt(np.maximum(np.diag(H), 1e-30))
    inverse = np.linalg.pinv(H / np.outer(size, size), rcond=1e-13, hermitian=True)
    inverse = inverse / np.outer(size, size)
    _, cluster = np.unique(lin.cluster, return_inverse=True)
    gradients = np.zeros((int(cluster.max()) + 1, J.shape[1]))
    np.add.at(gradients, cluster, (w * lin.residuals)[:, None] * J)
    shared = inverse @ (gradients.T @ gradients + prior) @ inverse
    grow = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(shared), 1e-300), 1.0))
    result: Float64 = shared * np.outer(grow, grow)
    return result
