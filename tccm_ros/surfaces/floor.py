"""The floor: what heights are counted from."""

from __future__ import annotations

import numpy as np

from tccm_ros.config import Config
from tccm_ros.surfaces.drafts import Draft

__all__ = ["find_floor", "is_floor"]

LEAST_AREA = 0.3
"""The floor is at least this large, m2."""

TOLERANCE = 0.06
"""A far floor, seen by a base that leans, is still floor within this height, m."""


def find_floor(drafts: list[Draft], config: Config) -> float | None:
    """Return the height of the floor in map, m; None where no floor was seen.

    The floor is the height at which most of the low surfaces' area lies, the lower one of two that
    are alike. The lowest surface would not do: reflections lie below the floor, and so does a far
    floor where the tilt zero is wrong.
    """
    low = [d for d in drafts if d.height <= config.surfaces.max_floor_height]
    low = [d for d in low if d.polygon.area >= LEAST_AREA]
    if not low:
        return None
    heights = np.array([d.height for d in low])
    areas = np.array([d.polygon.area for d in low])
    near = np.abs(heights[:, None] - heights) <= TOLERANCE
    support = near @ areas
    best = np.lexsort((heights, -support))[0]
    return float(np.average(heights[near[best]], weights=areas[near[best]]))


def is_floor(draft: Draft, floor_z: float | None) -> bool:
    """Return whether a surface is part of the floor."""
    return floor_z is not None and abs(draft.height - floor_z) <= TOLERANCE
