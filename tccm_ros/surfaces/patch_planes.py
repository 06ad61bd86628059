"""Planes of patches in the map, with how well they are known, and which are coplanar.

A patch's height near its middle is the height field ``h(x, y) = z + a (x - x0) + b (y - y0)``.
Its covariance over (z, a, b) is that of the fit and that of the pose that the patch hangs on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tccm_ros.surfaces.views import Patch

__all__ = ["PatchPlanes", "coplanar", "fit_plane", "pool_moments", "stack_planes"]

Float64 = NDArray[np.float64]

EFFECTIVE_POINTS = 50.0
"""The points of a patch err together (one laser, a few sweep lines): they count as this many."""

FLATNESS = 0.004
"""Furniture is flat to this much, m (one sigma)."""

GATE = 3.0
"""Sigmas within which two planes count as one."""


@dataclass(frozen=True, slots=True, eq=False)
class PatchPlanes:
    """Height fields of P patches in map.

    Attributes
    ----------
    view
        int64 (P,), view of each patch: patches of one view share their pose's error.
    centroid
        float64 (P, 3), m.
    slope
        float64 (P, 2), dz/dx and dz/dy.
    cov_fit, cov_pose
        float64 (P, 3, 3) of (z, a, b) at the centroid.
    """

    view: NDArray[np.int64]
    centroid: Float64
    slope: Float64
    cov_fit: Float64
    cov_pose: Float64


def fit_plane(cov: Float64) -> tuple[Float64, Float64]:
    """Fit the exact least-squares plane to points of covariance `cov`, float64 (3, 3).

    Returns
    -------
    normal : float64 (3,)
        Unit, up.
    variances : float64 (3,)
        Eigenvalues of `cov`, ascending, m2: the first is the variance about the plane.
    """
    variances, axes = np.linalg.eigh(cov)
    normal = axes[:, 0] if axes[2, 0] >= 0.0 else -axes[:, 0]
    return normal, np.maximum(variances, 0.0)


def pool_moments(counts: Float64, means: Float64, covs: Float64) -> tuple[float, Float64, Float64]:
    """Pool the moments of sets of points: counts (K,), means (K, 3), covs (K, 3, 3)."""
    total = float(counts.sum())
    share = counts / total
    mean = share @ means
    offsets = means - mean
    cov = np.einsum("k,kij->ij", share, covs + offsets[:, :, None] * offsets[:, None, :])
    return total, mean, cov


def fit_covariance(cov: Float64, count: int) -> Float64:
    """Return the covariance of (z, a, b) of a fit to points with covariance `cov` (3, 3)."""
    normal, variances = fit_plane(cov)
    noise = variances[0] / max(normal[2], 0.5) ** 2 + FLATNESS**2
    result = np.zeros((3, 3))
    result[0, 0] = noise / min(count, EFFECTIVE_POINTS)
    floor = FLATNESS**2 * np.eye(2)
    result[1:, 1:] = noise / min(count, EFFECTIVE_POINTS) * np.linalg.inv(cov[:2, :2] + floor)
    return result


def pose_covariance(T_map_base: Float64, cov_tilt: Float64, centroid: Float64) -> Float64:
    """Return the covariance of (z, a, b) at a centroid from that of a pose.

    Parameters
    ----------
    T_map_base
        float64 (4, 4), pose of the view.
    cov_tilt
        float64 (3, 3) of (z, roll, pitch) of the base, m and rad.
    centroid
        float64 (3,), in map.
    """
    c, s = T_map_base[0, 0], T_map_base[1, 0]
    norm = np.hypot(c, s)
    c, s = c / norm, s / norm
    ahead, left = np.array([c, s]), np.array([-s, c])
    arm = centroid[:2] - T_map_base[:2, 3]
    J = np.array(
        [
            [1.0, left @ arm, -(ahead @ arm)],
            [0.0, left[0], -ahead[0]],
            [0.0, left[1], -ahead[1]],
        ]
    )
    return J @ cov_tilt @ J.T


def stack_planes(
    patches: list[Patch], view: NDArray[np.int64], T_map_view: Float64, cov_tilt: Float64
) -> PatchPlanes:
    """Compute the planes of patches in map.

    Parameters
    ----------
    patches
        P patches.
    view
        int64 (P,), index of each patch's view.
    T_map_view
        float64 (V, 4, 4).
    cov_tilt
        float64 (V, 3, 3) of (z, roll, pitch).
    """
    P = len(patches)
    centroid, slope = np.zeros((P, 3)), np.zeros((P, 2))
    cov_fit, cov_pose = np.zeros((P, 3, 3)), np.zeros((P, 3, 3))
    for p, patch in enumerate(patches):
        T = T_map_view[view[p]]
        cov = T[:3, :3] @ patch.cov @ T[:3, :3].T
        normal, _ = fit_plane(cov)
        centroid[p] = T[:3, :3] @ patch.mean + T[:3, 3]
        slope[p] = -normal[:2] / max(normal[2], 0.1)
        cov_fit[p] = fit_covariance(cov, patch.count)
        cov_pose[p] = pose_covariance(T, cov_tilt[view[p]], centroid[p])
    return PatchPlanes(view, centroid, slope, cov_fit, cov_pose)


def coplanar(
    planes: PatchPlanes, boxes: Float64, pairs: NDArray[np.int64], largest_step: float
) -> NDArray[np.bool_]:
    """Tell which pairs of patches lie in one plane, within their uncertainty.

    The heights are compared in the middle of the overlap of the two boxes, or of the gap between
    them; they differ by less than GATE sigmas and never by more than `largest_step`.

    Parameters
    ----------
    planes
        Of P patches.
    boxes
        float64 (P, 6), x_min y_min z_min x_max y_max z_max, m.
    pairs
        int64 (M, 2).
    largest_step
        m.

    Returns
    -------
    bool (M,)
    """
    q, p = pairs[:, 0], pairs[:, 1]
    middle = 0.5 * (
        np.maximum(boxes[q, :2], boxes[p, :2]) + np.minimum(boxes[q, 3:5], boxes[p, 3:5])
    )
    height, variance = np.zeros((2, len(pairs))), np.full(len(pairs), 2.0 * FLATNESS**2)
    for side, patch in enumerate((q, p)):
        arm = middle - planes.centroid[patch, :2]
        height[side] = planes.centroid[patch, 2] + np.sum(planes.slope[patch] * arm, axis=1)
        J = np.concatenate([np.ones((len(pairs), 1)), arm], axis=1)
        cov = planes.cov_fit[patch] + np.where(
            (planes.view[q] != planes.view[p])[:, None, None], planes.cov_pose[patch], 0.0
        )
        variance += np.einsum("mi,mij,mj->m", J, cov, J)
    step = np.abs(height[0] - height[1])
    return step <= np.minimum(GATE * np.sqrt(variance), largest_step)
