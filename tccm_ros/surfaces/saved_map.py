"""What is kept of a map between sessions: the walls' state, and views with what they hang on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.surfaces.views import View

__all__ = ["SavedMap", "SavedView"]


@dataclass(frozen=True, slots=True, eq=False)
class SavedView:
    """A view of a finished session.

    Attributes
    ----------
    view
        The view.
    keyframe
        Keyframe of its session that is nearest in time; -1 where there was none.
    hangs
        Whether it hangs on that keyframe; else, without a level laser, it is fixed in map.
    T_anchor_view
        float64 (4, 4), pose in that keyframe (level, at its planar pose), or in map.
    cov_tilt
        float64 (3, 3) of (z, roll, pitch).
    """

    view: View
    keyframe: int
    hangs: bool
    T_anchor_view: NDArray[np.float64]
    cov_tilt: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SavedMap:
    """A map as a later session finds it.

    Attributes
    ----------
    walls
        `WallSlam.state`: keyframes, walls and loops; empty without a level laser.
    views
        Views of all sessions.
    """

    walls: Mapping[str, NDArray[Any]]
    views: tuple[SavedView, ...]
