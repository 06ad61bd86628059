"""Poses of door signs, and loop closure candidates from repeated texts.

A place is a sign with its normal, as a planar pose in a keyframe. Two places with one text predict
the relative pose of two keyframes: a small window in which matching searches for a loop closure as
in any other. A text alone closes no loop.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.se2 import between_se2, compose_se2, inverse_se2, transform_points
from tccm_ros.slam.signs.sightings import PASS_GAP_NS, Sighting, find_sightings
from tccm_ros.slam.signs.views import SignView, rays_of

MIN_CONFIDENCE = 0.6
"""Minimum confidence of a text for a loop closure candidate (chosen: below it, half of the readings
differ, or all are doubtful)."""

FACING_DISTANCE, MIN_FACING_POINTS = 0.6, 6
"""Radius (m) around a sign of level scan points for the direction of its wall, and their minimum
number (chosen)."""

MIN_FACING_AGREEMENT = 0.9
"""Minimum length of the mean of the unit normals of points within `FACING_DISTANCE`. Chosen: 26 deg
of scatter."""

WINDOW_M, WINDOW_RAD = 0.5, 0.2
"""Half width of the search around the keyframe pose predicted by a sign. Chosen: several standard
deviations of a triangulated point and of the normal of a wall."""

FAR_M, FAR_RAD = 0.2, 0.1
"""Minimum distance between predicted and estimated pose for a loop closure candidate; below it, the
sign is only a factor of the solution (chosen: the error of a triangulated point)."""

RECENT_KEYFRAMES = 15
"""Number of keyframes after a sighting that it can place (chosen: 4 m)."""


class PlanarSign(NamedTuple):
    """A sign as a planar pose.

    Attributes
    ----------
    number
        Text of the number.
    keyframe
        Id of the keyframe it is anchored to.
    pose
        float64 (3,), in the keyframe: position and direction of the normal.
    sign
        Id in a saved map; -1 for a sign of this run.
    """

    number: str
    keyframe: int
    pose: Float64
    sign: int


@dataclass(slots=True)
class SignPlaces:
    """The signs observed so far; deterministic for a given order of keyframes.

    Attributes
    ----------
    keyframes
        Keyframes of all sessions; the `KeyframeChain` appends to this list.
    """

    keyframes: list[GraphKeyframe]
    _known: list[PlanarSign] = field(default_factory=list)
    _recent: list[SignView] = field(default_factory=list)
    _seen: list[PlanarSign] = field(default_factory=list)

    def load(self, views: Sequence[SignView], poses: Float64) -> None:
        """Add the signs of a saved map, with its keyframes at `poses`, float64 (K, 3)."""
        self._known += self._places_of(views, poses)

    def add(self, views: Sequence[SignView], poses: Float64) -> None:
        """Add views in stamp order.

        Parameters
        ----------
        views
            Views since the last call.
        poses
            float64 (K, 3), estimates of the keyframes.
        """
        if not views:
            return
        now = views[-1].measurement.stamp_ns
        old = [v for v in self._recent if v.measurement.stamp_ns < now - PASS_GAP_NS]
        if old:
            self._known += self._places_of(self._recent, poses)
            self._recent = []
        self._recent += views
        self._seen = self._places_of(self._recent, poses)

    def predictions(self, k: int, poses: Float64) -> list[tuple[PlanarSign, Float64]]:
        """Return the signs seen before, each with the pose (3,) in map of keyframe `k` by it.

        Parameters
        ----------
        k
            A keyframe of the session that observes them.
        poses
            float64 (K, 3), estimates of the keyframes.
        """
        session = self.keyframes[k].session
        return [
            (old, compose_se2(compose_se2(poses[old.keyframe], old.pose), inverse_se2(own)))
            for new in self._seen
            if self.keyframes[new.keyframe].session == session
            if k - new.keyframe <= RECENT_KEYFRAMES
            for own in [between_se2(poses[k], compose_se2(poses[new.keyframe], new.pose))]
            for old in self._known
            if old.number == new.number
        ]

    def _places_of(self, views: Sequence[SignView], poses: Float64) -> list[PlanarSign]:
        """Return the places of signs with confident readings in views."""
        if not views:
            return []
        sessions = [self.keyframes[v.anchored.keyframe].session for v in views]
        sightings = find_sightings(views, rays_of(views, poses), sessions)
        places = [self._place(s, views, poses) for s in sightings if s.confidence > MIN_CONFIDENCE]
        return [place for place in places if place is not None]

    def _place(
        self, sighting: Sighting, views: Sequence[SignView], poses: Float64
    ) -> PlanarSign | None:
        """Return the place of a sighting; None if the direction of its wall is unknown."""
        position = sighting.point.position[:2]
        near = sorted({views[i].anchored.keyframe for i in sighting.views})
        normals = np.concatenate([self._normals(k, poses[k], position) for k in near])
        if len(normals) < MIN_FACING_POINTS:
            return None
        towards = np.where(normals @ (sighting.origin[:2] - position) < 0.0, -1.0, 1.0)
        x, y = (normals * towards[:, None]).mean(axis=0)
        if np.hypot(x, y) < MIN_FACING_AGREEMENT:
            return None
        pose = np.array([*position, np.arctan2(y, x)])
        k = sighting.keyframe
        sign = Counter(views[i].sign for i in sighting.views).most_common(1)[0][0]
        return PlanarSign(sighting.number, k, between_se2(poses[k], pose), sign)

    def _normals(self, k: int, pose: Float64, position: Float64) -> Float64:
        """Return the normals (N, 2) in map of keyframe k's scan points near a point (2,) in map."""
        scan = self.keyframes[k].scan
        away = transform_points(pose, scan.points) - position
        near = np.hypot(away[:, 0], away[:, 1]) < FACING_DISTANCE
        known = near & (np.abs(scan.normals).sum(axis=1) > 0.0)
        rotation = np.array([0.0, 0.0, pose[2]])
        return transform_points(rotation, np.ascontiguousarray(scan.normals[known]))


def is_far(pose: Float64, known: Float64) -> bool:
    """Return whether a pose (3,) predicted by a sign differs from the estimate by enough."""
    away = between_se2(pose, known)
    return bool(np.hypot(away[0], away[1]) > FAR_M or abs(away[2]) > FAR_RAD)
