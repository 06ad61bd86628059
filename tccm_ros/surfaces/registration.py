"""Registration of views: what they saw in common corrects their poses.

Planes tie height and lean (`landmarks`); sides of surfaces tie x, y and yaw. A registration is a
robust factor between two views whose covariance leaves open what their common sides leave open,
and there is none where the views share too little or where another place fits nearly as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2, inverse, planar, spatial, transform, wrap_angle
from tccm_ros.slam.factors import BetweenViews, Factor, planar_covariance
from tccm_ros.slam.solution import Solution
from tccm_ros.surfaces.carving import Survivors, carve
from tccm_ros.surfaces.landmarks import plane_factors
from tccm_ros.surfaces.merged_patches import surviving_patches
from tccm_ros.surfaces.side_matching import SideMatch, match_sides
from tccm_ros.surfaces.sides import Sides, find_sides
from tccm_ros.surfaces.views import View

__all__ = ["register_views", "side_factors"]

Float64 = NDArray[np.float64]

TILT_ORDER = [5, 0, 1]
"""z, roll and pitch in GTSAM's order (roll, pitch, yaw, x, y, z)."""

PLANAR_ORDER = [3, 4, 2]
"""x, y and yaw in the same order."""

PARTNERS = 6
"""Each view is registered to so many older ones, the nearest."""

TURN_WEIGHT = 1.0
"""Of two places, a radian of turn counts like this many metres."""

LEAST_SIGMA, MOST_SIGMA = (0.01, np.radians(0.3)), (0.15, np.radians(3.0))
"""The relative pose of two views is searched as if it were known this well (m, rad) at least, and
never more than so badly: further off, sides of other surfaces come into question."""

LEFT = 0.5
"""A patch of which less is left was moved or replaced: its sides tell no place."""


def register_views(views: list[View], known: Solution, config: Config) -> list[Factor]:
    """Return factors that tie views to each other, from the poses that are known so far.

    Parameters
    ----------
    views
        V views in stamp order.
    known
        The graph without these factors, with the same views.
    config
        Uses the groups ``views`` and ``surfaces``.
    """
    left = carve(views, known.T_map_views, config)
    placed = surviving_patches(views, left, config)
    cov_tilt = known.cov_views[:, TILT_ORDER][:, :, TILT_ORDER]
    planes = plane_factors(placed, known.T_map_views, cov_tilt, config)
    return [*planes, *side_factors(views, left, known, config)]


def side_factors(
    views: list[View], left: Survivors, known: Solution, config: Config
) -> list[BetweenViews]:
    """Return a factor for each pair of views whose sides agree; as `register_views`.

    A side's deviation is what it is, while the graph's factors are careful: to have its due weight
    among them a match is made as careful as they are.
    """
    T_map_view, places = known.T_map_views, planar(known.T_map_views)
    sides = [
        _levelled(_remaining(find_sides(view), keep), T)
        for view, keep, T in zip(views, left.keep, T_map_view)
    ]
    cov_places = known.cov_views[:, PLANAR_ORDER][:, :, PLANAR_ORDER] * known.unit_variance
    found: list[tuple[int, int, SideMatch]] = []
    for j in range(1, len(views)):
        for i in _partners(places, j):
            cov = _relative_covariance(cov_places, places, i, j)
            step = config.surfaces.max_step
            match = match_sides(sides[i], sides[j], between2(places[i], places[j]), cov, step)
            if match is not None:
                found.append((i, j, match))
    # A view's sides serve in all of its matches: together they must not count for more than once.
    uses = np.bincount([v for i, j, _ in found for v in (i, j)], minlength=len(views))
    return [
        _factor(i, j, match, T_map_view, (max(uses[i], uses[j]) + 1) / (2.0 * known.unit_variance))
        for i, j, match in found
    ]


def _remaining(sides: Sides, keep: list[NDArray[np.bool_]]) -> Sides:
    """Leave out the sides of patches that newer views saw moved or replaced."""
    share = np.array([mask.mean() for mask in keep])
    return sides.chosen(share[sides.patch] >= LEFT)


def _levelled(sides: Sides, T_map_view: Float64) -> Sides:
    """Express sides in the planar frame of their view: level, and with heights in map."""
    T = inverse(spatial(planar(T_map_view))) @ T_map_view
    points = transform(T, np.column_stack([sides.middle, sides.height]))
    return sides.moved(points[:, :2], points[:, 2])


def _partners(places: Float64, j: int) -> list[int]:
    """Return the older views nearest to view `j`, in order."""
    turn = np.abs(wrap_angle(places[:j, 2] - places[j, 2]))
    apart = np.hypot(*(places[:j, :2] - places[j, :2]).T) + TURN_WEIGHT * turn
    return sorted(np.argsort(apart, kind="stable")[:PARTNERS].tolist())


def _relative_covariance(cov_places: Float64, places: Float64, i: int, j: int) -> Float64:
    """Bound how well the pose of view `j` in view `i` is known, float64 (3, 3) of (x, y, yaw).

    The errors of two views have much in common, which is not known here: their sum is on the
    safe side.
    """
    position = sum(float(np.linalg.eigvalsh(cov_places[v, :2, :2])[1]) for v in (i, j))
    turn = float(cov_places[i, 2, 2] + cov_places[j, 2, 2])
    position += float(cov_places[i, 2, 2] * np.sum((places[i, :2] - places[j, :2]) ** 2))
    sigma = np.clip(np.sqrt([position, turn]), LEAST_SIGMA, MOST_SIGMA)
    return np.diag(np.square([sigma[0], sigma[0], sigma[1]]))


def _factor(i: int, j: int, match: SideMatch, T_map_view: Float64, scale: float) -> BetweenViews:
    """Make a factor: x, y and yaw as matched, their covariance times `scale`.

    Height and lean are as they are; the factor leaves them open.
    """
    T_level_view = inverse(spatial(planar(T_map_view[j]))) @ T_map_view[j]
    T_map_j = spatial(compose2(planar(T_map_view[i]), match.pose)) @ T_level_view
    cov = planar_covariance(match.cov * scale, (1.0, 1.0, 1.0))
    return BetweenViews(i, j, inverse(T_map_view[i]) @ T_map_j, cov)
