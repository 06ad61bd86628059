"""Sightings of door signs: the views of one plate in one pass, and the triangulated point.

While a robot passes a plate, its relative poses are known to millimetres, so rays and texts suffice
to assign views to a plate. Sightings of different passes are then compared
(`association`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.signs.hog import hog_features
from tccm_ros.signs.texts import edit_distance, vote
from tccm_ros.slam.signs.triangulation import (
    MIN_PARALLAX,
    RAY_CHI2,
    Point,
    Rays,
    consensus,
    parallax,
    triangulate,
)
from tccm_ros.slam.signs.views import SignView

PASS_GAP_NS = 20_000_000_000
"""Time between views of one text from which they belong to two passes (chosen)."""

MIN_VIEWS = 2
"""Minimum number of views of a plate in a pass, with one text (chosen: at 1 m/s and two pictures a
second, a plate beside a corridor is in two or three)."""

MAX_EDITS = 0.5
"""Maximum fraction of misread characters of a text in a view (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A plate in one pass.

    Attributes
    ----------
    views
        Indices of its views, in stamp order.
    keyframe
        Keyframe of the middle view.
    point
        Triangulated point in map.
    number
        The number, by majority of the views.
    confidence
        Confidence in the number, 0 to 1.
    descriptor
        float64 (n,), unit vector, mean HOG features of the patches.
    origin
        float64 (3,), mean position of the camera in map.
    """

    views: tuple[int, ...]
    keyframe: int
    point: Point
    number: str
    confidence: float
    descriptor: Float64
    origin: Float64


def find_sightings(
    views: Sequence[SignView], rays: Rays, sessions: Sequence[int]
) -> list[Sighting]:
    """Return the sightings of all passes, in the order of their triangulation.

    Views of one text whose rays meet in one point with enough parallax are a sighting; a text at
    two places in one pass gives two. A view with another text belongs to the sighting that its ray
    meets if at most half of the characters differ: it is misread.

    Parameters
    ----------
    views
        Views in the order of the pictures.
    rays
        Their rays, in map.
    sessions
        Session number of each view.
    """
    stamps = np.array([v.measurement.stamp_ns for v in views], np.int64)
    groups: list[list[int]] = []
    for group in _passes(views, stamps, sessions):
        rest = np.array(group, np.int64)
        while len(rest) >= MIN_VIEWS:
            found = consensus(rays.of(rest), MIN_VIEWS)
            if found is None:
                break
            members = _one_per_picture(rest[found[0]], rays.chi2(found[1].position), stamps)
            if len(members) >= MIN_VIEWS:
                groups.append(members)
            rest = np.delete(rest, found[0])
    _add_misread(groups, views, rays, stamps, sessions)
    made = [_sighting(sorted(members), views, rays) for members in groups]
    return sorted(made, key=lambda s: _known_since(s, rays))


def _known_since(sighting: Sighting, rays: Rays) -> int:
    """Return the first view up to which the views determine the point of a sighting."""
    views = sighting.views
    distinct = (
        n
        for n in range(MIN_VIEWS, len(views))
        if parallax(rays.directions[list(views[:n])]) >= MIN_PARALLAX
    )
    return views[next(distinct, len(views)) - 1]


def _passes(views: Sequence[SignView], stamps: Int64, sessions: Sequence[int]) -> list[list[int]]:
    """Return groups of views of one text without a long time gap."""
    by_text: dict[tuple[int, str], list[int]] = {}
    for i, view in enumerate(views):
        by_text.setdefault((sessions[i], view.measurement.number), []).append(i)
    groups = []
    for members in by_text.values():
        cuts = np.flatnonzero(np.diff(stamps[members]) > PASS_GAP_NS) + 1
        groups += [part.tolist() for part in np.split(np.array(members), cuts)]
    return groups


def _one_per_picture(members: Int64, chi2: Float64, stamps: Int64) -> list[int]:
    """Return the nearest view of each picture: a plate is in a picture once."""
    best: dict[int, int] = {}
    for i in members.tolist():
        other = best.setdefault(int(stamps[i]), i)
        if chi2[i] < chi2[other]:
            best[int(stamps[i])] = i
    return list(best.values())


def _add_misread(
    groups: list[list[int]],
    views: Sequence[SignView],
    rays: Rays,
    stamps: Int64,
    sessions: Sequence[int],
) -> None:
    """Add views with another text to the groups whose point they see."""
    if not groups:
        return
    taken = {i for members in groups for i in members}
    points = [triangulate(rays.of(members)).position for members in groups]
    chi2 = np.stack([rays.chi2(point) for point in points])
    for i in range(len(views)):
        if i in taken:
            continue
        text = views[i].measurement.number
        for g in np.argsort(chi2[:, i], kind="stable").tolist():
            members = groups[g]
            gaps = np.abs(stamps[members] - stamps[i])
            is_same_pass = sessions[members[0]] == sessions[i] and gaps.min() <= PASS_GAP_NS
            is_seen = chi2[g, i] < RAY_CHI2 and is_same_pass and gaps.min() > 0
            if is_seen and is_misread(text, views[members[0]].measurement.number):
                members.append(i)
                break


def is_misread(text: str, right: str) -> bool:
    """Return whether a text may be a misreading of another."""
    return edit_distance(text, right) <= MAX_EDITS * len(right)


def _sighting(members: list[int], views: Sequence[SignView], rays: Rays) -> Sighting:
    seen = [views[i].measurement for i in members]
    number, confidence = vote([(m.number, m.confidence) for m in seen])
    middle = members[len(members) // 2]
    return Sighting(
        tuple(members),
        views[middle].anchored.keyframe,
        triangulate(rays.of(members)),
        number,
        confidence,
        mean_descriptor([views[i] for i in members]),
        rays.origins[members].mean(axis=0),
    )


def mean_descriptor(views: Sequence[SignView]) -> Float64:
    """Return the mean HOG features of the patches of views, a unit vector float64 (n,)."""
    patches = np.array([v.measurement.patch for v in views])
    mean = hog_features(patches).mean(axis=0, dtype=np.float64)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-12))
