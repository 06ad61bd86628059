"""Registration of views: factors of the graph from surfaces that several views saw.

The planes of surfaces constrain z, roll and pitch; their sides constrain x, y and yaw. A match of
sides is a robust factor between two views; its covariance is large in directions that the common
sides do not determine. There is no factor where two views have too few sides in common, or where
another relative pose fits nearly as well.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2, inverse, planar, spatial, transform, wrap_angle
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.noise import planar_covariance
from tccm_ros.slam.factors.surfaces import ViewPlane
from tccm_ros.slam.factors.views import BetweenViews
from tccm_ros.slam.solution import Solution
from tccm_ros.surfaces.carving import Carver, Survivors
from tccm_ros.surfaces.merging import Members, NumberedPatch, Remainders, merge_coplanar
from tccm_ros.surfaces.patch_planes import fit_covariance, fit_plane
from tccm_ros.surfaces.side_matching import SideMatch, match_sides
from tccm_ros.surfaces.sides import Sides, find_sides
from tccm_ros.surfaces.views import View

Z_ROLL_PITCH = [5, 0, 1]
"""z, roll and pitch in GTSAM's order (roll, pitch, yaw, x, y, z)."""

PLANAR_ORDER = [3, 4, 2]
"""x, y and yaw in the same order."""

MAX_TILT_SIGMA = 0.02
"""Max standard deviation of a patch's slope for a plane factor, rad; chosen."""

MAX_NEIGHBOUR_VIEWS = 6
"""Each view is matched with at most this many older ones, the nearest; chosen."""

YAW_WEIGHT = 1.0
"""Metres that a radian of yaw counts in the distance of two poses; chosen."""

MIN_SIGMA, MAX_SIGMA = (0.01, np.radians(0.3)), (0.15, np.radians(3.0))
"""Limits of the standard deviations (m, rad) of the relative pose of two views that the search
covers; chosen: with a wider search, sides of other surfaces match."""

MIN_REMAINING = 0.5
"""Min fraction of a patch that carving leaves for its sides to be matched; chosen: a patch with
less was moved or replaced."""

MIN_POINTS = 4
"""Points of a patch in a plane factor: three give a plane without a residual."""

OPEN_SIGMAS = (1.0, 1.0, 1.0)
"""Standard deviations of z, roll and pitch (m, rad) in a factor of sides. Chosen: wide, so that
it leaves them open."""


class Registration:
    """Finds the factors between views, and remembers what does not change with their poses.

    Parameters
    ----------
    config
        Uses the groups ``views`` and ``surfaces``.
    carver, remainders
        Those of a map of the same views, which remember what it compared; by default others.
    """

    def __init__(
        self,
        config: Config,
        carver: Carver | None = None,
        remainders: Remainders | None = None,
    ):
        self._config = config
        self._carver = carver or Carver(config)
        self._remainders = remainders or Remainders(config)
        self._sides: dict[tuple[int, int], tuple[View, Sides]] = {}

    def factors(self, views: list[View], known: Solution) -> list[Factor]:
        """Return the plane factors and side factors between views.

        Parameters
        ----------
        views
            V views in stamp order.
        known
            Solution of the graph without these factors, with the same views.
        """
        left = self._carver.carve(views, known.T_map_views)
        patches = self._remainders.surviving_patches(views, left)
        cov_z_roll_pitch = known.cov_views[:, Z_ROLL_PITCH][:, :, Z_ROLL_PITCH]
        planes = plane_factors(patches, known.T_map_views, cov_z_roll_pitch, self._config)
        self._sides = {view.key: (view, self._sides_of(view)) for view in views}
        sides = [self._sides[view.key][1] for view in views]
        return [*planes, *side_factors(views, left, known, self._config, sides)]

    def _sides_of(self, view: View) -> Sides:
        known = self._sides.get(view.key)
        return known[1] if known is not None and known[0] is view else find_sides(view)


def register_views(views: list[View], known: Solution, config: Config) -> list[Factor]:
    """Return the factors between views, remembering nothing.

    Parameters
    ----------
    views, known, config
        As for `Registration`.
    """
    return Registration(config).factors(views, known)


def plane_factors(
    patches: list[NumberedPatch], T_map_view: Float64, cov_z_roll_pitch: Float64, config: Config
) -> list[ViewPlane]:
    """Return a factor for each patch of each surface that more than one view saw.

    Parameters
    ----------
    patches
        What is left of the patches, in the order of their numbers.
    T_map_view, cov_z_roll_pitch
        float64 (V, 4, 4) and (V, 3, 3) of (z, roll, pitch), the views as known so far.
    config
        Uses the group ``surfaces``.
    """
    factors: list[ViewPlane] = []
    plane = 0
    for surface in merge_coplanar(patches, T_map_view, cov_z_roll_pitch, config):
        members = _informative(surface)
        if len({member.view for member in members}) > 1:
            factors += [_plane_factor(member, plane) for member in members]
            plane += 1
    return factors


def _informative(members: Members) -> list[NumberedPatch]:
    return [
        m for m in members if m.patch.count >= MIN_POINTS and _tilt_variance(m) <= MAX_TILT_SIGMA**2
    ]


