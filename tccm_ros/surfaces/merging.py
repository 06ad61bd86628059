"""Merging: patches that touch and are coplanar become one surface, in one view or several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import transform
from tccm_ros.surfaces.carving import Survivors
from tccm_ros.surfaces.contact import box_pairs, connect, patch_clouds
from tccm_ros.surfaces.outline import horizontal_outline
from tccm_ros.surfaces.patch_planes import stack_planes
from tccm_ros.surfaces.views import Patch, View, first_numbers


@dataclass(frozen=True, slots=True, eq=False)
class NumberedPatch:
    """The part of a patch that carving left, with its number.

    Attributes
    ----------
    number
        Of the patch, counted over all views in stamp order.
    view
        Index of its view.
    patch
        In the frame of the view.
    """

    number: int
    view: int
    patch: Patch


Members = tuple[NumberedPatch, ...]
"""Patches that are one surface, in the order of their numbers."""

MergeFunction = Callable[[Sequence[Float64], float], Int64]
"""A merging of P patches, from the points of each in map, float64 (N, 3), and a distance (m):
returns for each patch the first patch of its surface, int64 (P,)."""


def surviving_patches(views: list[View], left: Survivors, config: Config) -> list[NumberedPatch]:
    """Return the patches of which points are left.

    Parameters
    ----------
    views
        In stamp order.
    left
        Of `carve`, for these views.
    config
        Uses `surfaces.merge_distance`.

    Returns
    -------
    list of NumberedPatch
        In the order of their numbers; moments and outlines are of the points that are left.
    """
    found = []
    for v, (first, view) in enumerate(zip(first_numbers(views), views)):
        for p, patch in enumerate(view.patches):
            rest = _rest(patch, left.keep[v][p], config)
            if rest is not None:
                found.append(NumberedPatch(first + p, v, rest))
    return found


def _rest(patch: Patch, keep: Bool, config: Config) -> Patch | None:
    """Return a patch of the points that are left, with their moments and outline; None: none."""
    if keep.all():
        return patch
    if not keep.any():
        return None
    points, weights = patch.points[keep], patch.weights[keep]
    exact, fraction = points.astype(np.float64), weights / weights.sum()
    mean = fraction @ exact
    cov = (exact - mean).T @ ((exact - mean) * fraction[:, None])
    outline, spacing = horizontal_outline(exact[:, :2], config.surfaces.merge_distance)
    return Patch(points, weights, int(weights.sum()), mean, cov, outline, spacing)


def clouds_in_map(patches: Sequence[NumberedPatch], T_map_view: Float64) -> list[Float64]:
    """Return the thinned points of each patch in map, float64 (N, 3), m."""
    return [transform(T_map_view[p.view], p.patch.points) for p in patches]


def merge_coplanar(
    patches: list[NumberedPatch], T_map_view: Float64, cov_z_roll_pitch: Float64, config: Config
) -> list[Members]:
    """Merge patches that touch and are coplanar.

    Parameters
    ----------
    patches
        In the order of their numbers.
    T_map_view, cov_z_roll_pitch
        float64 (V, 4, 4) and (V, 3, 3) of (z, roll, pitch), poses of the views.
    config
        Uses `surfaces.merge_distance` and `surfaces.max_step`.
    """
    if not patches:
        return []
    limits = config.surfaces
    clouds = patch_clouds(clouds_in_map(patches, T_map_view))
    pairs = box_pairs(clouds.boxes, limits.merge_distance)
    view = np.array([p.view for p in patches])
    planes = stack_planes([p.patch for p in patches], view, T_map_view, cov_z_roll_pitch)
    root = connect(clouds, pairs, limits.merge_distance, planes, limits.max_step)
    return group_patches(patches, root)


def group_patches(patches: Sequence[NumberedPatch], root: Int64) -> list[Members]:
    """Group patches by the first patch of their surface, `root` int64 (P,)."""
    groups = [np.flatnonzero(root == first).tolist() for first in np.unique(root)]
    return [tuple(patches[k] for k in group) for group in groups]
