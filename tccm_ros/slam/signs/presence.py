"""Whether a door sign is there: pictures that should show it and do not count against it.

A picture in which a sign was not read is a miss, if the sign's place is in the picture, large
enough, not at a grazing angle and not behind a wall of the map. How probable a reading is in such a
picture is learnt from the other signs. Two hypotheses are compared with "it is there": it was taken
away after it was read last, and it is text that is read as a number now and then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.signs.measurement import picture_key
from tccm_ros.slam.signs.sightings import PASS_GAP_NS
from tccm_ros.slam.signs.views import PictureView, SignView
from tccm_ros.slam.signs.walls import is_hidden
from tccm_ros.slam.walls.association import WallTable

MIN_HEIGHT = 10.0
"""Height (pixels) of a number from which on a picture can tell that it is not there. Chosen: the
smallest box that saliency proposes."""

MIN_COSINE = 0.5
"""Cosine of the angle between the line of sight and the normal of a sign, likewise. Chosen:
60 deg, up to which the classifier was trained."""

BORDER = 0.05
"""Part of a picture at its edges in which a sign may be cut off (chosen)."""

SAME_RAY = 0.05
"""A reading of any text within this angle (rad) of a sign is no miss (chosen: a plate's width at
5 m)."""

MIN_MOTION = 0.1
"""Misses from cameras nearer to each other than this (m) are one (chosen: what is in the way, or
shines, is still there)."""

HEIGHTS = (14.0, 20.0, 28.0, 40.0)
"""Limits (pixels) of the classes of heights within which the probability of a reading is one
(chosen: half octaves). The height counts times the cosine: at an angle, digits are narrow."""

PRIOR_LOOKS, PRIOR_PROBABILITY = 4.0, 0.5
"""Looks that are added to those of a class, and the part of them that read something (chosen)."""

FALSE_PROBABILITY = 0.1
"""Probability that text which is no sign's number is read as one in a picture (chosen)."""

HIDDEN_PASS = 0.02
"""Probability that a sign is hidden during a whole pass, by people or an open door (chosen)."""

