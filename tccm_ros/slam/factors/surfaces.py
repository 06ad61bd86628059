"""Factors of surface planes that views observe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import Key, surface_key, view_key
from tccm_ros.slam.factors.noise import gaussian, huber


@dataclass(frozen=True, slots=True, eq=False)
class ViewPlane:
    """An observation of a horizontal surface's plane by a view.

    A view knows the height of what it saw of a surface well, and its slope worse: far from what it
    saw, an error of the slope is one of the height. The plane is therefore compared at the middle
    of what the view saw, where the two errors are independent. The residual is the difference of
    the normals, x and y (rad), and the distance of that point from the plane (m).

    Attributes
    ----------
    view, surface
        Indices of the variables (`view_key`, `surface_key`).
    normal, point
        float64 (3,), unit vector, upwards, and a point of the plane, m, in the view's frame.
    cov
        float64 (3, 3) of (x and y of the normal, distance of the point), rad and m.
    """

    view: int
    surface: int
    normal: Float64
    point: Float64
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a robust factor (Huber) whose residual and derivatives are computed here.

        GTSAM's factor of oriented planes has its residual in a basis of tangents that flips where
        planes are horizontal. Pieces of a surface that is no plane in the data contradict each
        other by many standard deviations: their influence is bounded.
        """
        keys = view_key(self.view).symbol, surface_key(self.surface).symbol
        graph.add(gtsam.CustomFactor(huber(gaussian(self.cov)), list(keys), self._residual))

    def _residual(
        self, factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Float64] | None
    ) -> Float64:
        """Return the residual, float64 (3,), and write its derivatives by pose and plane."""
        view, surface = factor.keys()
        T, plane = values.atPose3(view).matrix(), values.atOrientedPlane3(surface)
        coefficients = plane.planeCoefficients()
        n = T[:3, :3].T @ coefficients[:3]
        at = T[:3, :3] @ self.point + T[:3, 3]
        if jacobians is not None:
            tangents = plane.normal().basis()
            by_pose = np.zeros((3, 6), order="F")
            by_pose[:2, :3] = [[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]]]
            by_pose[2, :3] = np.cross(self.point, n)
            by_pose[2, 3:] = n
            by_plane = np.zeros((3, 3), order="F")
            by_plane[:2, :2] = T[:3, :2].T @ tangents
            by_plane[2, :2] = at @ tangents
            by_plane[2, 2] = 1.0
            jacobians[0], jacobians[1] = by_pose, by_plane
        distance = at @ coefficients[:3] + coefficients[3]
        return np.array([n[0] - self.normal[0], n[1] - self.normal[1], distance])

    @property
    def landmark(self) -> Key:
        """The surface."""
        return surface_key(self.surface)

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start the surface where the first of its factors sees it."""
        T_map_view = pose_of(view_key(self.view))
        normal = T_map_view[:3, :3] @ np.asarray(self.normal, float)
        point = T_map_view[:3, :3] @ np.asarray(self.point, float) + T_map_view[:3, 3]
        plane = gtsam.OrientedPlane3(np.array([*normal, -(normal @ point)]))
        return [(surface_key(self.surface), plane)]
