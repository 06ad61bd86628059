"""Views of door signs: measurements in pictures, and the poses of the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import compose2
from tccm_ros.records import SIGN, LandmarkObservation
from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement
from tccm_ros.slam.base_attitude import with_attitude
from tccm_ros.slam.chain import AnchoredPose
from tccm_ros.slam.factors.views import Z_ROLL_PITCH_SIGMAS
from tccm_ros.slam.landmarks import AnchoredObservation
from tccm_ros.slam.signs.triangulation import Rays

PIXEL_SIGMA = 2.0
"""Standard deviation (pixels) of the middle of a number in x and y (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class SignView:
    """A sign measurement in one picture, and the pose of the base.

    Attributes
    ----------
    measurement
        Measurement of the sign in the picture.
    anchored
        Pose of the base at its stamp, relative to a keyframe.
    sign
        Id of the sign by an earlier session; -1 without one.
    """

    measurement: SignMeasurement
    anchored: AnchoredPose
    sign: int = -1

    @property
    def T_base_camera(self) -> Float64:
        """Pose float64 (4, 4) of the camera in the base frame."""
        return self.measurement.T_base_camera

    @property
    def bearing_sigma(self) -> float:
        """Standard deviation of the bearing, rad."""
        return PIXEL_SIGMA / self.measurement.focal_length

    def observation(self, sign: int) -> AnchoredObservation:
        """Return the observation of a landmark of kind `SignBearing`."""
        T = self.measurement.T_base_camera
        direction = T[:3, :3] @ self.measurement.bearing
        cov = np.zeros((6, 6))
        cov[3:, 3:] = self.bearing_sigma**2 * (np.eye(3) - np.outer(direction, direction))
        measured = np.concatenate([T[:3, 3], direction])
        return AnchoredObservation(
            LandmarkObservation(self.measurement.stamp_ns, SIGN, sign, measured, cov), self.anchored
        )


@dataclass(frozen=True, slots=True, eq=False)
class PictureView:
    """A picture that was searched for signs, and the pose of the base.

    Attributes
    ----------
    picture
        The searched picture.
    anchored
        Pose of the base at its stamp, relative to a keyframe.
    """

    picture: SearchedPicture
    anchored: AnchoredPose

    @property
    def T_base_camera(self) -> Float64:
        """Pose float64 (4, 4) of the camera in the base frame."""
        return self.picture.T_base_camera


def camera_poses(views: Sequence[PictureView | SignView], poses: Float64) -> Float64:
    """Return the poses float64 (N, 4, 4) of the cameras of views in map.

    Parameters
    ----------
    views
        N views.
    poses
        float64 (K, 3), poses of the keyframes in map.
    """
    anchors = np.array([v.anchored.keyframe for v in views], np.int64)
    planar = compose2(poses[anchors], np.array([v.anchored.pose for v in views]).reshape(-1, 3))
    attitudes = np.array([v.anchored.attitude for v in views]).reshape(-1, 3)
    T_base_camera = np.array([v.T_base_camera for v in views]).reshape(-1, 4, 4)
    return np.asarray(with_attitude(planar, attitudes) @ T_base_camera)


def sign_order(measurement: SignMeasurement) -> tuple[float, ...]:
    """Return the sort key of measurements: stamp and pixel."""
    return (measurement.stamp_ns, *measurement.pixel.tolist())


def rays_of(views: Sequence[SignView], poses: Float64) -> Rays:
    """Return the rays of views in map.

    The variances include the roll, pitch and z of a moving base, as in `KeyframeView`, and the
    covariance of the motion since the keyframe.

    Parameters
    ----------
    views
        N views.
    poses
        float64 (K, 3), poses of the keyframes in map.
    """
    sigma_z, sigma_roll, _ = Z_ROLL_PITCH_SIGMAS
    T = camera_poses(views, poses)
    bearings = np.array([v.measurement.bearing for v in views]).reshape(-1, 3)
    directions = np.einsum("nij,nj->ni", T[:, :3, :3], bearings)
    cov = np.array([v.anchored.cov for v in views]).reshape(-1, 3, 3)
    sigma = np.array([v.bearing_sigma for v in views])
    angle = sigma**2 + np.maximum(sigma_roll**2, cov[:, 2, 2])
    position = np.maximum(sigma_z**2, 0.5 * (cov[:, 0, 0] + cov[:, 1, 1]))
    return Rays(T[:, :3, 3], directions, angle, position)
