"""Adjustment of z, roll and pitch of views by the planes of surfaces seen in several views.

Horizontal planes do not constrain x, y and yaw, so that the adjustment is outside of the graph, and
linear. The unknowns are (z, roll, pitch) of each view, the components of its systematic error, and
the plane of each surface. Each patch is an observation of its surface's plane, at the patch's
centroid. A patch whose residual is too large for its covariance is rejected as an outlier.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.surfaces.merging.patch_planes import PatchPlanes

SIGNIFICANCE = 1e-3
"""Probability that a correct patch is rejected as an outlier; chosen: one in a thousand."""

TINY = 1e-6
"""Numerical tolerance: standard deviation added to that of a pose, m and rad, so that it may be
exact; prior information of a surface's plane per patch, 1/m2 and 1, so that patches may all be
rejected; and variance of the residual in a tested direction, as a fraction of the patch's own."""


@dataclass(frozen=True, slots=True, eq=False)
class PlaneAdjustment:
    """Result of the adjustment of V views by P patches.

    Attributes
    ----------
    correction
        float64 (V, 3), corrections of z, roll and pitch, m and rad.
    cov
        float64 (V, 3, 3), covariance of (z, roll, pitch) after the correction.
    used
        bool (P,), whether a patch is an inlier.
    chi2
        float64 (P,), squared Mahalanobis norm of the residual of each patch.
    freedom
        int64 (P,), its degrees of freedom.
    """

    correction: Float64
    cov: Float64
    used: Bool
    chi2: Float64
    freedom: Int64


def adjust_planes(
    planes: PatchPlanes, jacobians: Float64, surface: Int64, cov_z_roll_pitch: Float64
) -> PlaneAdjustment:
    """Estimate z, roll and pitch of views so that the planes of surfaces agree.

    Parameters
    ----------
    planes
        Planes of P patches.
    jacobians
        float64 (P, 3, 3), derivatives of their planes by (z, roll, pitch) (`pose_jacobian`).
    surface
        int64 (P,), the surface of each patch, from 0.
    cov_z_roll_pitch
        float64 (V, 3, 3), prior covariances of (z, roll, pitch) of the views.
    """
    used = np.ones(len(surface), np.bool_)
    limits = chdtri(np.arange(1, 4), SIGNIFICANCE)
    while True:
        system = _System(planes, jacobians, surface, cov_z_roll_pitch, used)
        square, freedom = system.residuals()
        excess = np.where(used & (freedom > 0), square / limits[np.maximum(freedom, 1) - 1], 0.0)
        # Reject only the worst patch of each surface: it may cause the residuals of the others.
        worst = np.lexsort((-excess, surface))
        worst = worst[np.unique(surface[worst], return_index=True)[1]]
        out = worst[excess[worst] > 1.0]
        if not len(out):
            return PlaneAdjustment(
                system.correction[:, :3], system.cov_views[:, :3, :3], used, square, freedom
            )
        used[out] = False


