"""Landmarks of registered kinds: their observations hang on keyframes, and their estimates.

An observation is made from a pose of its own that hangs on a keyframe, as a surface view does. A
landmark of a later session is that of an earlier one if kind and id are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tccm_ros.records import Landmark, LandmarkObservation
from tccm_ros.slam.chain import HungPose
from tccm_ros.slam.factors import Factor, Key, landmark_class, observer_key
from tccm_ros.slam.graph import GraphSolution

__all__ = ["LandmarkFactors", "Sighting", "landmark_factors", "landmark_records"]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """An observation, and where it was made."""

    observation: LandmarkObservation
    hung: HungPose

    @property
    def key(self) -> Key:
        """The landmark's variable."""
        return Key(landmark_class(self.observation.kind).letter, self.observation.id)


class LandmarkFactors(NamedTuple):
    """The poses from which landmarks were seen, by variable, and a factor for each sighting."""

    hung: dict[Key, HungPose]
    factors: list[Factor]


def landmark_factors(
    sightings: Sequence[Sighting], *, first: int = 0, unit_variance: float = 1.0
) -> LandmarkFactors:
    """Return what sightings add to a graph; those of one stamp share their pose.

    Parameters
    ----------
    sightings
        In the order in which they enter the graph.
    first
        Number of the first pose.
    unit_variance
        What the covariances of the graph's other factors are to be multiplied by: those of
        landmarks are true, and are divided by it to weigh as much as they should. (Beacons in the
        ring of the tests, 8 seeds: NEES of 0.89 per degree of freedom.)
    """
    made = LandmarkFactors({}, [])
    poses: dict[tuple[int, int], Key] = {}
    for sighting in sightings:
        seen = sighting.observation
        place = sighting.hung.keyframe, seen.stamp_ns
        pose = poses.setdefault(place, observer_key(first + len(poses)))
        made.hung[pose] = sighting.hung
        make = landmark_class(seen.kind)
        made.factors.append(
            make(pose, sighting.key, seen.measurement, seen.covariance / unit_variance)
        )
    return made


def landmark_records(
    sightings: Sequence[Sighting], solution: GraphSolution, scale: float
) -> tuple[Landmark, ...]:
    """Read the landmarks back, in the order of kind and id; `scale` multiplies covariances."""
    groups: dict[tuple[str, int], list[Sighting]] = {}
    for sighting in sightings:
        seen = sighting.observation
        groups.setdefault((seen.kind, seen.id), []).append(sighting)
    records = []
    for (kind, number), group in sorted(groups.items()):
        key = group[0].key
        position, cov = landmark_class(kind).position(
            solution.values, key, solution.covariance(key)
        )
        records.append(Landmark(kind, number, position, cov * scale, len(group)))
    return tuple(records)
