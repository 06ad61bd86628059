"""Registration of views: what they saw in common corrects their poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.slam.factors import Factor
from tccm_ros.surfaces.carving import carve
from tccm_ros.surfaces.drafts import surviving_patches
from tccm_ros.surfaces.landmarks import plane_factors
from tccm_ros.surfaces.views import View

__all__ = ["register_views"]

Float64 = NDArray[np.float64]


def register_views(
    views: list[View], T_map_view: Float64, cov_tilt: Float64, config: Config
) -> list[Factor]:
    """Return factors that tie views to each other, from the poses that are known so far.

    Parameters
    ----------
    views
        V views in stamp order.
    T_map_view, cov_tilt
        float64 (V, 4, 4) and (V, 3, 3) of (z, roll, pitch).
    config
        Uses the groups ``views`` and ``surfaces``.
    """
    placed = surviving_patches(views, carve(views, T_map_view, config), config)
    return [*plane_factors(placed, T_map_view, cov_tilt, config)]
