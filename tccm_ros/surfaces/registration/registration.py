"""Registration of views by the surfaces that they have in common.

The planes of surfaces determine z, roll and pitch (`plane_adjustment`), outside of the graph. Their
sides constrain x, y and yaw, as factors of the graph. A match of sides is a robust factor between
two views; its covariance is large in directions that the common sides do not determine. There is no
factor if two views have too few sides in common, or if the match is ambiguous.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import chdtri

from tccm_ros.arrays import Bool, Float64
from tccm_ros.config import Config
from tccm_ros.geometry import (
    between2,
    compose2,
    inverse,
    planar,
    pose_from_roll_pitch,
    spatial,
    transform,
    wrap_angle,
)
from tccm_ros.robust import MAJORITY
from tccm_ros.slam.factors.keys import view_key
from tccm_ros.slam.factors.noise import LOOSE_SIGMA, PLANAR_ORDER, Z_ROLL_PITCH, planar_covariance
from tccm_ros.slam.factors.views import BetweenViews
from tccm_ros.slam.solution import Solution
from tccm_ros.slam.systematic import adjoint
from tccm_ros.surfaces.merging.carving import Carver, Survivors
from tccm_ros.surfaces.merging.merging import NumberedPatch, Remainders, merge_coplanar
from tccm_ros.surfaces.merging.patch_planes import pose_jacobian, stack_planes
from tccm_ros.surfaces.merging.recent_cache import RecentCache
from tccm_ros.surfaces.registration.plane_adjustment import (
    SIGNIFICANCE,
    PlaneAdjustment,
    adjust_planes,
)
from tccm_ros.surfaces.registration.side_matching import SideMatch, match_sides
from tccm_ros.surfaces.registration.sides import Sides, find_sides
from tccm_ros.surfaces.views.views import View

MAX_NEIGHBOUR_VIEWS = 6
"""Max number of older views, the nearest, with which a view is matched; chosen."""

MAX_SIGMA = (0.15, np.radians(3.0))
"""Upper limits of the standard deviations (m, rad) of the relative pose of two views that the
search covers; chosen: with a wider search, sides of other surfaces match."""

VARIANCE_FACTORS = np.logspace(-4.0, 0.5, 37)
"""Candidate factors on the covariances of the prior poses. Chosen: eight per decade, from nearly
zero to three."""


class Registration:
    """Finds the factors between views, with a cache of the pose-independent sides.

    Parameters
    ----------
    config
        Uses the groups ``views`` and ``surfaces``.
    carver, remainders
        Those of a map of the same views, to use its caches; by default new ones.
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
        self._patches: list[NumberedPatch] = []
        self._sides = RecentCache[Sides]()

    def side_factors(self, views: list[View], prior: Solution) -> list[BetweenViews]:
        """Return the factors between views from the sides of surfaces.

        Parameters
        ----------
        views
            V views in stamp order.
        prior
            Solution of the graph without these factors, with the same views.
        """
        survivors = self._carver.carve(views, prior.T_map_views)
        self._patches = self._remainders.surviving_patches(views, survivors)
        self._sides.begin_round()
        margin = self._config.views.clear_margin
        sides = [self._sides.get((v, margin), partial(find_sides, v, margin)) for v in views]
        return side_factors(views, survivors, prior, self._config, sides)

    def with_adjusted_planes(self, solution: Solution) -> Solution:
        """Return a solution with z, roll and pitch of its views adjusted to common planes.

        Parameters
        ----------
        solution
            Solution of the graph, with the views of the last `side_factors`.
        """
        cov = solution.cov_views[:, Z_ROLL_PITCH][:, :, Z_ROLL_PITCH]
        T = solution.T_map_views
        found = plane_adjustment(self._patches, T, cov, self._config)
        if found is None:
            return solution
        cov_views = solution.cov_views.copy()
        rows, columns = np.ix_(Z_ROLL_PITCH, Z_ROLL_PITCH)
        cov_views[:, rows, columns] = found.cov
        return replace(solution, T_map_views=corrected(T, found.correction), cov_views=cov_views)


