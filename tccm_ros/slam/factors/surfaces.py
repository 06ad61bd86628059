"""Factors of surface planes that views observe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import Key, surface_key, view_key
from tccm_ros.slam.factors.noise import gaussian


@dataclass(frozen=True, slots=True, eq=False)
class ViewPlane:
    """An observation of a surface plane by a view.

    Attributes
    ----------
    view, surface
        Indices of the variables (`view_key`, `surface_key`).
    normal, offset
        float64 (3,), unit vector, and m: ``normal . p = offset`` in the view's frame.
    cov
        float64 (3, 3) of (rotation about u, rotation about v, offset at the view's origin), rad and
        m, where u, v are any two tangents; only covariances that are isotropic in the rotations
        are independent of the choice of u, v.
    """

    view: int
    surface: int
    normal: Float64
    offset: float
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor."""
        keys = view_key(self.view).symbol, surface_key(self.surface).symbol
        measured = np.array([*self.normal, -self.offset])
        graph.add(gtsam.OrientedPlane3Factor(measured, gaussian(self.cov), *keys))

    @property
    def landmark(self) -> Key:
        """The surface."""
        return surface_key(self.surface)

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start the surface where the first of its factors sees it."""
        T_map_view = pose_of(view_key(self.view))
        normal = T_map_view[:3, :3] @ np.asarray(self.normal, float)
        offset = self.offset + normal @ T_map_view[:3, 3]
        plane = gtsam.OrientedPlane3(np.array([*normal, -offset]))
        return [(surface_key(self.surface), plane)]
