"""Labels of objects: association of detections with objects of the map.

A detection is stored in the base frame of a view, so that it moves with that view when the map is
corrected, and is part of saved maps. Its scores are added to the object at its position after that
view, if there is one.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import transform
from tccm_ros.records import Hypothesis

MAX_GAP = 0.05
"""Max distance of a detection's centre from the box of its object, m; chosen: the position error of
a detector, and less than the distance of two objects."""

MAX_WAIT_NS = 60_000_000_000
"""Max time for which detections wait for the next view, ns; chosen: many tilt cycles. It bounds the
number of waiting detections of a robot at rest whose laser does not tilt."""


@dataclass(slots=True, eq=False)
class ClassScores:
    """Class scores of one object, from its detections.

    Attributes
    ----------
    total
        Sum of the scores of each class.
    count
        Number of detections.
    """

    total: dict[str, float] = field(default_factory=dict)
    count: int = 0

    def add(self, total: Mapping[str, float], count: int) -> None:
        """Add the scores of some detections."""
        for class_id, score in total.items():
            self.total[class_id] = self.total.get(class_id, 0.0) + score
        self.count += count

    def label(self) -> Hypothesis | None:
        """Return the class with the largest sum of scores and its mean score; None: no detections.

        Of classes with equal sums, the first in alphabetical order is returned.
        """
        if not self.count:
            return None
        best = min(self.total, key=lambda class_id: (-self.total[class_id], class_id))
        return Hypothesis(best, self.total[best] / self.count)


@dataclass(frozen=True, slots=True, eq=False)
class SeenDetection:
    """Detections of one object in one view, in the base frame of the view.

    Attributes
    ----------
    center
        float64 (3,), mean of their centres, m.
    scores
        Sum of their scores by class.
    count
        Number of detections.
    """

    center: Float64
    scores: Mapping[str, float]
    count: int = 1


class PlacedDetections(NamedTuple):
    """The detections of one message with their positions.

    Attributes
    ----------
    stamp_ns
        Stamp of the message.
    center
        float64 (N, 3), in the base frame at that time or in map, m.
    hypotheses
        Class hypotheses of each detection.
    is_in_map
        Whether `center` is in map.
    """

    stamp_ns: int
    center: Float64
    hypotheses: tuple[tuple[Hypothesis, ...], ...]
    is_in_map: bool


def view_of(stamp_ns: int, view_stamps_ns: Sequence[int]) -> int | None:
    """Return the index of the view that detections belong to; None: no such view.

    It is the next view if that follows within `MAX_WAIT_NS`, else the previous one.

    Parameters
    ----------
    stamp_ns
        Stamp of the detections.
    view_stamps_ns
        Stamps of the views, ascending.
    """
    after = bisect_left(view_stamps_ns, stamp_ns)
    if after < len(view_stamps_ns) and view_stamps_ns[after] - stamp_ns <= MAX_WAIT_NS:
        return after
    return after - 1 if after else None


def seen_detections(placed: PlacedDetections, T_view: Float64) -> list[SeenDetection]:
    """Return detections in the base frame of a view.

    Parameters
    ----------
    placed
        Detections in the base frame or in map.
    T_view
        float64 (4, 4), pose of that frame in the view.
    """
    centers = transform(T_view, placed.center)
    return [
        SeenDetection(center, _scores(found)) for center, found in zip(centers, placed.hypotheses)
    ]


def _scores(found: Iterable[Hypothesis]) -> dict[str, float]:
    total: dict[str, float] = {}
    for class_id, score in found:
        total[class_id] = total.get(class_id, 0.0) + score
    return total


def merge_detections(seen: Iterable[SeenDetection]) -> tuple[SeenDetection, ...]:
    """Merge the detections of one view that have the same classes and nearly the same position."""
    merged: list[SeenDetection] = []
    for item in seen:
        for k, other in enumerate(merged):
            is_near = np.linalg.norm(item.center - other.center) <= MAX_GAP
            if is_near and item.scores.keys() == other.scores.keys():
                merged[k] = _joined(other, item)
                break
        else:
            merged.append(item)
    return tuple(merged)


def _joined(first: SeenDetection, second: SeenDetection) -> SeenDetection:
    count = first.count + second.count
    center = (first.count * first.center + second.count * second.center) / count
    scores = {c: score + second.scores[c] for c, score in first.scores.items()}
    return replace(first, center=center, scores=scores, count=count)


def distance_to_box(point: Float64, center: Float64, size: Float64, yaw: float) -> float:
    """Return the distance of a point from a box with vertical sides, m; 0 inside.

    Parameters
    ----------
    point, center
        float64 (3,), in one frame, m.
    size
        float64 (3,), edges along the box's x, y and z, m.
    yaw
        Yaw of its x axis, rad.
    """
    x, y, z = (point - center).tolist()
    c, s = math.cos(yaw), math.sin(yaw)
    local = np.abs([c * x + s * y, c * y - s * x, z])
    return float(np.linalg.norm(np.maximum(local - 0.5 * size, 0.0)))


NO_OBJECT = "detection: no object of the map there"
NO_VIEW = "detection: no view before it, and none soon after it"
"""Reasons for which a detection gives no label."""


def count_unused(unusable: Mapping[str, int], without_object: int) -> Counter[str]:
    """Return the number of detections that gave no label, by reason."""
    return Counter(unusable) + Counter({NO_OBJECT: without_object})
