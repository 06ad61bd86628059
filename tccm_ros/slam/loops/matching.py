"""Loop closure proposals: match merged scans of new keyframes with old submaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.config.slam import LoopsConfig
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.factors.poses import BetweenKeyframes
from tccm_ros.slam.loops.submaps import MergedScan, Submap
from tccm_ros.slam.matching.alignment import Alignment, Prior, align
from tccm_ros.slam.matching.correlation import (
    SEARCH_WEIGHT,
    Correlation,
    correlate,
    known_likelihood,
    support,
)
from tccm_ros.slam.matching.level_scan import point_sigma
from tccm_ros.slam.matching.likelihood_grid import LikelihoodGrid, with_unknown
from tccm_ros.slam.se2 import rotate_covariance

MATCH_FLOOR = (0.01, 0.003)
"""Standard deviation (m, rad) added to each match for the distortion of submaps (chosen)."""

COARSE_STEP = 0.025
"""Yaw step (rad) of a search over all headings, small enough for alignment (chosen)."""

AMBIGUOUS_FROM = 0.8
"""Half width (m) from which a search window can contain a second, equally good pose (chosen)."""

UNKNOWN_SIGMA = 20.0
"""Standard deviation (m, rad) in directions that a match does not determine, as along a plain
corridor (chosen)."""

SAME_PLACE_M, SAME_PLACE_RAD = 0.7, 0.35
"""Two poses within this distance and yaw are the same place (chosen)."""

ALL_HEADINGS = 1.0
"""A search window with a larger half width in yaw, rad, has no expected pose. Chosen: 57 deg."""

WINDOW_SIGMA, WINDOW_FLOOR = 0.5, 0.05
"""Standard deviation of the expected pose: a fraction of the window, plus a constant (m, rad;
chosen)."""

MIN_FACING_FRACTION = 0.5
"""Minimum fraction of matched points on the front faces of walls; with fewer, most match the backs
(chosen)."""


class LoopReason(StrEnum):
    """Reason of a proposal's acceptance or rejection; braces are filled with a number."""

    CONSISTENT = "consistent"
    FEW_MATCHES = "only {:.2f} of the points match"
    IN_FREE_SPACE = "{:.2f} of the points lie in free space"
    BACKS_OF_WALLS = "most points lie on the backs of walls"
    ALIGNED_ELSEWHERE = "alignment leaves the correlative match"
    SECOND_PLACE = "ambiguous: another place has {:.2f} of this score"
    BETTER_WHERE_KNOWN = "ambiguous: in known space, another place agrees {:.2f} times as well"
    TWO_PLACES_IN_MAP = "ambiguous: the map has another place like this"
    UNCONFIRMED = "no other match confirms it"
    CONTRADICTED = "contradicts the other loops"


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Window of a search for a merged scan in a submap.

    Attributes
    ----------
    centre
        float64 (3,), expected pose of the merged scan in the submap.
    half_width_m, half_width_rad
        Half widths of the window.
    min_score
        Minimum score of a match, if this is more than ``loops.min_score``.
    """

    centre: Float64
    half_width_m: float
    half_width_rad: float
    min_score: float = 0.0

    @property
    def span(self) -> tuple[float, float]:
        """Half widths, m and rad."""
        return self.half_width_m, self.half_width_rad

    @property
    def anywhere(self) -> bool:
        """Whether the window has no expected pose."""
        return self.half_width_rad > ALL_HEADINGS

    @property
    def angle_step(self) -> float:
        """Yaw step of the search, rad; 0 for one grid cell."""
        return COARSE_STEP if self.anywhere else 0.0

    @property
    def information(self) -> Float64:
        """Information of the expected pose, float64 (3, 3)."""
        sigmas = np.array([self.half_width_m, self.half_width_m, self.half_width_rad])
        sigmas = sigmas * WINDOW_SIGMA + WINDOW_FLOOR
        return np.diag(1.0 / sigmas**2)

    @property
    def penalty(self) -> tuple[float, float]:
        """Score lost per m^2 and rad^2 of distance from the centre."""
        if self.anywhere:
            return 0.0, 0.0
        information = SEARCH_WEIGHT * self.information
        return float(information[0, 0]), float(information[2, 2])


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A match of keyframe `b` against the submap around keyframe `a`.

    Attributes
    ----------
    a, b
        Keyframes; `a` is the submap's centre.
    delta, cov
        Planar pose (3,) of b in a; covariance (3, 3) of (x, y, yaw) in b's frame, of the match
        alone: the graph already contains the information of the expected pose.
    inliers, score
        Fraction of matched points, and mean likelihood, 0..1.
    window
        Half width of the search, m.
    reason
        Reason of a rejection (`LoopReason`); empty otherwise.
    """

    a: int
    b: int
    delta: Float64
    cov: Float64
    inliers: float
    score: float
    window: float
    reason: str = ""

    @property
    def is_ambiguous(self) -> bool:
        """Whether it is rejected because another place fits as well."""
        return self.reason.startswith("ambiguous")

    @property
    def max_position_variance(self) -> float:
        """Variance (m2) of the position in its least certain direction, as along a corridor."""
        a, b, c = float(self.cov[0, 0]), float(self.cov[0, 1]), float(self.cov[1, 1])
        return 0.5 * (a + c) + math.sqrt(0.25 * (a - c) ** 2 + b * b)

    def factor(self, keys: Sequence[Key], weight: float = 1.0) -> BetweenKeyframes:
        """Return the factor between the keyframes of these keys; `weight` is from GNC."""
        return BetweenKeyframes(keys[self.a], keys[self.b], self.delta, self.cov, weight)


