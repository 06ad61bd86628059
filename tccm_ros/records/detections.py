"""Objects recognised by a detector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from tccm_ros.arrays import Float64


class Hypothesis(NamedTuple):
    """A class hypothesis of a detected object.

    Attributes
    ----------
    class_id
        Class name of the detector.
    score
        Score, 0 to 1.
    """

    class_id: str
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """The objects that a detector recognised in one picture or cloud.

    Attributes
    ----------
    stamp_ns, frame_id
        Of the picture; the frame is one of the robot, the odometry frame or the map frame.
    center
        float64 (N, 3), centres, m.
    hypotheses
        Class hypotheses of each object; at least one.
    unusable
        Number of detections of the message that were left out, by reason.
    """

    stamp_ns: int
    frame_id: str
    center: Float64
    hypotheses: tuple[tuple[Hypothesis, ...], ...]
    unusable: Mapping[str, int] = field(default_factory=dict)
