"""Data association of door signs: sightings of several passes that show one plate.

The cost combines geometry, text and appearance: the squared Mahalanobis distance between two
points, with the relative covariance of their keyframes in the graph, plus a cost per differing
character and a cost for different patches.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.signs.texts import edit_distance
from tccm_ros.slam.signs.sightings import Sighting

EDIT_COST = 6.0
"""Cost of a differing character, in units of chi-square (chosen: one digit in twenty is misread, as
one of nine others)."""

PATCH_COST = 10.0
"""Cost of patches without correlation, in units of chi-square (chosen)."""

MAX_COST = 20.0
"""Maximum cost of two sightings of one sign (chosen: 16.3 for 99.9 % of three degrees of freedom,
plus a margin for patches seen from two sides)."""

MAX_DISTANCE = 0.5
"""Maximum distance (m) between two sightings of one sign, whatever their covariance. Chosen: a more
uncertain pose needs a loop closure by geometry first."""

MAX_MISREAD_DISTANCE = 0.2
"""Maximum distance (m) between two sightings of one sign with different texts (chosen: the width of
a plate)."""

SURFACE_SIGMA = 0.02
"""Additional standard deviation (m) of the middle of a number between two passes (chosen)."""

RelativeCovariance = Callable[[int, int, Float64], Float64]
"""Function that returns the covariance (2, 2) in map of a point (3,) between two keyframes."""


def associate_signs(
    sightings: Sequence[Sighting], relative: RelativeCovariance
) -> list[list[Sighting]]:
    """Return the sightings of each sign, in the order of the signs' first sightings.

    Each sighting in turn is assigned to the sign with the lowest cost.

    Parameters
    ----------
    sightings
        Sightings in the order of their triangulation.
    relative
        Function that returns the relative covariance of two keyframes at a point.
    """
    signs: list[list[Sighting]] = []
    for sighting in sightings:
        costs = [min(_cost(sighting, other, relative) for other in sign) for sign in signs]
        if costs and min(costs) < MAX_COST:
            signs[int(np.argmin(costs))].append(sighting)
        else:
            signs.append([sighting])
    return signs


def number_signs(signs: Sequence[Sequence[Sighting]], saved: Sequence[int]) -> list[int]:
    """Return an id for each sign: that of an earlier session, or the next free one.

    Parameters
    ----------
    signs
        The sightings of each sign.
    saved
        For each view, the id assigned in an earlier session, or -1.
    """
    votes = Counter(
        (n, saved[i])
        for n, sign in enumerate(signs)
        for s in sign
        for i in s.views
        if saved[i] >= 0
    )
    ids: dict[int, int] = {}
    for (n, number), _ in sorted(votes.items(), key=lambda vote: (-vote[1], vote[0])):
        if n not in ids and number not in ids.values():
            ids[n] = number
    free = 1 + max(saved, default=-1)
    for n in range(len(signs)):
        if n not in ids:
            ids[n], free = free, free + 1
    return [ids[n] for n in range(len(signs))]


def _cost(one: Sighting, other: Sighting, relative: RelativeCovariance) -> float:
    """Return the association cost of two sightings; inf if they are incompatible."""
    away = one.point.position - other.point.position
    edits = edit_distance(one.number, other.number)
    if np.linalg.norm(away) > (MAX_MISREAD_DISTANCE if edits else MAX_DISTANCE):
        return np.inf
    cov = one.point.covariance + other.point.covariance + SURFACE_SIGMA**2 * np.eye(3)
    middle = 0.5 * (one.point.position + other.point.position)
    cov[:2, :2] += relative(one.keyframe, other.keyframe, middle)
    alike = float(np.clip(one.descriptor @ other.descriptor, 0.0, 1.0))
    chi2 = float(away @ np.linalg.solve(cov, away))
    return chi2 + EDIT_COST * edits + PATCH_COST * (1.0 - alike)
