"""Surfaces as plane landmarks: what several views saw ties their heights and leans together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.slam.factors import ViewPlane
from tccm_ros.surfaces.merged_patches import Members, PlacedPatch, merge
from tccm_ros.surfaces.patch_planes import fit_covariance, fit_plane

__all__ = ["plane_factors"]

Float64 = NDArray[np.float64]

MOST_TILT = 0.02
"""A patch whose tilt is less certain than this (rad) tells nothing about leans; it is left out."""


def plane_factors(
    placed: list[PlacedPatch], T_map_view: Float64, cov_tilt: Float64, config: Config
) -> list[ViewPlane]:
    """Return a factor for each patch of each surface that more than one view saw.

    Parameters
    ----------
    placed
        Patches in the order of their numbers.
    T_map_view, cov_tilt
        float64 (V, 4, 4) and (V, 3, 3) of (z, roll, pitch), the views as known so far.
    config
        Uses the group ``surfaces``.
    """
    factors: list[ViewPlane] = []
    landmark = 0
    for surface in merge(placed, T_map_view, cov_tilt, config):
        members = _informative(surface)
        if len({member.view for member in members}) > 1:
            factors += [_factor(member, landmark) for member in members]
            landmark += 1
    return factors


def _informative(members: Members) -> list[PlacedPatch]:
    return [m for m in members if m.patch.count > 3 and _tilt_variance(m) <= MOST_TILT**2]


def _tilt_variance(member: PlacedPatch) -> float:
    cov = fit_covariance(member.patch.cov, member.patch.count)
    return float(np.linalg.eigvalsh(cov[1:, 1:])[1])


def _factor(member: PlacedPatch, landmark: int) -> ViewPlane:
    """Measure a patch's plane in its view.

    The covariance is isotropic in the two rotations, the larger one for both, and the offset at
    the view's origin is that at the centroid and what the rotation makes of the way there.
    """
    patch = member.patch
    normal, _ = fit_plane(patch.cov)
    tilt = _tilt_variance(member)
    arm = patch.mean - (patch.mean @ normal) * normal
    offset = fit_covariance(patch.cov, patch.count)[0, 0] + tilt * float(arm @ arm)
    cov = np.diag([tilt, tilt, offset])
    return ViewPlane(member.view, landmark, normal, float(normal @ patch.mean), cov)
