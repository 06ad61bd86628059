"""The floor: what heights are counted from."""

from __future__ import annotations

import numpy as np

from tccm_ros.config import Config
from tccm_ros.surfaces.drafts import Draft

__all__ = ["find_floor", "is_floor"]

LEAST_AREA = 0.3
"""The floor is at least this large, m2."""

LEAST_SHARE = 0.2
"""And at least this share of the largest low surface: reflections lie below the floor."""

TOLERANCE = 0.06
"""A far floor, seen by a base that leans, is still floor within this height, m."""


def find_floor(drafts: list[Draft], config: Config) -> float | None:
    """Return the height of the floor in map, m; None where no floor was seen.

    The floor is the lowest large surface that does not lie above `surfaces.max_floor_height`.
    """
    low = [d for d in drafts if d.height <= config.surfaces.max_floor_height]
    large = max((d.polygon.area for d in low), default=0.0)
    low = [d for d in low if d.polygon.area >= max(LEAST_AREA, LEAST_SHARE * large)]
    if not low:
        return None
    lowest = min(d.height for d in low)
    level = [d for d in low if d.height <= lowest + TOLERANCE]
    weights = np.array([d.polygon.area for d in level])
    return float(np.average([d.height for d in level], weights=weights))


def is_floor(draft: Draft, floor_z: float | None) -> bool:
    """Return whether a surface is part of the floor."""
    return floor_z is not None and abs(draft.height - floor_z) <= TOLERANCE
