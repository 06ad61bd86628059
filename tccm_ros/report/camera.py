"""Pinhole camera for pictures in perspective."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Pose of a pinhole camera.

    Attributes
    ----------
    eye
        float64 (3,), its centre in map, m.
    R_camera_map
        float64 (3, 3): rows are the directions right, up and back in map.
    """

    eye: Float64
    R_camera_map: Float64

    def project(self, points: Float64) -> Float64:
        """Project points (..., 3) in map, m, in front of the camera, to the picture (..., 2).

        Unit: the distance of the picture plane. x right, y up, origin at the centre.
        """
        seen = (points - self.eye) @ self.R_camera_map.T
        return seen[..., :2] / np.maximum(-seen[..., 2:], 1e-6)

    def distance(self, points: Float64) -> float:
        """Return the distance of the mean of points (N, 3) from the camera, m."""
        return float(np.linalg.norm(points.mean(axis=0) - self.eye))


def look_at(target: Float64, azimuth: float, elevation: float, distance: float) -> Camera:
    """Return a camera that looks at a point.

    Parameters
    ----------
    target
        float64 (3,), in map, m.
    azimuth, elevation
        Direction from the target to the camera, rad: azimuth from x towards y, elevation up.
    distance
        Distance from the target, m.
    """
    back = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return Camera(target + distance * back, np.stack([right, np.cross(back, right), back]))