class _System:
    """Solution of the normal equations: three unknowns per surface, three or more per view.

    Views are eliminated first (Schur complement), as each is connected to surfaces only.
    """

    def __init__(
        self,
        planes: PatchPlanes,
        jacobians: Float64,
        surface: Int64,
        cov_z_roll_pitch: Float64,
        used: Bool,
    ) -> None:
        V, S, parts = len(cov_z_roll_pitch), int(surface.max(initial=-1)) + 1, planes.systematic
        self._view, self._surface, self._used = planes.view_index, surface, used
        count = np.maximum(np.bincount(surface, minlength=S), 1)
        middle = np.stack(
            [np.bincount(surface, planes.centroid[:, k], S) / count for k in range(3)], axis=1
        )
        # Observation: y + B u (of the view) = H theta (of the surface).
        self._B = np.concatenate([jacobians, -parts], axis=2)
        self._H = np.tile(np.eye(3), (len(surface), 1, 1))
        offset = planes.centroid - middle[surface]
        self._H[:, 0, 1:] = offset[:, :2]
        self._y = np.column_stack([offset[:, 2], planes.slope])
        self._cov = planes.cov_fit
        W = np.linalg.inv(self._cov) * used[:, None, None]
        D = self._B.shape[2]
        information = np.zeros((V, D, D))
        information[:, :3, :3] = np.linalg.inv(cov_z_roll_pitch + TINY**2 * np.eye(3))
        information[:, 3:, 3:] = np.eye(D - 3)
        BtW = self._B.transpose(0, 2, 1) @ W
        HtW = self._H.transpose(0, 2, 1) @ W
        np.add.at(information, self._view, BtW @ self._B)
        views = np.asarray(np.linalg.inv(information), np.float64)
        right_views = np.zeros((V, D))
        np.add.at(right_views, self._view, -(BtW @ self._y[:, :, None])[:, :, 0])
        blocks, sums = np.zeros((S, 3, 3)), np.zeros((S, 3))
        np.add.at(blocks, surface, HtW @ self._H + TINY * np.eye(3))
        np.add.at(sums, surface, (HtW @ self._y[:, :, None])[:, :, 0])
        reduced: Float64 = block_diag(*blocks)
        right = sums.reshape(-1)
        seen = _seen_by_view(self._view, surface)
        gains = {}
        for v, (rows, place, columns) in seen.items():
            by_surface = np.zeros((len(columns) // 3, D, 3))
            np.add.at(by_surface, place, -(BtW[rows] @ self._H[rows]))
            cross = by_surface.transpose(1, 0, 2).reshape(D, -1)
            gains[v] = views[v] @ cross
            reduced[np.ix_(columns, columns)] -= cross.T @ gains[v]
            right[columns] -= gains[v].T @ right_views[v]
        self._cov_surfaces = np.linalg.inv(reduced)
        surfaces = self._cov_surfaces @ right
        self._planes = surfaces.reshape(S, 3)
        self.correction = (views @ right_views[:, :, None])[:, :, 0]
        self.cov_views, self._cov_both = views, np.zeros((len(surface), D, 3))
        for v, (rows, place, columns) in seen.items():
            self.correction[v] -= gains[v] @ surfaces[columns]
            spread = gains[v] @ self._cov_surfaces[np.ix_(columns, columns)]
            self.cov_views[v] += spread @ gains[v].T
            self._cov_both[rows] = -spread.reshape(D, -1, 3)[:, place].transpose(1, 0, 2)

    def residuals(self) -> tuple[Float64, Int64]:
        """Return chi2, float64 (P,), and degrees of freedom, int64 (P,), of the residuals."""
        rows = np.arange(3)
        columns = 3 * self._surface[:, None] + rows
        H, B = self._H, self._B
        cov_plane = self._cov_surfaces[columns[:, :, None], columns[:, None, :]]
        between = B @ self._cov_both @ H.transpose(0, 2, 1)
        known = B @ self.cov_views[self._view] @ B.transpose(0, 2, 1)
        known += H @ cov_plane @ H.transpose(0, 2, 1) - between - between.transpose(0, 2, 1)
        # The residual of an inlier is correlated with the solution; that of an outlier is not.
        cov = self._cov + np.where(self._used, -1.0, 1.0)[:, None, None] * known
        r = self._y + (B @ self.correction[self._view][:, :, None])[:, :, 0]
        r -= (H @ self._planes[self._surface][:, :, None])[:, :, 0]
        whiten = np.linalg.inv(np.linalg.cholesky(self._cov))
        values, axes = np.linalg.eigh(whiten @ cov @ whiten.transpose(0, 2, 1))
        along = (axes.transpose(0, 2, 1) @ whiten @ r[:, :, None])[:, :, 0]
        is_tested = values > TINY
        square = np.where(is_tested, along**2 / np.where(is_tested, values, 1.0), 0.0)
        return square.sum(axis=1), is_tested.sum(axis=1)


def _seen_by_view(view: Int64, surface: Int64) -> dict[int, tuple[Int64, Int64, Int64]]:
    """Return the patches of each view, and the unknowns of the surfaces that it saw.

    Returns
    -------
    dict of int to (rows, place, columns)
        By view: its patches, the index of each patch's surface among the surfaces of the view, and
        the columns of the unknowns of these surfaces.
    """
    seen = {}
    for v in np.unique(view).tolist():
        rows = np.flatnonzero(view == v)
        numbers, place = np.unique(surface[rows], return_inverse=True)
        columns = (3 * numbers[:, None] + np.arange(3)).ravel()
        seen[v] = (rows, place.reshape(-1), columns)
    return seen
