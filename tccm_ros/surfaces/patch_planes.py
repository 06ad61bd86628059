"""Planes of patches in map, with the covariances of their heights and slopes.

The plane of a patch is the height field ``h(x, y) = z + a (x - x0) + b (y - y0)`` about its
centroid ``(x0, y0, z)``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.cuboids.inclination import FIT_OF_A_LINE
from tccm_ros.planes.horizontal_strips import MIN_WIDTH
from tccm_ros.surfaces.views import Patch

EFFECTIVE_POINTS = 50.0
"""The points of a patch have correlated errors (one laser, a few scan lines): they count as at most
this many independent points; chosen."""

FLATNESS = 0.004
"""Deviation of furniture from a plane, m (one sigma); chosen."""

GATE = 3.0
"""Sigmas within which the heights of two planes agree; chosen."""

UP = np.array([0.0, 0.0, 1.0])

MIN_NORMAL_Z = 0.5
"""Limit of a normal's z component in a division, so that a steep fit gives no infinite variance.
Chosen: 60 deg."""

MIN_NORMAL_Z_OF_SLOPE = 0.1
"""The same where slopes are computed. Chosen: 84 deg."""


class PatchPlanes(NamedTuple):
    """Height fields of P patches in map; a named tuple, as kernels take no other class.

    Attributes
    ----------
    view_index
        int64 (P,), view of each patch: patches of one view share their pose's error.
    centroid
        float64 (P, 3), m.
    slope
        float64 (P, 2), dz/dx and dz/dy.
    noise
        float64 (P,), variance of the height of one point about the plane, m2.
    cov_pose
        float64 (P, 3, 3) of (z, a, b) at the centroid, from the pose of the view.
    """

    view_index: Int64
    centroid: Float64
    slope: Float64
    noise: Float64
    cov_pose: Float64


def fit_plane(cov: Float64) -> tuple[Float64, Float64]:
    """Fit the exact least-squares plane to points of covariance `cov`, float64 (3, 3).

    Surfaces are horizontal, or nearly so. Where the fit is steep, the points are on a line and do
    not determine the slope across it: the plane is then the one nearest to horizontal through the
    line.

    Returns
    -------
    normal : float64 (3,)
        Unit, up.
    variances : float64 (3,)
        Eigenvalues of `cov`, ascending, m2: the first is the variance about the plane.
    """
    variances, axes = np.linalg.eigh(cov)
    normal = axes[:, 0] if axes[2, 0] >= 0.0 else -axes[:, 0]
    if normal[2] < FIT_OF_A_LINE:
        along = axes[:, 2]
        across = UP - along[2] * along
        length = float(np.linalg.norm(across))
        normal = across / length if length > FIT_OF_A_LINE else UP
    return normal, np.maximum(variances, 0.0)


def is_line(cov: Float64) -> bool:
    """Return whether points of covariance `cov`, float64 (3, 3), m2, lie on a line."""
    return bool(12.0 * np.linalg.eigvalsh(cov)[1] < MIN_WIDTH**2)


def pool_moments(counts: Float64, means: Float64, covs: Float64) -> tuple[float, Float64, Float64]:
    """Pool the moments of sets of points.

    Parameters
    ----------
    counts, means, covs
        float64 (K,), (K, 3) and (K, 3, 3), of each set in one frame.

    Returns
    -------
    count : float
    mean, cov : float64 (3,) and (3, 3)
        Of the union of the sets.
    """
    total = float(counts.sum())
    weights = counts / total
    mean = weights @ means
    offsets = means - mean
    cov = np.einsum("k,kij->ij", weights, covs + offsets[:, :, None] * offsets[:, None, :])
    return total, mean, cov


def point_variance(cov: Float64) -> float:
    """Return the variance of one point's height about the plane of points with `cov`, m2."""
    normal, variances = fit_plane(cov)
    return float(variances[0] / max(normal[2], MIN_NORMAL_Z) ** 2 + FLATNESS**2)


def fit_covariance(cov: Float64, count: int) -> Float64:
    """Return the covariance of (z, a, b) of a fit to `count` points of covariance `cov` (3, 3)."""
    noise = point_variance(cov)
    result = np.zeros((3, 3))
    result[0, 0] = noise / min(count, EFFECTIVE_POINTS)
    regular = cov[:2, :2] + FLATNESS**2 * np.eye(2)
    result[1:, 1:] = noise / min(count, EFFECTIVE_POINTS) * np.linalg.inv(regular)
    return result


def pose_covariance(T_map_base: Float64, cov_z_roll_pitch: Float64, centroid: Float64) -> Float64:
    """Propagate the covariance of a pose to (z, a, b) at a centroid.

    Parameters
    ----------
    T_map_base
        float64 (4, 4), pose of the view.
    cov_z_roll_pitch
        float64 (3, 3) of (z, roll, pitch) of the base, m and rad.
    centroid
        float64 (3,), in map.
    """
    c, s = T_map_base[0, 0], T_map_base[1, 0]
    norm = np.hypot(c, s)
    c, s = c / norm, s / norm
    forward, left = np.array([c, s]), np.array([-s, c])
    arm = centroid[:2] - T_map_base[:2, 3]
    J = np.array(
        [
            [1.0, left @ arm, -(forward @ arm)],
            [0.0, left[0], -forward[0]],
            [0.0, left[1], -forward[1]],
        ]
    )
    return J @ cov_z_roll_pitch @ J.T


def stack_planes(
    patches: list[Patch], view: Int64, T_map_view: Float64, cov_z_roll_pitch: Float64
) -> PatchPlanes:
    """Compute the planes of patches in map, with their covariances.

    Parameters
    ----------
    patches
        P patches.
    view
        int64 (P,), index of each patch's view.
    T_map_view
        float64 (V, 4, 4).
    cov_z_roll_pitch
        float64 (V, 3, 3) of (z, roll, pitch).
    """
    P = len(patches)
    centroid, slope = np.zeros((P, 3)), np.zeros((P, 2))
    noise, cov_pose = np.zeros(P), np.zeros((P, 3, 3))
    for p, patch in enumerate(patches):
        T = T_map_view[view[p]]
        cov = T[:3, :3] @ patch.cov @ T[:3, :3].T
        normal, _ = fit_plane(cov)
        centroid[p] = T[:3, :3] @ patch.mean + T[:3, 3]
        slope[p] = -normal[:2] / max(normal[2], MIN_NORMAL_Z_OF_SLOPE)
        noise[p] = point_variance(cov)
        cov_pose[p] = pose_covariance(T, cov_z_roll_pitch[view[p]], centroid[p])
    return PatchPlanes(view, centroid, slope, noise, cov_pose)
