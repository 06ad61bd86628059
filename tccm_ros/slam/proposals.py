"""Loop closure proposals: a patch of new keyframes found in an old submap, or not."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.slam.alignment import align
from tccm_ros.slam.correlation import correlate, support
from tccm_ros.slam.se2 import rotate_covariance
from tccm_ros.slam.submaps import Patch, Submap

__all__ = ["Proposal", "Window", "propose"]

Float64 = NDArray[np.float64]

MATCH_FLOOR = (0.01, 0.003)
"""Standard deviation (m, rad) that no match beats: a submap bends a little within itself."""

COARSE_STEP = 0.025
"""Angle (rad) between the turns of a search in all headings, which alignment bridges."""

AMBIGUOUS_FROM = 0.8
"""Windows of this half width (m) or more can hold a second place that looks the same."""

APART = (0.7, 0.35)
"""Poses further apart than this (m, or rad) are different places."""


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
    def angle_step(self) -> float:
        """Angle between the turns of the search; 0: as fine as the grid."""
        return COARSE_STEP if self.turn > 1.0 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A match of keyframe `b` against the submap around keyframe `a`.

    Attributes
    ----------
    a, b
        Keyframes; `a` is the submap's centre.
    delta, cov
        Planar pose (3,) of b in a; covariance (3, 3) of (x, y, yaw) in b's frame.
    inliers, score
        Shares of matched points and of likelihood, 0..1.
    window
        Half width of the search, m.
    reason
        Why it is no loop closure; empty where nothing speaks against it yet.
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


def propose(submap: Submap, patch: Patch, window: Window, config: Config) -> Proposal | None:
    """Look for a patch in a submap.

    Returns
    -------
    Proposal or None
        None where nothing resembles the patch; a proposal with a reason where something does
        but is not good enough or not alone.
    """
    loops, sigma = config.loops, config.matching.range_sigma
    span = (window.reach, window.turn)
    found = correlate(
        submap.grid,
        patch.search_points,
        window.centre,
        span,
        angle_step=window.angle_step,
        least=max(loops.min_score, window.least),
    )
    if found.score < 0.0:
        return None
    loose = np.array([window.reach, window.reach, window.turn]) * 0.5 + 0.05
    prior = np.diag(1.0 / loose**2)
    result = align(
        submap.lines, patch.points, patch.normals, found.pose, sigma, window.centre, prior
    )
    information = result.information / config.matching.correlated_beams + prior
    cov = np.asarray(np.linalg.inv(information), np.float64)
    cov = rotate_covariance(cov, -float(result.pose[2]))
    cov = cov + np.diag([MATCH_FLOOR[0] ** 2, MATCH_FLOOR[0] ** 2, MATCH_FLOOR[1] ** 2])
    reason = ""
    near, free = support(submap.grid, patch.points, result.pose)
    if near < loops.min_inliers:
        reason = f"only {near:.2f} of the points match"
    elif free > loops.max_contradiction:
        reason = f"{free:.2f} of the points lie in free space"
    elif _apart(result.pose, found.pose):
        reason = "alignment leaves the correlative match"
    elif window.reach >= AMBIGUOUS_FROM:
        second = _second_place(submap, patch, window, result.pose, found.score, loops.ambiguity)
        if second > 0.0:
            reason = f"ambiguous: another place matches {second:.2f} as well"
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
        (window.reach, window.turn),
        angle_step=window.angle_step,
        least=share * score,
        exclude=(best, APART[0], APART[1]),
    )
    return other.score / score if other.score > 0.0 else 0.0
