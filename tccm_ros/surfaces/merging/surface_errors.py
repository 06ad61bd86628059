"""Errors of the planes of surfaces with several patches.

The plane of a surface is fitted to the points of all its patches. Its error is the weighted sum of
those of the patches. Each patch has an independent error; the errors of the view's pose and of its
sensor are common to the patches of the view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.planes.plane_noise import FLATNESS
from tccm_ros.surfaces.merging.merging import NumberedPatch
from tccm_ros.surfaces.merging.patch_planes import pose_jacobian, stack_planes
from tccm_ros.surfaces.views.plane_errors import BLOCKS


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceErrors:
    """The error of (z, dz/dx, dz/dy) of a surface's plane at its centroid, by source.

    Attributes
    ----------
    mean
        float64 (3,), the centroid, in map, m.
    view
        int64 (P,), view of each patch.
    own
        float64 (P, 3, 3), covariance due to each patch's own error.
    pose
        float64 (P, 3, 3), derivative by (z, roll, pitch) of the patch's view.
    systematic
        float64 (P, 3, K), error due to the components of the view's systematic error, at one sigma.
    bend
        Variance, m2, of the surface about its plane, at the scale of the blocks from which the
        covariances of the patches' planes were estimated.
    """

    mean: Float64
    view: Int64
    own: Float64
    pose: Float64
    systematic: Float64
    bend: float

    def covariance(self, cov_z_roll_pitch: Float64) -> Float64:
        """Return the covariance float64 (3, 3) of the plane.

        One sensor took all views, so that its systematic error is the same in all of them.

        Parameters
        ----------
        cov_z_roll_pitch
            float64 (V, 3, 3), covariances of (z, roll, pitch) of the views.
        """
        cov = self.own.sum(axis=0) + np.diag([FLATNESS**2, 0.0, 0.0])
        for v in np.unique(self.view):
            by_pose = self.pose[self.view == v].sum(axis=0)
            cov += by_pose @ cov_z_roll_pitch[v] @ by_pose.T
        shared = self.systematic.sum(axis=0)
        return np.asarray(cov + shared @ shared.T)


def surface_errors(
    members: Sequence[NumberedPatch], mean: Float64, T_map_view: Float64, cov_z_roll_pitch: Float64
) -> SurfaceErrors:
    """Return the errors of the plane fit of the points of patches.

    Parameters
    ----------
    members
        P patches of a surface.
    mean
        float64 (3,), the centroid of their points, in map, m.
    T_map_view, cov_z_roll_pitch
        float64 (V, 4, 4), poses, and (V, 3, 3), covariances of (z, roll, pitch), of the views.
    """
    view = np.array([member.view for member in members])
    planes = stack_planes([m.patch for m in members], view, T_map_view, cov_z_roll_pitch)
    counts = [member.patch.count for member in members]
    information, total = np.zeros((len(members), 3, 3)), np.zeros((3, 3))
    for p, member in enumerate(members):
        R, patch = T_map_view[member.view][:2, :2], member.patch
        moments, shift = np.eye(3), np.eye(3)
        moments[1:, 1:] = R @ patch.cov[:2, :2] @ R.T + FLATNESS**2 * np.eye(2)
        shift[0, 1:] = (planes.centroid[p] - mean)[:2]
        information[p] = patch.count * shift.T @ moments
        total += information[p] @ shift
    gain = np.linalg.solve(total, information)
    J = np.stack([pose_jacobian(T_map_view[v], c) for v, c in zip(view, planes.centroid)])
    own = gain @ planes.cov_fit @ gain.transpose(0, 2, 1)
    bend = BLOCKS * float(np.average(planes.cov_fit[:, 0, 0], weights=counts)) + FLATNESS**2
    return SurfaceErrors(mean, view, own, gain @ J, gain @ planes.systematic, bend)


def step_variance(
    a: SurfaceErrors, b: SurfaceErrors, at_xy: Float64, cov_z_roll_pitch: Float64
) -> float:
    """Return the variance, m2, of the difference in height of two surfaces at a position.

    Errors of a view that are common to both surfaces cancel. The deviation of both surfaces from
    their planes is added.

    Parameters
    ----------
    a, b
        Errors of the two surfaces.
    at_xy
        float64 (2,), in map, m.
    cov_z_roll_pitch
        float64 (V, 3, 3), covariances of (z, roll, pitch) of the views.
    """
    variance = a.bend + b.bend
    by_view: dict[int, tuple[Float64, Float64]] = {}
    for errors, sign in ((a, 1.0), (b, -1.0)):
        arm = sign * np.r_[1.0, at_xy - errors.mean[:2]]
        variance += float(arm @ errors.own.sum(axis=0) @ arm)
        for v, pose, shared in zip(
            errors.view.tolist(), arm @ errors.pose, arm @ errors.systematic
        ):
            before = by_view.get(v, (np.zeros_like(pose), np.zeros_like(shared)))
            by_view[v] = before[0] + pose, before[1] + shared
    for v, (pose, shared) in by_view.items():
        variance += float(pose @ cov_z_roll_pitch[v] @ pose + shared @ shared)
    return variance