def plane_adjustment(
    patches: list[NumberedPatch], T_map_view: Float64, cov_z_roll_pitch: Float64, config: Config
) -> PlaneAdjustment | None:
    """Adjust z, roll and pitch of views by common surfaces; None: there are no common surfaces.

    Parameters
    ----------
    patches
        Remainders of the patches, in the order of their numbers.
    T_map_view, cov_z_roll_pitch
        float64 (V, 4, 4), prior poses, and (V, 3, 3), covariances of (z, roll, pitch).
    config
        Uses the group ``surfaces``.
    """
    chosen: list[NumberedPatch] = []
    surface: list[int] = []
    for members in merge_coplanar(patches, T_map_view, cov_z_roll_pitch, config):
        if len({member.view for member in members}) > 1:
            surface += [surface[-1] + 1 if surface else 0] * len(members)
            chosen += members
    if not chosen:
        return None
    view = np.array([member.view for member in chosen])
    planes = stack_planes([m.patch for m in chosen], view, T_map_view, cov_z_roll_pitch)
    J = np.stack([pose_jacobian(T_map_view[v], c) for v, c in zip(view, planes.centroid)])
    return adjust_planes(planes, J, np.array(surface), cov_z_roll_pitch)


def corrected(T_map_view: Float64, correction: Float64) -> Float64:
    """Return poses (V, 4, 4) with corrections (V, 3) of z, roll and pitch (m, rad) applied."""
    result = T_map_view.copy()
    for T, (z, roll, pitch) in zip(result, correction):
        T_plan = spatial(planar(T))
        R = T_plan[:3, :3]
        T[:3, :3] = R @ pose_from_roll_pitch((roll, pitch))[:3, :3] @ R.T @ T[:3, :3]
        T[2, 3] += z
    return result


def side_factors(
    views: list[View],
    survivors: Survivors,
    prior: Solution,
    config: Config,
    sides_of_views: list[Sides] | None = None,
) -> list[BetweenViews]:
    """Return a factor for each pair of views whose sides match.

    The covariances of the graph are conservative: the expected ones are `prior.unit_variance` times
    as large. The covariance of a match is the expected one. It is divided by that factor, so that
    the match has the same weight as other factors.

    Parameters
    ----------
    views
        V views in stamp order.
    survivors
        Result of `carve` for these views.
    prior
        Solution of the graph without these factors, with the same views.
    config
        Uses `surfaces.max_step`.
    sides_of_views
        Results of `find_sides` for these views; None: they are computed.
    """
    T_map_view, poses = prior.T_map_views, planar(prior.T_map_views)
    found_sides = sides_of_views or [find_sides(v, config.views.clear_margin) for v in views]
    sides = [
        _in_planar_frame(_remaining(found, keep), T)
        for found, keep, T in zip(found_sides, survivors.keep, T_map_view)
    ]
    cov_poses = prior.cov_views[:, PLANAR_ORDER][:, :, PLANAR_ORDER] * prior.unit_variance
    matches: list[tuple[int, int, SideMatch]] = []
    moved, cov_moved = [], []
    for j in range(1, len(views)):
        for i in _nearest_views(poses, j):
            start = between2(poses[i], poses[j])
            cov = _relative_covariance(cov_poses, poses, i, j, prior.is_chain)
            match = match_sides(sides[i], sides[j], start, cov, config.surfaces.max_step)
            if match is not None:
                matches.append((i, j, match))
                moved.append(between2(start, match.pose))
                cov_moved.append(cov)
    # The matches of a view use the same sides: all together count as at most two of them.
    uses = np.bincount([v for i, j, _ in matches for v in (i, j)], minlength=len(views))
    covs = np.array([match.cov for _, _, match in matches]).reshape(-1, 3, 3)
    observed = variance_factor(
        np.array(moved).reshape(-1, 3), covs, np.array(cov_moved).reshape(-1, 3, 3)
    )
    weight = prior.unit_variance * observed
    return [
        BetweenViews(
            view_key(views[i].stamp_ns),
            view_key(views[j].stamp_ns),
            _matched_pose(match, T_map_view[i], T_map_view[j]),
            planar_covariance(
                match.cov * (0.5 * (max(uses[i], uses[j]) + 1) / weight), (LOOSE_SIGMA,) * 3
            ),
        )
        for i, j, match in matches
    ]


