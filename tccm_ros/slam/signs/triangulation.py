"""Triangulation of points from rays: least squares, and robust consensus."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64

MIN_PARALLAX = 0.15
"""Minimum angle (rad) between two rays for triangulation. Chosen: 9 deg; a bearing error of 0.3 deg
changes the distance by 4 %."""

MIN_RANGE, MAX_RANGE = 0.3, 15.0
"""Minimum and maximum distance (m) of a point from a camera (chosen)."""

RAY_CHI2 = 13.8
"""Gate on the squared Mahalanobis distance of a point from a ray: 99.9 % of two degrees of
freedom."""

MAX_PAIRS = 400
"""Maximum number of pairs of rays to test, evenly spaced (chosen)."""

ROUNDS = 3
"""Number of iterations of the ranges, which give the weights (chosen: the third has no effect)."""


class Rays(NamedTuple):
    """Rays from cameras to points.

    Attributes
    ----------
    origins, directions
        float64 (N, 3), m and unit vectors, in one frame.
    angle_variance
        float64 (N,), variance of the direction about any perpendicular axis, rad2.
    position_variance
        float64 (N,), variance of the origin in any direction, m2.
    """

    origins: Float64
    directions: Float64
    angle_variance: Float64
    position_variance: Float64

    def of(self, index: Int64 | list[int]) -> Rays:
        """Return the rays of an index."""
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
    """A triangulated point.

    Attributes
    ----------
    position, covariance
        float64 (3,) and (3, 3), m and m2, in the frame of the rays.
    """

    position: Float64
    covariance: Float64


def triangulate(rays: Rays) -> Point:
    """Return the point with the least sum of squared Mahalanobis distances from rays.

    A ray constrains its two perpendicular directions. The weight depends on the range, which is
    taken from the previous iteration.

    Parameters
    ----------
    rays
        Two or more rays, not all parallel.
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
    return Point(position, covariance)


def parallax(directions: Float64) -> float:
    """Return the largest angle (rad) between two of the unit vectors (N, 3)."""
    return float(np.arccos(np.clip((directions @ directions.T).min(initial=1.0), -1.0, 1.0)))


def consensus(rays: Rays, min_rays: int) -> tuple[list[int], Point] | None:
    """Return the largest set of rays that meet in one point, and that point.

    Each pair of rays gives a candidate; each ray adds its squared distance from it, up to the gate
    (P. Torr and A. Zisserman, 2000, "MLESAC"). Rays to another point are outliers.

    Parameters
    ----------
    rays
        N rays.
    min_rays
        Minimum number of inlier rays.

    Returns
    -------
    Indices of the inlier rays and the point; None with too few inliers or too little parallax.
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
    """Return pairs of rays with enough parallax, in order; at most `MAX_PAIRS`, evenly spaced."""
    angles = np.arccos(np.clip(directions @ directions.T, -1.0, 1.0))
    pairs = np.argwhere(np.triu(angles, 1) >= MIN_PARALLAX)
    if len(pairs) > MAX_PAIRS:
        pairs = pairs[np.linspace(0, len(pairs) - 1, MAX_PAIRS).astype(np.int64)]
    return list(pairs.tolist())
