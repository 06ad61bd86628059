"""What detectors recognised."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from tccm_ros.arrays import Float64


class Hypothesis(NamedTuple):
    """A class that a detector gives an object.

    Attributes
    ----------
    class_id
        As the detector names it.
    score
        0 to 1.
    """

    class_id: str
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """The objects that a detector recognised in one picture or cloud.

    Attributes
    ----------
    stamp_ns, frame_id
        Of the picture; a frame of the robot, the odometry frame or the map frame.
    center
        float64 (N, 3), middle of each, m.
    hypotheses
        Of each, the classes that it may have; at least one.
    unusable
        Detections of the message that are not among them, by reason.
    """

    stamp_ns: int
    frame_id: str
    center: Float64
    hypotheses: tuple[tuple[Hypothesis, ...], ...]
    unusable: Mapping[str, int] = field(default_factory=dict)
