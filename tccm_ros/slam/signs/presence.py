"""Test whether a door sign still exists, by the pictures that should show it.

A picture in which a sign was not read is a miss if the sign is inside the picture, large enough,
not at a grazing angle and not occluded by a wall of the map. The probability of a reading in such a
picture is estimated from the other signs. The hypothesis of an existing sign is compared with two
others: the sign was taken away after its last reading, or it is text that is occasionally misread
as a number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.slam.signs.sightings import PASS_GAP_NS
from tccm_ros.slam.signs.views import PictureView, SignView
from tccm_ros.slam.signs.walls import is_hidden
from tccm_ros.slam.walls.association import WallTable

MIN_HEIGHT = 10.0
"""Minimum height (pixels) of a number in a picture for a miss. Chosen: the smallest box that
saliency proposes."""

MIN_COSINE = 0.5
"""Minimum cosine of the angle between ray and normal of a sign for a miss. Chosen: 60 deg, the
training range of the classifier."""

BORDER = 0.05
"""Border of a picture, as a fraction, in which a sign may be cut off (chosen)."""

SAME_RAY = 0.05
"""Maximum angle (rad) between a sign and any reading that makes the picture no miss (chosen: a
plate's width at 5 m)."""

MIN_MOTION = 0.1
"""Minimum distance (m) between the cameras of independent misses (chosen: an occlusion or a
reflection persists over smaller motion)."""

HEIGHTS = (14.0, 20.0, 28.0, 40.0)
"""Bounds (pixels) of the height classes with a common reading probability (chosen: half octaves).
The height is multiplied by the cosine: at an angle, digits are narrow."""

PRIOR_LOOKS, PRIOR_PROBABILITY = 4.0, 0.5
"""Prior of a class: number of looks, and fraction of them with a reading (chosen)."""

FALSE_PROBABILITY = 0.1
"""Probability that other text is misread as a number in a picture (chosen)."""

HIDDEN_PASS = 0.02
"""Probability that a sign is occluded during a whole pass, by people or an open door (chosen)."""

MAX_PRESENCE_RATIO = 0.05
"""Maximum likelihood of the misses since the last reading, if the sign were still there, for a sign
that was taken away (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """The pictures that show a sign, or should, in stamp order.

    Attributes
    ----------
    stamps_ns
        int64 (N,).
    height_class
        int64 (N,), index of the height class.
    is_read
        bool (N,), whether the sign was read.
    is_searched
        bool (N,), whether the picture is a searched one of this run; earlier sessions have readings
        only, without their misses.
    """

    stamps_ns: Int64
    height_class: Int64
    is_read: Bool
    is_searched: Bool

    @property
    def of_passes_that_read(self) -> Bool:
        """Mask (N,) of looks in passes with a reading, which prove that the sign was there.

        The first reading itself is excluded, as it selects the pass.
        """
        chosen = np.zeros(len(self.is_read), bool)
        for part in np.split(np.arange(len(self.is_read)), _passes(self.stamps_ns)):
            if self.is_read[part].any():
                chosen[part] = self.is_searched[part]
                chosen[part[np.argmax(self.is_read[part])]] = False
        return chosen


@dataclass(frozen=True, slots=True, eq=False)
class SeenPictures:
    """All searched pictures, with camera poses and readings.

    Attributes
    ----------
    views
        Pictures in stamp order.
    T_map_camera
        float64 (N, 4, 4).
    read
        float64 (N, M, 3), bearings of all readings in each picture, in the optical frame, padded
        with NaN.
    """

    views: Sequence[PictureView]
    T_map_camera: Float64
    read: Float64

    def __len__(self) -> int:
        return len(self.views)


def seen_pictures(
    views: Sequence[PictureView], T_map_camera: Float64, signs: Sequence[SignView]
) -> SeenPictures:
    """Return searched pictures with all readings in them.

    Parameters
    ----------
    views
        Searched pictures.
    T_map_camera
        float64 (N, 4, 4), camera poses.
    signs
        All readings, of signs and others.
    """
    bearings: dict[tuple[int, bytes], list[Float64]] = {}
    for sign in signs:
        m = sign.measurement
        bearings.setdefault(m.picture_key, []).append(m.bearing)
    max_read = max(map(len, bearings.values()), default=0)
    read = np.full((len(views), max_read, 3), np.nan)
    for row, view in zip(read, views):
        own = bearings.get(view.picture.key, [])
        row[: len(own)] = np.reshape(own, (-1, 3))
    return SeenPictures(views, T_map_camera, read)


@dataclass(frozen=True, slots=True, eq=False)
class SeenSign:
    """Pose, size and readings of a sign, before the optimisation of the graph.

    Attributes
    ----------
    position
        float64 (3,), in map, from triangulation.
    normal
        float64 (3,), unit vector from the wall towards the reader.
    views
        Its readings, which agree with each other, in order.
    origins
        float64 (N, 3), positions of the readings' cameras in map.
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


def looks_at(place: SeenSign, pictures: SeenPictures, walls: WallTable) -> Looks:
    """Return the pictures that show a sign, or should.

    Parameters
    ----------
    place
        The sign.
    pictures
        All searched pictures of the sessions of this run.
    walls
        Walls of the map.
    """
    searched = {view.picture.key for view in pictures.views}
    read, misses = [v.measurement for v in place.views], _misses(place, pictures, walls)
    missed = [pictures.views[k].picture for k in misses]
    stamps = np.array([x.stamp_ns for x in (*read, *missed)], np.int64)
    focal = np.array([*(m.focal_length for m in read), *(x.focal_lengths[0] for x in missed)])
    away = np.concatenate([place.origins, pictures.T_map_camera[misses, :3, 3]]) - place.position
    heights = place.height * focal * (away @ place.normal) / (away**2).sum(axis=1)
    is_searched = np.array([x.picture_key in searched for x in read] + [True] * len(missed))
    order = np.argsort(stamps, kind="stable")
    is_read = order < len(read)
    return Looks(
        stamps[order], np.searchsorted(HEIGHTS, heights)[order], is_read, is_searched[order]
    )


def _misses(place: SeenSign, pictures: SeenPictures, walls: WallTable) -> Int64:
    """Return the indices of pictures that should show a sign but have no reading there."""
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
    rows = np.flatnonzero(shown)
    rows = rows[~is_hidden(place.position, T[rows, :3, 3], walls)]
    kept: list[int] = []
    for k in rows.tolist():
        if not kept or np.linalg.norm(T[k, :3, 3] - T[kept[-1], :3, 3]) > MIN_MOTION:
            kept.append(k)
    return np.array(kept, np.int64)


def reading_probabilities(looks: Sequence[Looks], own: int) -> Float64:
    """Return the reading probability of each height class, estimated from the other signs.

    Parameters
    ----------
    looks
        Looks of all signs.
    own
        Index of the tested sign, which is excluded.
    """
    classes = len(HEIGHTS) + 1
    read = np.full(classes, PRIOR_LOOKS * PRIOR_PROBABILITY)
    number = np.full(classes, PRIOR_LOOKS)
    for k, seen in enumerate(looks):
        if k != own:
            mask = seen.of_passes_that_read
            number += np.bincount(seen.height_class[mask], minlength=classes)
            read += np.bincount(seen.height_class[mask & seen.is_read], minlength=classes)
    return np.asarray(read / number)


def is_taken_away(looks: Looks, probability: Float64) -> bool:
    """Return whether the misses since its last reading show that a sign is gone.

    Misses of the pass with the last reading are excluded: signs are not taken away while a robot
    drives by, and the end of a pass often has no reading.

    Parameters
    ----------
    looks
        Looks at the sign.
    probability
        float64 (C,), reading probability of each height class.
    """
    last = int(np.flatnonzero(looks.is_read)[-1])
    missed = np.log1p(-probability[looks.height_class])
    begins = [k for k in _passes(looks.stamps_ns).tolist() if k > last]
    later = slice(begins[0] if begins else len(missed), None)
    return sum(_by_pass(missed[later], looks.stamps_ns[later])) < np.log(MAX_PRESENCE_RATIO)


def is_read_by_chance(looks: Looks, probability: Float64) -> bool:
    """Return whether a sign is read so rarely that it is probably no sign.

    Parameters
    ----------
    looks
        Looks at the sign.
    probability
        float64 (C,), reading probability of each height class.
    """
    p = probability[looks.height_class]
    for_sign = np.log(np.where(looks.is_read, p, 1.0 - p))
    by_chance = np.log(np.where(looks.is_read, FALSE_PROBABILITY, 1.0 - FALSE_PROBABILITY))
    return sum(_by_pass(for_sign - by_chance, looks.stamps_ns)) < 0.0


def _by_pass(log_ratios: Float64, stamps_ns: Int64) -> list[float]:
    """Return the sums per pass, bounded below, as a sign may be occluded for a whole pass."""
    sums = [float(part.sum()) for part in np.split(log_ratios, _passes(stamps_ns))]
    return [max(total, float(np.log(HIDDEN_PASS))) for total in sums]


def _passes(stamps_ns: Int64) -> Int64:
    """Return the indices at which passes begin, without the first."""
    return np.asarray(np.flatnonzero(np.diff(stamps_ns) > PASS_GAP_NS) + 1)