def variance_factor(moved: Float64, cov_matches: Float64, cov_starts: Float64) -> float:
    """Return the maximum-likelihood factor on the covariances of the prior poses.

    The differences between matches and prior poses have the covariance of both errors. If the
    errors of matches alone explain them, the factor is small, and good poses stay as they are. It
    is 1 unless the matches contradict that: twice the log of a likelihood ratio has a chi-square
    distribution with one degree of freedom (Wilks 1938).

    Parameters
    ----------
    moved
        float64 (M, 3), the differences (x, y, yaw), m and rad.
    cov_matches, cov_starts
        float64 (M, 3, 3), covariances of the matches and of the prior relative poses.
    """
    costs = []
    for factor in VARIANCE_FACTORS:
        cov = cov_matches + factor * cov_starts
        square = np.einsum("mi,mi->m", moved, np.linalg.solve(cov, moved[:, :, None])[:, :, 0])
        costs.append(float(np.sum(square + np.linalg.slogdet(cov)[1])))
    as_given = costs[int(np.argmin(np.abs(VARIANCE_FACTORS - 1.0)))]
    best = int(np.argmin(costs))
    is_better = as_given - costs[best] > chdtri(1, SIGNIFICANCE)
    return float(VARIANCE_FACTORS[best]) if is_better else 1.0


def _remaining(sides: Sides, keep: list[Bool]) -> Sides:
    """Return the sides of patches that were not moved or replaced in newer views."""
    fraction = np.array([mask.mean() for mask in keep])
    return sides.chosen(fraction[sides.patch] >= MAJORITY)


def _in_planar_frame(sides: Sides, T_map_view: Float64) -> Sides:
    """Return sides in the horizontal frame at the planar pose of their view, with z as in map."""
    T = inverse(spatial(planar(T_map_view))) @ T_map_view
    points = transform(T, np.column_stack([sides.middle, sides.height]))
    return sides.moved(points[:, :2], points[:, 2])


def _nearest_views(poses: Float64, j: int) -> list[int]:
    """Return the indices of the nearest older views of view `j`, ascending; 1 rad counts as 1 m."""
    yaw = np.abs(wrap_angle(poses[:j, 2] - poses[j, 2]))
    distance = np.hypot(*(poses[:j, :2] - poses[j, :2]).T) + yaw
    return sorted(np.argsort(distance, kind="stable")[:MAX_NEIGHBOUR_VIEWS].tolist())


def _relative_covariance(
    cov_poses: Float64, poses: Float64, i: int, j: int, is_chain: bool
) -> Float64:
    """Return the covariance of the pose of view `j` in an older view `i`, for the search.

    Parameters
    ----------
    cov_poses, poses
        float64 (V, 3, 3), covariances of (x, y, yaw) in each view's frame, and (V, 3), poses.
    i, j
        Two views.
    is_chain
        Whether only the steps between keyframes determine the poses: the error of `j` is then the
        error of `i` plus those of the steps between them. Otherwise the cross-covariance is
        unknown, and the sum of the two covariances is used.

    Returns
    -------
    float64 (3, 3) of (x, y, yaw), diagonal, isotropic in x and y, at most `MAX_SIGMA` squared
    """
    A = adjoint(between2(poses[j], poses[i]))
    cov = cov_poses[j] + (-1.0 if is_chain else 1.0) * A @ cov_poses[i] @ A.T
    variances = float(np.linalg.eigvalsh(cov[:2, :2])[1]), float(cov[2, 2])
    position, yaw = np.clip(variances, 0.0, np.square(MAX_SIGMA))
    return np.diag([position, position, yaw])


def _matched_pose(match: SideMatch, T_map_i: Float64, T_map_view: Float64) -> Float64:
    """Return the pose of view j in view i: x, y and yaw by a match, the rest by prior poses."""
    T_level_view = inverse(spatial(planar(T_map_view))) @ T_map_view
    T_map_j = spatial(compose2(planar(T_map_i), match.pose)) @ T_level_view
    return np.asarray(inverse(T_map_i) @ T_map_j)