def propose(submap: Submap, merged: MergedScan, window: Window, config: Config) -> Proposal | None:
    """Search for a merged scan in a submap.

    Parameters
    ----------
    submap, merged
        The map, and the scans to match with it.
    window
        Search window.
    config
        Groups ``loops`` and ``matching``.

    Returns
    -------
    Proposal or None
        None if no pose has a sufficient score; a proposal with a reason if it is rejected.
    """
    loops, expected = config.loops, Prior(window.centre, window.information)
    min_score = max(loops.min_score, window.min_score)
    found = _search(submap.grid, merged, window, penalty=window.penalty, min_score=min_score)
    if found.score < 0.0:
        return None
    sigma = point_sigma(config)
    result = align(submap.lines, merged.points, merged.normals, found.pose, sigma, expected)
    near, free = support(submap.grid, merged.points, result.pose)
    reason = ""
    if near < loops.min_inliers:
        reason = LoopReason.FEW_MATCHES.format(near)
    elif free > loops.max_contradiction:
        reason = LoopReason.IN_FREE_SPACE.format(free)
    elif result.inliers < MIN_FACING_FRACTION * near:
        reason = LoopReason.BACKS_OF_WALLS
    elif _is_other_place(result.pose, found.pose):
        reason = LoopReason.ALIGNED_ELSEWHERE
    elif window.half_width_m >= AMBIGUOUS_FROM:
        second = _second_place(submap, merged, window, result.pose, found.score, loops.ambiguity)
        better = 0.0 if second else _better_where_known(submap, merged, window, result.pose, loops)
        if second:
            reason = LoopReason.SECOND_PLACE.format(second)
        elif better:
            reason = LoopReason.BETTER_WHERE_KNOWN.format(better)
    cov = _covariance(result, config.matching.correlated_beams)
    ends, half_width = (submap.centre, merged.centre), window.half_width_m
    return Proposal(*ends, result.pose, cov, near, found.score, half_width, reason)


def _search(grid: LikelihoodGrid, merged: MergedScan, window: Window, **limits: Any) -> Correlation:
    """Search for a merged scan in a grid; `limits` are further arguments of `correlate`."""
    points, step = merged.search_points, window.angle_step
    return correlate(grid, points, window.centre, window.span, angle_step=step, **limits)


def _covariance(result: Alignment, correlated_beams: float) -> Float64:
    """Return the covariance (3, 3) of a match in the frame of its merged scan."""
    information = result.information / correlated_beams + np.eye(3) / UNKNOWN_SIGMA**2
    cov = np.asarray(np.linalg.inv(information), np.float64)
    cov = rotate_covariance(cov, -float(result.pose[2]))
    return cov + np.diag([MATCH_FLOOR[0] ** 2, MATCH_FLOOR[0] ** 2, MATCH_FLOOR[1] ** 2])


def _is_other_place(a: Float64, b: Float64) -> bool:
    dyaw = abs(np.arctan2(np.sin(a[2] - b[2]), np.cos(a[2] - b[2])))
    return bool(np.hypot(a[0] - b[0], a[1] - b[1]) > SAME_PLACE_M or dyaw > SAME_PLACE_RAD)


def _second_place(
    submap: Submap, merged: MergedScan, window: Window, best: Float64, score: float, ratio: float
) -> float:
    """Return the score of another place over the best, if it is at least `ratio`; else 0."""
    away = best, SAME_PLACE_M, SAME_PLACE_RAD
    other = _search(submap.grid, merged, window, min_score=ratio * score, exclude=away)
    return other.score / score if other.score > 0.0 else 0.0


def _better_where_known(
    submap: Submap, merged: MergedScan, window: Window, best: Float64, loops: LoopsConfig
) -> float:
    """Return how well another place agrees in known cells, relative to the best, if better; else 0.

    A score grows with the part of the scan that the submap covers, so that the right place, when
    the robot returns from the other side, may score less than a wrong one further inside. Here
    unknown cells have the mean likelihood of known cells at the best place, and the other place
    must pass the gates of a loop closure.
    """
    agreement = known_likelihood(submap.grid, merged.search_points, best)
    grid, away = with_unknown(submap.grid, agreement), (best, SAME_PLACE_M, SAME_PLACE_RAD)
    other = _search(grid, merged, window, penalty=window.penalty, min_score=agreement, exclude=away)
    if other.score < 0.0:
        return 0.0
    near, free = support(submap.grid, merged.points, other.pose)
    if near < loops.min_inliers or free > loops.max_contradiction:
        return 0.0
    return known_likelihood(submap.grid, merged.search_points, other.pose) / agreement