MIN_ODDS = 0.05
"""A sign is taken away when it is twenty times as probable that the misses since it was read last
come of that (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """The pictures that show a sign, or should, in the order of their stamps.

    Attributes
    ----------
    stamps_ns
        int64 (N,).
    height_class
        int64 (N,), index of the class of heights.
    is_read
        bool (N,), whether the sign was read.
    is_searched
        bool (N,), whether the picture is known as one that was searched; readings of earlier
        sessions are without the pictures that read nothing.
    """

    stamps_ns: Int64
    height_class: Int64
    is_read: Bool
    is_searched: Bool

    @property
    def of_passes_that_read(self) -> Bool:
        """Bool (N,), those of passes in which the sign was there, as a first reading tells.

        That reading itself tells nothing about how probable one is.
        """
        chosen = np.zeros(len(self.is_read), bool)
        for part in np.split(np.arange(len(self.is_read)), _passes(self.stamps_ns)):
            if self.is_read[part].any():
                chosen[part] = self.is_searched[part]
                chosen[part[np.argmax(self.is_read[part])]] = False
        return chosen


@dataclass(frozen=True, slots=True, eq=False)
class SeenPictures:
    """All pictures that were searched, with the poses of their cameras.

    Attributes
    ----------
    views
        In the order of their stamps.
    T_map_camera
        float64 (N, 4, 4).
    read
        float64 (N, M, 3) bearings of all that was read in each, in the optical frame; NaN beyond.
    """

    views: Sequence[PictureView]
    T_map_camera: Float64
    read: Float64

    def __len__(self) -> int:
        return len(self.views)


def seen_pictures(
    views: Sequence[PictureView], T_map_camera: Float64, signs: Sequence[SignView]
) -> SeenPictures:
    """Return pictures with all that was read in them.

    Parameters
    ----------
    views
        Pictures that were searched.
    T_map_camera
        float64 (N, 4, 4), the poses of their cameras.
    signs
        All that was read, whether it is of a sign or not.
    """
    bearings: dict[tuple[int, bytes], list[Float64]] = {}
    for sign in signs:
        m = sign.measurement
        bearings.setdefault(picture_key(m.stamp_ns, m.T_base_camera), []).append(m.bearing)
    max_read = max(map(len, bearings.values()), default=0)
    read = np.full((len(views), max_read, 3), np.nan)
    for row, view in zip(read, views):
        own = bearings.get(view.picture.key, [])
        row[: len(own)] = np.reshape(own, (-1, 3))
    return SeenPictures(views, T_map_camera, read)


@dataclass(frozen=True, slots=True, eq=False)
class SignPlace:
    """Where a sign is, how large it is, and who read it.

    Attributes
    ----------
    position
        float64 (3,), in map.
    normal
        float64 (3,), unit vector from its wall to who reads it.
    views
        Its readings.
    origins
        float64 (N, 3), of the cameras of the readings in map.
    """

    position: Float64
    normal: Float64
    views: Sequence[SignView]
    origins: Float64

    @property
    def height(self) -> float:
        """Height of the number, m."""
        distances = np.linalg.norm(self.origins - self.position, axis=1)
        pixels = np.array([np.ptp(v.measurement.corners[:, 1]) for v in self.views])
        focal = np.array([v.measurement.focal_length for v in self.views])
        return float(np.median(pixels * distances / focal))


def looks_at(place: SignPlace, pictures: SeenPictures, walls: WallTable) -> Looks:
    """Return the pictures that show a sign, or should.

    Parameters
    ----------
    place
        The sign.
    pictures
        All that were searched in the sessions of this run.
    walls
        Of the map.
    """
    searched = {view.picture.key for view in pictures.views}
    own = [(v.measurement.stamp_ns, v.measurement.T_base_camera) for v in place.views]
    focal = np.array([v.measurement.focal_length for v in place.views])
    readings = Looks(
        np.array([stamp for stamp, _ in own], np.int64),
        _height_class(_seen_height(place, place.origins, focal)),
        np.ones(len(own), bool),
        np.array([picture_key(*k) in searched for k in own]),
    )
    misses = _misses(place, pictures, walls)
    focal = np.array([pictures.views[k].picture.focal_lengths[0] for k in misses])
    origins = pictures.T_map_camera[misses, :3, 3]
    stamps = np.array([pictures.views[k].picture.stamp_ns for k in misses], np.int64)
    stamps = np.concatenate([readings.stamps_ns, stamps])
    order = np.argsort(stamps, kind="stable")
    classes = _height_class(_seen_height(place, origins, focal))
    none, known = np.zeros(len(misses), bool), np.ones(len(misses), bool)
    return Looks(
        stamps[order],
        np.concatenate([readings.height_class, classes])[order],
        np.concatenate([readings.is_read, none])[order],
        np.concatenate([readings.is_searched, known])[order],
    )


def _misses(place: SignPlace, pictures: SeenPictures, walls: WallTable) -> Int64:
    """Return the indices of pictures that should show a sign and in which nothing is read there."""
    if not len(pictures):
        return np.zeros(0, np.int64)
    T = pictures.T_map_camera
    rays = np.einsum("nji,nj->ni", T[:, :3, :3], place.position - T[:, :3, 3])
    focal = np.array([v.picture.focal_lengths for v in pictures.views])
    center = np.array([v.picture.center for v in pictures.views])
    size = np.array([v.picture.size for v in pictures.views], float)
    depth = rays[:, 2]
    pixel = focal * rays[:, :2] / np.where(depth > 0.1, depth, 1.0)[:, None] + center
    inside = (pixel > BORDER * size) & (pixel < (1.0 - BORDER) * size)
    away = T[:, :3, 3] - place.position
    cosine = away @ place.normal / np.linalg.norm(away, axis=1)
    height = place.height * focal[:, 0] / np.linalg.norm(away, axis=1)
    shown = (depth > 0.1) & inside.all(axis=1)
    shown &= (cosine > MIN_COSINE) & (height > MIN_HEIGHT)
    direction = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    along = np.einsum("nmi,ni->nm", pictures.read, direction)
    shown &= ~(along > np.cos(SAME_RAY)).any(axis=1)
    at = np.flatnonzero(shown)
    at = at[~is_hidden(place.position, T[at, :3, 3], walls)]
    kept: list[int] = []
    for k in at.tolist():
        if not kept or np.linalg.norm(T[k, :3, 3] - T[kept[-1], :3, 3]) > MIN_MOTION:
            kept.append(k)
    return np.array(kept, np.int64)


def _seen_height(place: SignPlace, origins: Float64, focal: Float64) -> Float64:
    """Return the heights (pixels) of a number, times the cosine of the angle of sight."""
    away = origins - place.position
    return np.asarray(place.height * focal * (away @ place.normal) / (away**2).sum(axis=1))


def _height_class(heights: Float64) -> Int64:
    return np.searchsorted(HEIGHTS, heights)


def reading_probabilities(looks: Sequence[Looks], own: int) -> Float64:
    """Return how probable a reading is in each class of heights, learnt from the other signs.

    Parameters
    ----------
    looks
        Of all signs.
    own
        Index of the sign that is judged: it does not count.
    """
    classes = len(HEIGHTS) + 1
    read = np.full(classes, PRIOR_LOOKS * PRIOR_PROBABILITY)
    number = np.full(classes, PRIOR_LOOKS)
    for k, seen in enumerate(looks):
        if k != own:
            at = seen.of_passes_that_read
            number += np.bincount(seen.height_class[at], minlength=classes)
            read += np.bincount(seen.height_class[at & seen.is_read], minlength=classes)
    return np.asarray(read / number)


def is_taken_away(looks: Looks, probability: Float64) -> bool:
    """Return whether the misses since a sign was read last tell that it is no longer there.

    Those of the pass that read it last do not count: signs are not taken away while a robot drives
    by, and the end of a pass is often without a reading.

    Parameters
    ----------
    looks
        At the sign.
    probability
        float64 (C,), of a reading in each class of heights.
    """
    last = int(np.flatnonzero(looks.is_read)[-1])
    missed = np.log1p(-probability[looks.height_class])
    begins = [k for k in _passes(looks.stamps_ns).tolist() if k > last]
    later = slice(begins[0] if begins else len(missed), None)
    return sum(_by_pass(missed[later], looks.stamps_ns[later])) < np.log(MIN_ODDS)


def is_read_by_chance(looks: Looks, probability: Float64) -> bool:
    """Return whether a sign is read so seldom that it is probably no sign.

    Parameters
    ----------
    looks
        At the sign.
    probability
        float64 (C,), of a reading in each class of heights.
    """
    p = probability[looks.height_class]
    for_sign = np.log(np.where(looks.is_read, p, 1.0 - p))
    by_chance = np.log(np.where(looks.is_read, FALSE_PROBABILITY, 1.0 - FALSE_PROBABILITY))
    return sum(_by_pass(for_sign - by_chance, looks.stamps_ns)) < 0.0


def _by_pass(log_ratios: Float64, stamps_ns: Int64) -> list[float]:
    """Return the sums over each pass, limited from below: a sign may be hidden for a whole one."""
    sums = [float(part.sum()) for part in np.split(log_ratios, _passes(stamps_ns))]
    return [max(total, float(np.log(HIDDEN_PASS))) for total in sums]


def _passes(stamps_ns: Int64) -> Int64:
    """Return the indices at which passes begin, but for the first."""
    return np.asarray(np.flatnonzero(np.diff(stamps_ns) > PASS_GAP_NS) + 1)
