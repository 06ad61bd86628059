"""Merging: coplanar patches that touch become one surface, in one view or several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import transform
from tccm_ros.records import SensorKind
from tccm_ros.surfaces.merging.carving import Survivors
from tccm_ros.surfaces.merging.contact import connect
from tccm_ros.surfaces.merging.patch_planes import stack_planes
from tccm_ros.surfaces.merging.recent_cache import RecentCache
from tccm_ros.surfaces.views.outline import horizontal_outline
from tccm_ros.surfaces.views.plane_errors import fit_covariance
from tccm_ros.surfaces.views.views import SurfacePatch, View, first_numbers


@dataclass(frozen=True, slots=True, eq=False)
class NumberedPatch:
    """The part of a patch that carving left, with its number.

    Attributes
    ----------
    number
        Number of the patch, counted over all views in stamp order.
    view
        Index of its view.
    patch
        The patch, in the frame of the view.
    """

    number: int
    view: int
    patch: SurfacePatch


Members = tuple[NumberedPatch, ...]
"""Patches of one surface, in the order of their numbers."""

MergeFunction = Callable[[Sequence[Float64], float], Int64]
"""Merges P patches, given the points of each in map, float64 (N, 3), and a distance (m); returns
for each patch the first patch of its surface, int64 (P,)."""


class Remainders:
    """Makes patches of the points that carving left, with a cache.

    Most patches keep the same points from one solution to the next. The cache does not affect the
    result.

    Parameters
    ----------
    config
        Uses `surfaces.merge_distance`.
    """

    def __init__(self, config: Config):
        self._config = config
        self._known = RecentCache[SurfacePatch | None]()

    @property
    def outlined(self) -> int:
        """Number of remainders that the last `surviving_patches` made, not found in the cache."""
        return self._known.made

    def surviving_patches(self, views: list[View], survivors: Survivors) -> list[NumberedPatch]:
        """Return the patches with points that carving left.

        Parameters
        ----------
        views
            Views in stamp order.
        survivors
            Result of `carve` for these views.

        Returns
        -------
        list of NumberedPatch
            In the order of their numbers, with moments and outlines of the remaining points.
        """
        self._known.begin_round()
        found = []
        for v, (first, view) in enumerate(zip(first_numbers(views), views)):
            for p, patch in enumerate(view.patches):
                keep = survivors.keep[v][p]
                rest = patch if keep.all() else self._rest(view, p, keep)
                if rest is not None:
                    found.append(NumberedPatch(first + p, v, rest))
        return found

    def _rest(self, view: View, index: int, keep: Bool) -> SurfacePatch | None:
        """Return a patch of a view with the kept points only; None: no points are kept."""
        patch, distance = view.patches[index], self._config.surfaces.merge_distance
        key = patch, distance, blake2b(keep.tobytes(), digest_size=16).digest()
        return self._known.get(key, partial(_rest, patch, keep, distance, view.sensor))


def _rest(
    patch: SurfacePatch, keep: Bool, distance: float, sensor: SensorKind
) -> SurfacePatch | None:
    """Return a patch of the kept points, with their moments and outline; None: no points."""
    if not keep.any():
        return None
    points, weights = patch.points[keep], patch.weights[keep]
    exact, fraction = points.astype(np.float64), weights / weights.sum()
    mean = fraction @ exact
    cov = (exact - mean).T @ ((exact - mean) * fraction[:, None])
    outline, spacing = horizontal_outline(exact[:, :2], distance, sensor)
    own = fit_covariance(exact, weights.astype(np.float64))
    moved = np.eye(3)
    moved[0, 1:] = (mean - patch.mean)[:2]
    systematic = moved @ patch.systematic
    return SurfacePatch(
        points, weights, int(weights.sum()), mean, cov, outline, spacing, own, systematic
    )


def clouds_in_map(patches: Sequence[NumberedPatch], T_map_view: Float64) -> list[Float64]:
    """Return the thinned points of each patch in map, float64 (N, 3), m."""
    return [transform(T_map_view[p.view], p.patch.points) for p in patches]


def merge_coplanar(
    patches: list[NumberedPatch], T_map_view: Float64, cov_z_roll_pitch: Float64, config: Config
) -> list[Members]:
    """Merge coplanar patches that touch.

    Parameters
    ----------
    patches
        Patches in the order of their numbers.
    T_map_view, cov_z_roll_pitch
        float64 (V, 4, 4), poses, and (V, 3, 3), covariances of (z, roll, pitch), of the views.
    config
        Uses `surfaces.merge_distance` and `surfaces.max_step`.
    """
    if not patches:
        return []
    limits = config.surfaces
    clouds = clouds_in_map(patches, T_map_view)
    view = np.array([p.view for p in patches])
    planes = stack_planes([p.patch for p in patches], view, T_map_view, cov_z_roll_pitch)
    root = connect(clouds, planes, limits.merge_distance, limits.max_step)
    return group_patches(patches, root)


def group_patches(patches: Sequence[NumberedPatch], root: Int64) -> list[Members]:
    """Group patches by the first patch of their surface, `root` int64 (P,)."""
    groups = [np.flatnonzero(root == first).tolist() for first in np.unique(root)]
    return [tuple(patches[k] for k in group) for group in groups]
