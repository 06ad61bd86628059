"""Data association of door signs: sightings of several passes that are one plate.

Text, patch and geometry count together: the squared Mahalanobis distance between two points, with
the covariance that the graph gives to one keyframe against the other, and a cost for each character
that differs and for patches that look different.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.signs.texts import edit_distance
from tccm_ros.slam.signs.sightings import Sighting

EDIT_COST = 6.0
"""Cost of a character that differs, in units of chi-square (chosen: a digit in twenty is misread,
and then as one of nine others)."""

PATCH_COST = 10.0
"""Cost of patches without correlation, in units of chi-square (chosen)."""

MAX_COST = 20.0
"""Two sightings that cost more are two signs (chosen: 99.9 % of three degrees of freedom are 16.3,
and as much again for patches seen from two sides)."""

MAX_DISTANCE = 0.5
"""Two points further from each other (m) are two signs, however uncertain they are. Chosen: who is
more uncertain closes a loop first, which geometry confirms."""

MAX_MISREAD_DISTANCE = 0.2
"""The same for sightings with two texts (chosen: a plate is as wide)."""

SURFACE_SIGMA = 0.02
"""Standard deviation (m) of the middle of a number between two passes, in addition (chosen)."""

RelativeCovariance = Callable[[int, int, Float64], Float64]
"""Covariance (2, 2) in map of a point (3,) that two keyframes put there, one against the other."""


def associate_signs(
    sightings: Sequence[Sighting], relative: RelativeCovariance
) -> list[list[Sighting]]:
    """Return the sightings of each sign, the signs in the order in which they were seen.

    Each sighting goes to the sign that costs least, in their order.

    Parameters
    ----------
    sightings
        In the order in which they were triangulated.
    relative
        How uncertain two keyframes are against each other.
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
    """Return an id for each sign: that of an earlier session, or the next that is free.

    Parameters
    ----------
    signs
        The sightings of each.
    saved
        For each view, the id of the sign that an earlier session found it to be, or -1.
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
    """Return the cost of two sightings being of one sign; inf where they cannot be."""
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
