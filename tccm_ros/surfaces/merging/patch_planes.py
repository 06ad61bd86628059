"""Planes of patches in map, with the covariances of their heights and slopes.

The plane of a patch is the height field ``h(x, y) = z + a (x - x0) + b (y - y0)`` about its
centroid ``(x0, y0, z)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.cuboids.inclination import FIT_OF_A_LINE
from tccm_ros.planes.horizontal_strips import MIN_WIDTH
from tccm_ros.robust import GATE, UNIFORM_WIDTH
from tccm_ros.surfaces.views.views import SurfacePatch

UP = np.array([0.0, 0.0, 1.0])


class PatchPlanes(NamedTuple):
    """Height fields of P patches in map; a named tuple, as kernels take no other class.

    Attributes
    ----------
    view_index
        int64 (P,), view of each patch: patches of one view have a common pose error.
    centroid
        float64 (P, 3), m.
    slope
        float64 (P, 2), dz/dx and dz/dy.
    cov_fit
        float64 (P, 3, 3), covariance of (z, a, b) at the centroid due to the patch's own points.
    systematic
        float64 (P, 3, K): error of (z, a, b) for each component of the systematic error, at one
        sigma; common to the patches of one view.
    cov_pose
        float64 (P, 3, 3), covariance of (z, a, b) at the centroid due to the pose of the view.
    """

    view_index: Int64
    centroid: Float64
    slope: Float64
    cov_fit: Float64
    systematic: Float64
    cov_pose: Float64


def fit_plane(cov: Float64) -> tuple[Float64, Float64]:
    """Fit the exact least-squares plane to points of covariance `cov`, float64 (3, 3).

    Surfaces are horizontal, or nearly so. If the fit is steep, the points are on a line and do not
    determine the slope across it: the plane is then the one through the line that is nearest to
    horizontal.

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
    return bool(np.linalg.eigvalsh(cov)[1] < (MIN_WIDTH / UNIFORM_WIDTH) ** 2)


def pool_moments(counts: Float64, means: Float64, covs: Float64) -> tuple[float, Float64, Float64]:
    """Pool the moments of sets of points.

    Parameters
    ----------
    counts, means, covs
        float64 (K,), (K, 3) and (K, 3, 3), moments of each set, in one frame.

    Returns
    -------
    count : float
    mean, cov : float64 (3,) and (3, 3)
        Moments of the union of the sets.
    """
    total = float(counts.sum())
    weights = counts / total
    mean = weights @ means
    offsets = means - mean
    cov = np.einsum("k,kij->ij", weights, covs + offsets[:, :, None] * offsets[:, None, :])
    return total, mean, cov


def agree_in_height(step: float, variance: float, max_step: float) -> bool:
    """Return whether two surfaces agree in height: within `GATE` sigmas, and within `max_step`, m.

    Parameters
    ----------
    step, variance
        Their difference in height where they are nearest, m, and its variance, m2.
    max_step
        Max difference of one surface (`surfaces.max_step`), m.
    """
    return bool(abs(step) <= min(GATE * np.sqrt(variance), max_step))


def pose_jacobian(T_map_base: Float64, centroid: Float64) -> Float64:
    """Return the Jacobian (3, 3) of (z, a, b) at a centroid by (z, roll, pitch) of the base.

    Parameters
    ----------
    T_map_base
        float64 (4, 4), pose of the view.
    centroid
        float64 (3,), in map.
    """
    c, s = T_map_base[0, 0], T_map_base[1, 0]
    norm = np.hypot(c, s)
    forward, left = np.array([c, s]) / norm, np.array([-s, c]) / norm
    arm = centroid[:2] - T_map_base[:2, 3]
    return np.array(
        [
            [1.0, left @ arm, -(forward @ arm)],
            [0.0, left[0], -forward[0]],
            [0.0, left[1], -forward[1]],
        ]
    )


def stack_planes(
    patches: Sequence[SurfacePatch], view: Int64, T_map_view: Float64, cov_z_roll_pitch: Float64
) -> PatchPlanes:
    """Compute the planes of patches in map, with their covariances.

    Parameters
    ----------
    patches
        P patches.
    view
        int64 (P,), index of each patch's view.
    T_map_view
        float64 (V, 4, 4), poses of the views.
    cov_z_roll_pitch
        float64 (V, 3, 3), covariances of (z, roll, pitch) of the views.
    """
    P = len(patches)
    centroid, slope = np.zeros((P, 3)), np.zeros((P, 2))
    cov_fit, cov_pose = np.zeros((P, 3, 3)), np.zeros((P, 3, 3))
    parts = max((patch.systematic.shape[1] for patch in patches), default=0)
    systematic = np.zeros((P, 3, parts))
    for p, patch in enumerate(patches):
        T = T_map_view[view[p]]
        normal, _ = fit_plane(T[:3, :3] @ patch.cov @ T[:3, :3].T)
        centroid[p] = T[:3, :3] @ patch.mean + T[:3, 3]
        slope[p] = -normal[:2] / normal[2]
        # The base is horizontal within a few degrees: slopes rotate with its yaw.
        R = np.eye(3)
        R[1:, 1:] = T[:2, :2] / np.hypot(T[0, 0], T[1, 0])
        cov_fit[p] = R @ patch.cov_plane @ R.T
        systematic[p, :, : patch.systematic.shape[1]] = R @ patch.systematic
        J = pose_jacobian(T, centroid[p])
        cov_pose[p] = J @ cov_z_roll_pitch[view[p]] @ J.T
    return PatchPlanes(view, centroid, slope, cov_fit, systematic, cov_pose)
