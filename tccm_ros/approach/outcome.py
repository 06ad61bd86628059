"""How an approach ends: a reason and what was measured."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from tccm_ros.arrays import Float64


class Reason(IntEnum):
    """Why an approach ended, as action/ApproachSurface numbers it."""

    NONE = 0
    BAD_GOAL = 1
    NO_SURFACE = 2
    NO_PLACE = 3
    BLOCKED = 4
    GONE = 5
    MOVED = 6
    LOST_POSE = 7
    LOST_SCANS = 8
    LOST_SURFACE = 9
    CANCELLED = 10
    BUSY = 11


class Phase(IntEnum):
    """What the base does, as action/ApproachSurface numbers it."""

    LOOKING = 0
    STAGING = 1
    CLOSING = 2
    VERIFYING = 3
    RETREATING = 4


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The end of an approach or a retreat.

    Attributes
    ----------
    reason
        `Reason.NONE` where it is done.
    message
        A sentence.
    gap, yaw_error, sigma
        Between the footprint and the measured edge, m; heading of the base less that of the
        edge's normal inwards, rad; standard deviation of the gap, m. nan where not measured.
    distance
        Of the spot from the base's origin, m; nan without a spot.
    surface
        float64 (3,), pose of the surface in map where it was measured; None where it was not.
    height
        Of the top over z = 0 of the base frame, m.
    has_moved
        Whether that is elsewhere than the map had it.
    """

    reason: Reason
    message: str
    gap: float = np.nan
    yaw_error: float = np.nan
    sigma: float = np.nan
    distance: float = np.nan
    surface: Float64 | None = None
    height: float = 0.0
    has_moved: bool = False
