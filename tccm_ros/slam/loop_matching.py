"""Loop closure proposals: a patch of new keyframes is matched with an old submap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config, Loops
from tccm_ros.slam.alignment import Alignment, Prior, align
from tccm_ros.slam.correlation import correlate, known_likelihood, support
from tccm_ros.slam.factors import BetweenKeyframes, Key
from tccm_ros.slam.likelihood_grid import with_unknown
from tccm_ros.slam.se2 import rotate_covariance
from tccm_ros.slam.submaps import Patch, Submap

__all__ = ["COARSE_STEP", "LoopReason", "Proposal", "Window", "propose"]


MATCH_FLOOR = (0.01, 0.003)
"""Standard deviation (m, rad) that no match beats: a submap bends a little within itself."""

COARSE_STEP = 0.025
"""Angle (rad) between the turns of a search in all headings, which alignment bridges."""

AMBIGUOUS_FROM = 0.8
"""Windows of this half width (m) or more can hold a second place that looks the same."""

SEARCH_WEIGHT = 0.01
"""Score that a search gives away at one standard deviation from where the graph expects the match:
along a corridor, the match that overlaps most would win otherwise."""

UNKNOWN_SIGMA = 20.0
"""Standard deviation (m, rad) where a match says nothing: along a plain corridor."""

APART = (0.7, 0.35)
"""Poses further apart than this (m, or rad) are different places."""


class LoopReason(StrEnum):
    """Why a proposal is a loop closure, or none; braces are filled with a number."""

    CONSISTENT = "consistent"
    FEW_MATCHES = "only {:.2f} of the points match"
    IN_FREE_SPACE = "{:.2f} of the points lie in free space"
    BACKS_OF_WALLS = "most points lie on the backs of walls"
    ALIGNED_ELSEWHERE = "alignment leaves the correlative match"
    SECOND_PLACE = "ambiguous: another place matches {:.2f} as well"
    BETTER_WHERE_KNOWN = "ambiguous: where it is known, another place matches {:.2f} as well"
    TWO_PLACES_IN_MAP = "ambiguous: the map has another place like this"
    UNCONFIRMED = "no other match confirms it"
    CONTRADICTED = "contradicts the other loops"


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Where to look, and for what.

    Attributes
    ----------
    centre
        float64 (3,), expected pose of the patch in the submap.
    reach, turn
        Half widths, m and rad.
    least
        Only a match with a better score counts, if this is more than ``loops.min_score``.
    """

    centre: Float64
    reach: float
    turn: float
    least: float = 0.0

    @property
    def span(self) -> tuple[float, float]:
        """Half widths, m and rad."""
        return self.reach, self.turn

    @property
    def anywhere(self) -> bool:
        """Whether the centre is no expectation."""
        return self.turn > 1.0

    @property
    def angle_step(self) -> float:
        """Angle between the turns of the search; 0: as fine as the grid."""
        return COARSE_STEP if self.anywhere else 0.0

    @property
    def information(self) -> Float64:
        """What the centre is worth, float64 (3, 3): half the window is a standard deviation."""
        sigmas = np.array([self.reach, self.reach, self.turn]) * 0.5 + 0.05
        return np.diag(1.0 / sigmas**2)

    @property
    def penalty(self) -> tuple[float, float]:
        """Score lost per m^2 and rad^2 away from the centre."""
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
        Planar pose (3,) of b in a; covariance (3, 3) of (x, y, yaw) in b's frame: of the match
        alone, without what was expected, so that an expectation is not believed twice.
    inliers, score
        Shares of matched points and of likelihood, 0..1.
    window
        Half width of the search, m.
    reason
        Why it is no loop closure (`LoopReason`); empty where nothing speaks against it yet.
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
    def spread(self) -> float:
        """Variance (m2) in the weakest direction: along a corridor."""
        a, b, c = float(self.cov[0, 0]), float(self.cov[0, 1]), float(self.cov[1, 1])
        return 0.5 * (a + c) + math.sqrt(0.25 * (a - c) ** 2 + b * b)

    def factor(self, keys: Sequence[Key], weight: float = 1.0) -> BetweenKeyframes:
        """Return the factor between the keyframes of these keys; `weight` is GNC's."""
        return BetweenKeyframes(keys[self.a], keys[self.b], self.delta, self.cov, weight)


