"""Points from rays: the least-squares point of several, and the one that most of them agree on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64

MIN_PARALLAX = 0.15
"""Two rays with a smaller angle (rad) between them do not tell a point. Chosen: 9 deg; a bearing
that is off by 0.3 deg puts the point 4 % of its distance further away."""

MIN_RANGE, MAX_RANGE = 0.3, 15.0
"""Nearest and furthest point (m) that is told from a picture (chosen)."""

RAY_CHI2 = 13.8
"""Gate for the squared Mahalanobis distance of a point from a ray: 99.9 % of two degrees of
freedom."""

MAX_PAIRS = 400
"""Pairs of rays that are tried at most, evenly chosen (chosen)."""

ROUNDS = 3
"""Solutions with the ranges of the solution before (chosen: the third moves nothing)."""


class Rays(NamedTuple):
    """Rays from cameras to points.

    Attributes
    ----------
    origins, directions
        float64 (N, 3), m and unit vectors, in one frame.
    angle_variance
        float64 (N,), of the direction about any axis across it, rad2.
    position_variance
        float64 (N,), of the origin in any direction, m2.
    """

    origins: Float64
    directions: Float64
    angle_variance: Float64
    position_variance: Float64

    def of(self, index: Int64 | list[int]) -> Rays:
        """Return some of the rays."""
        return Rays(*(column[index] for column in self))

    def chi2(self, point: Float64) -> Float64:
        """Return squared Mahalanobis distances float64 (N,) of a point (3,); inf out of range."""
        away = point - self.origins
        along = np.einsum("nk,nk->n", away, self.directions)
        across2 = np.maximum(np.einsum("nk,nk->n", away, away) - along**2, 0.0)
        variance = self.angle_variance * along**2 + self.position_variance
        is_seen = (along > MIN_RANGE) & (along < MAX_RANGE)
        return np.where(is_seen, across2 / variance, np.inf)


class Point(NamedTuple):
    """A point by triangulation.

    Attributes
    ----------
    position, covariance
        float64 (3,) and (3, 3), m and m2, in the frame of the rays.
    parallax
        Largest angle between two of the rays, rad.
    """

    position: Float64
    covariance: Float64
    parallax: float


def triangulate(rays: Rays) -> Point:
    """Return the point with the least sum of squared Mahalanobis distances from rays.

    A ray tells the two directions across it; its weight follows from the range, which the round
    before gives.

    Parameters
    ----------
    rays
        Two or more, not all parallel.
    """
    d = rays.directions
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    weights = np.ones(len(d))
    for _ in range(ROUNDS):
        information = np.einsum("n,nij->ij", weights, across)
        seen = np.einsum("n,nij,nj->i", weights, across, rays.origins)
        position = np.linalg.solve(information, seen)
        along = np.einsum("nk,nk->n", position - rays.origins, d)
        weights = 1.0 / (rays.angle_variance * along**2 + rays.position_variance)
    covariance = np.linalg.inv(np.einsum("n,nij->ij", weights, across))
    return Point(position, covariance, parallax(d))


def parallax(directions: Float64) -> float:
    """Return the largest angle (rad) between two of the unit vectors (N, 3)."""
    return float(np.arccos(np.clip((directions @ directions.T).min(initial=1.0), -1.0, 1.0)))


def consensus(rays: Rays, min_rays: int) -> tuple[list[int], Point] | None:
    """Return the rays that meet in one point, and that point: the point with the most rays.

    Pairs of rays are tried; each ray counts by its squared distance from their point, up to the
    gate (P. Torr and A. Zisserman, 2000, "MLESAC"). Rays to a second point are outliers.

    Parameters
    ----------
    rays
        N of them.
    min_rays
        How many must meet.

    Returns
    -------
    Indices of the rays and the point; None where too few meet, or without the parallax.
    """
    best: tuple[float, Float64] | None = None
    for i, j in _pairs(rays.directions):
        try:
            point = triangulate(rays.of([i, j])).position
        except np.linalg.LinAlgError:
            continue
        cost = float(np.minimum(rays.chi2(point), RAY_CHI2).sum())
        if best is None or cost < best[0]:
            best = cost, point
    if best is None:
        return None
    near = np.flatnonzero(rays.chi2(best[1]) < RAY_CHI2)
    for _ in range(ROUNDS):
        if len(near) < min_rays or parallax(rays.directions[near]) < MIN_PARALLAX:
            return None
        found = triangulate(rays.of(near))
        near, before = np.flatnonzero(rays.chi2(found.position) < RAY_CHI2), near
        if np.array_equal(near, before):
            return near.tolist(), found
    return None


def _pairs(directions: Float64) -> list[list[int]]:
    """Return pairs of rays with enough parallax, in order; at most `MAX_PAIRS`, evenly chosen."""
    angles = np.arccos(np.clip(directions @ directions.T, -1.0, 1.0))
    pairs = np.argwhere(np.triu(angles, 1) >= MIN_PARALLAX)
    if len(pairs) > MAX_PAIRS:
        pairs = pairs[np.linspace(0, len(pairs) - 1, MAX_PAIRS).astype(np.int64)]
    return list(pairs.tolist())
