"""Result of an approach: a reason and the measurements at its end."""

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
    """Phase of an approach, as action/ApproachSurface numbers it."""

    LOOKING = 0
    STAGING = 1
    CLOSING = 2
    VERIFYING = 3
    RETREATING = 4


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Result of an approach or a retreat.

    Attributes
    ----------
    reason
        `Reason.NONE` on success.
    message
        Description for the user.
    gap, yaw_error, sigma
        Distance between the footprint and the measured edge, m; heading of the base minus that of
        the edge's inward normal, rad; standard deviation of the gap, m. nan if not measured.
    distance
        Horizontal distance of the spot from the base's origin, m; nan without a spot.
    surface
        float64 (3,), measured pose of the surface in map; None if it was not located.
    height
        Height of the top over z = 0 of the base frame, m.
    has_moved
        Whether the measured pose differs from that in the map.
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
