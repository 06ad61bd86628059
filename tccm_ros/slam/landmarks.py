"""Landmarks of registered kinds: observations anchored to keyframes, and estimates.

An observation has a pose of its own, anchored to a keyframe, like a surface view. Landmarks of
different sessions are identical if kind and id are equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tccm_ros.records import Landmark, LandmarkObservation
from tccm_ros.slam.chain import AnchoredPose
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, observer_key
from tccm_ros.slam.factors.landmarks import landmark_class
from tccm_ros.slam.factors.views import Z_ROLL_PITCH_SIGMAS
from tccm_ros.slam.graph.pose_graph import GraphSolution


@dataclass(frozen=True, slots=True, eq=False)
class AnchoredObservation:
    """A landmark observation and its pose.

    Attributes
    ----------
    observation
        The record.
    anchored
        Pose of the base at its stamp, relative to a keyframe.
    """

    observation: LandmarkObservation
    anchored: AnchoredPose

    @property
    def key(self) -> Key:
        """The landmark's variable."""
        return Key(landmark_class(self.observation.kind).letter, self.observation.id)


class LandmarkFactors(NamedTuple):
    """Poses and factors of landmark observations, to be added to a graph.

    Attributes
    ----------
    anchored
        Observer poses, by variable.
    factors
        One factor per observation.
    """

    anchored: dict[Key, AnchoredPose]
    factors: list[Factor]


def landmark_factors(
    observations: Sequence[AnchoredObservation], *, first: int = 0, unit_variance: float = 1.0
) -> LandmarkFactors:
    """Return the poses and factors of observations; observations of equal stamp have one pose.

    Parameters
    ----------
    observations
        Observations in the order in which they enter the graph.
    first
        Number of the first pose.
    unit_variance
        Factor by which the covariances of the graph's other factors are too large. Covariances of
        landmarks, and of the base's roll and pitch, are correct, and are divided by this factor to
        get the right relative weights.
    """
    made = LandmarkFactors({}, [])
    z, roll, pitch = np.array(Z_ROLL_PITCH_SIGMAS) / np.sqrt(unit_variance)
    sigmas = float(z), float(roll), float(pitch)
    poses: dict[tuple[int, int], Key] = {}
    for observation in observations:
        seen = observation.observation
        place = observation.anchored.keyframe, seen.stamp_ns
        pose = poses.setdefault(place, observer_key(first + len(poses)))
        made.anchored[pose] = replace(observation.anchored, sigma_z_roll_pitch=sigmas)
        make = landmark_class(seen.kind)
        made.factors.append(
            make(pose, observation.key, seen.measurement, seen.covariance / unit_variance)
        )
    return made


def landmark_records(
    observations: Sequence[AnchoredObservation], solution: GraphSolution, scale: float
) -> tuple[Landmark, ...]:
    """Return the optimised landmarks, sorted by kind and id.

    Parameters
    ----------
    observations
        Observations of all landmarks.
    solution
        Solution of the graph that contains them.
    scale
        Factor on their covariances.
    """
    groups: dict[tuple[str, int], list[AnchoredObservation]] = {}
    for observation in observations:
        seen = observation.observation
        groups.setdefault((seen.kind, seen.id), []).append(observation)
    records = []
    for (kind, number), group in sorted(groups.items()):
        key = group[0].key
        position, cov = landmark_class(kind).position(
            solution.values, key, solution.covariance(key)
        )
        records.append(Landmark(kind, number, position, cov * scale, len(group)))
    return tuple(records)