def _tilt_variance(member: NumberedPatch) -> float:
    cov = fit_covariance(member.patch.cov, member.patch.count)
    return float(np.linalg.eigvalsh(cov[1:, 1:])[1])


def _plane_factor(member: NumberedPatch, plane: int) -> ViewPlane:
    """Return the factor of a patch's plane, measured in its view at the patch's centroid."""
    patch = member.patch
    normal, _ = fit_plane(patch.cov)
    cov_z_slopes = fit_covariance(patch.cov, patch.count)
    order = [1, 2, 0]
    return ViewPlane(member.view, plane, normal, patch.mean, cov_z_slopes[np.ix_(order, order)])


def side_factors(
    views: list[View],
    left: Survivors,
    known: Solution,
    config: Config,
    sides_of_views: list[Sides] | None = None,
) -> list[BetweenViews]:
    """Return a factor for each pair of views whose sides match.

    The covariances of the graph are conservative: those expected are `known.unit_variance` times as
    large. The covariance of a match is the one expected, so it is divided by that, to weigh as the
    other factors do.

    Parameters
    ----------
    views
        V views in stamp order.
    left
        Of `carve`, for these views.
    known
        Solution of the graph without these factors, with the same views.
    config
        Uses `surfaces.max_step`.
    sides_of_views
        Of `find_sides`, for these views; None: they are found now.
    """
    T_map_view, poses = known.T_map_views, planar(known.T_map_views)
    found_sides = sides_of_views or [find_sides(view) for view in views]
    sides = [
        _in_planar_frame(_remaining(found, keep), T)
        for found, keep, T in zip(found_sides, left.keep, T_map_view)
    ]
    cov_poses = known.cov_views[:, PLANAR_ORDER][:, :, PLANAR_ORDER] * known.unit_variance
    matches: list[tuple[int, int, SideMatch]] = []
    for j in range(1, len(views)):
        for i in _nearest_views(poses, j):
            cov = _relative_covariance(cov_poses, poses, i, j)
            step = config.surfaces.max_step
            match = match_sides(sides[i], sides[j], between2(poses[i], poses[j]), cov, step)
            if match is not None:
                matches.append((i, j, match))
    # The matches of a view use the same sides: together they must not count more than once.
    uses = np.bincount([v for i, j, _ in matches for v in (i, j)], minlength=len(views))
    return [
        _between_factor(
            i, j, match, T_map_view, (max(uses[i], uses[j]) + 1) / (2.0 * known.unit_variance)
        )
        for i, j, match in matches
    ]


def _remaining(sides: Sides, keep: list[Bool]) -> Sides:
    """Return the sides of patches that newer views did not see moved or replaced."""
    fraction = np.array([mask.mean() for mask in keep])
    return sides.chosen(fraction[sides.patch] >= MIN_REMAINING)


def _in_planar_frame(sides: Sides, T_map_view: Float64) -> Sides:
    """Transform sides to the horizontal frame at the planar pose of their view, z as in map."""
    T = inverse(spatial(planar(T_map_view))) @ T_map_view
    points = transform(T, np.column_stack([sides.middle, sides.height]))
    return sides.moved(points[:, :2], points[:, 2])


def _nearest_views(poses: Float64, j: int) -> list[int]:
    """Return the older views that are nearest to view `j`, in order."""
    yaw = np.abs(wrap_angle(poses[:j, 2] - poses[j, 2]))
    distance = np.hypot(*(poses[:j, :2] - poses[j, :2]).T) + YAW_WEIGHT * yaw
    return sorted(np.argsort(distance, kind="stable")[:MAX_NEIGHBOUR_VIEWS].tolist())


def _relative_covariance(cov_poses: Float64, poses: Float64, i: int, j: int) -> Float64:
    """Bound the covariance of the pose of view `j` in view `i`, float64 (3, 3) of (x, y, yaw).

    The errors of two views are correlated, but the correlation is not known here. The sum of their
    variances is an upper bound.
    """
    position = sum(float(np.linalg.eigvalsh(cov_poses[v, :2, :2])[1]) for v in (i, j))
    yaw = float(cov_poses[i, 2, 2] + cov_poses[j, 2, 2])
    position += float(cov_poses[i, 2, 2] * np.sum((poses[i, :2] - poses[j, :2]) ** 2))
    sigma = np.clip(np.sqrt([position, yaw]), MIN_SIGMA, MAX_SIGMA)
    return np.diag(np.square([sigma[0], sigma[0], sigma[1]]))


def _between_factor(
    i: int, j: int, match: SideMatch, T_map_view: Float64, scale: float
) -> BetweenViews:
    """Return the factor of a match: x, y and yaw as matched, their covariance times `scale`.

    z, roll and pitch are those of the poses known so far, with `OPEN_SIGMAS`.
    """
    T_level_view = inverse(spatial(planar(T_map_view[j]))) @ T_map_view[j]
    T_map_j = spatial(compose2(planar(T_map_view[i]), match.pose)) @ T_level_view
    cov = planar_covariance(match.cov * scale, OPEN_SIGMAS)
    return BetweenViews(i, j, inverse(T_map_view[i]) @ T_map_j, cov)