def propose(submap: Submap, patch: Patch, window: Window, config: Config) -> Proposal | None:
    """Look for a patch in a submap.

    Returns
    -------
    Proposal or None
        None where nothing resembles the patch; a proposal with a reason where something does
        but is not good enough or not alone.
    """
    loops, expected = config.loops, Prior(window.centre, window.information)
    found = correlate(
        submap.grid,
        patch.search_points,
        window.centre,
        window.span,
        angle_step=window.angle_step,
        penalty=window.penalty,
        least=max(loops.min_score, window.least),
    )
    if found.score < 0.0:
        return None
    sigma = config.matching.range_sigma
    result = align(submap.lines, patch.points, patch.normals, found.pose, sigma, expected)
    near, free = support(submap.grid, patch.points, result.pose)
    reason = ""
    if near < loops.min_inliers:
        reason = LoopReason.FEW_MATCHES.format(near)
    elif free > loops.max_contradiction:
        reason = LoopReason.IN_FREE_SPACE.format(free)
    elif result.inliers < 0.5 * near:
        reason = LoopReason.BACKS_OF_WALLS
    elif _apart(result.pose, found.pose):
        reason = LoopReason.ALIGNED_ELSEWHERE
    elif window.reach >= AMBIGUOUS_FROM:
        second = _second_place(submap, patch, window, result.pose, found.score, loops.ambiguity)
        better = 0.0 if second else _better_where_known(submap, patch, window, result.pose, loops)
        if second:
            reason = LoopReason.SECOND_PLACE.format(second)
        elif better:
            reason = LoopReason.BETTER_WHERE_KNOWN.format(better)
    cov = _covariance(result, config.matching.correlated_beams)
    return Proposal(
        submap.centre,
        patch.centre,
        result.pose,
        cov,
        near,
        found.score,
        window.reach,
        reason,
    )


def _covariance(result: Alignment, correlated_beams: float) -> Float64:
    """Return the covariance (3, 3) of a match in the frame of its patch."""
    information = result.information / correlated_beams + np.eye(3) / UNKNOWN_SIGMA**2
    cov = np.asarray(np.linalg.inv(information), np.float64)
    cov = rotate_covariance(cov, -float(result.pose[2]))
    return cov + np.diag([MATCH_FLOOR[0] ** 2, MATCH_FLOOR[0] ** 2, MATCH_FLOOR[1] ** 2])


def _apart(a: Float64, b: Float64) -> bool:
    turn = abs(np.arctan2(np.sin(a[2] - b[2]), np.cos(a[2] - b[2])))
    return bool(np.hypot(a[0] - b[0], a[1] - b[1]) > APART[0] or turn > APART[1])


def _second_place(
    submap: Submap, patch: Patch, window: Window, best: Float64, score: float, share: float
) -> float:
    """Return how well another place does, relative to the best, if at least `share`; else 0."""
    other = correlate(
        submap.grid,
        patch.search_points,
        window.centre,
        window.span,
        angle_step=window.angle_step,
        least=share * score,
        exclude=(best, APART[0], APART[1]),
    )
    return other.score / score if other.score > 0.0 else 0.0


def _better_where_known(
    submap: Submap, patch: Patch, window: Window, best: Float64, loops: Loops
) -> float:
    """Return how well another place agrees where the submap knows it, relative to the best, if
    better; else 0.

    A score is the larger the more of the patch the submap covers, so that the right place, where
    the robot comes back from the other side, may score less than a wrong one further in. Here what
    is not known counts as much as what matches at the best place, and the place that this names
    must match as a loop must.
    """
    agreement = known_likelihood(submap.grid, patch.search_points, best)
    other = correlate(
        with_unknown(submap.grid, agreement),
        patch.search_points,
        window.centre,
        window.span,
        angle_step=window.angle_step,
        penalty=window.penalty,
        least=agreement,
        exclude=(best, APART[0], APART[1]),
    )
    if other.score < 0.0:
        return 0.0
    near, free = support(submap.grid, patch.points, other.pose)
    if near < loops.min_inliers or free > loops.max_contradiction:
        return 0.0
    return known_likelihood(submap.grid, patch.search_points, other.pose) / agreement
