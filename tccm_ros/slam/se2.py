"""Planar poses in compiled code: fast versions of functions in `geometry`.

From Python, `compose_se2` and `between_se2` take 0.8 us here, and 11 and 20 us in `geometry`, whose
functions take arrays of any shape; compiled code can call only these. Tests compare the two. Poses
are float64 (3,) of (x, y, yaw), m and rad; yaw is wrapped to [-pi, pi].
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel


@kernel
def _wrap(angle: float) -> float:
    return angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi))


@kernel
def compose_se2(a: Float64, b: Float64) -> Float64:
    """Return a * b."""
    c, s = np.cos(a[2]), np.sin(a[2])
    result = np.empty(3)
    result[0] = a[0] + c * b[0] - s * b[1]
    result[1] = a[1] + s * b[0] + c * b[1]
    result[2] = _wrap(a[2] + b[2])
    return result


@kernel
def inverse_se2(a: Float64) -> Float64:
    """Return the inverse of a."""
    c, s = np.cos(a[2]), np.sin(a[2])
    result = np.empty(3)
    result[0], result[1] = -c * a[0] - s * a[1], s * a[0] - c * a[1]
    result[2] = _wrap(-a[2])
    return result


@kernel
def between_se2(a: Float64, b: Float64) -> Float64:
    """Return the pose of b relative to a: inverse_se2(a) * b."""
    return compose_se2(inverse_se2(a), b)


@kernel
def transform_points(pose: Float64, points: Float64) -> Float64:
    """Return points (N, 2) in the parent frame of `pose`."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    result = np.empty_like(points)
    for i in range(len(points)):
        result[i, 0] = c * points[i, 0] - s * points[i, 1] + pose[0]
        result[i, 1] = s * points[i, 0] + c * points[i, 1] + pose[1]
    return result


@kernel
def transform_scans(
    poses: Float64, counts: Int64, points: Float64, normals: Float64
) -> tuple[Float64, Float64]:
    """Return points and normals, float64 (N, 2), in the common parent frame of the scans' poses.

    Parameters
    ----------
    poses
        float64 (K, 3), m and rad.
    counts
        int64 (K,), number of points of each scan; their sum is N.
    points, normals
        float64 (N, 2), scan after scan, each in its scan's frame.
    """
    moved, rotated = np.empty_like(points), np.empty_like(normals)
    i = 0
    for k in range(len(counts)):
        x, y = poses[k, 0], poses[k, 1]
        c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        for _ in range(counts[k]):
            moved[i, 0] = c * points[i, 0] - s * points[i, 1] + x
            moved[i, 1] = s * points[i, 0] + c * points[i, 1] + y
            rotated[i, 0] = c * normals[i, 0] - s * normals[i, 1]
            rotated[i, 1] = s * normals[i, 0] + c * normals[i, 1]
            i += 1
    return moved, rotated


@kernel
def rotate_covariance(cov: Float64, yaw: float) -> Float64:
    """Rotate a covariance or information (3, 3) of (x, y, yaw) to the parent frame.

    `yaw` (rad) is the yaw of its frame in the parent frame.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return R @ cov @ np.ascontiguousarray(R.T)


@kernel
def fuse(information: Float64, yaw: float, cov: Float64) -> Float64:
    """Return a covariance after a Kalman filter update with additional information.

    Parameters
    ----------
    information
        float64 (3, 3) of (x, y, yaw) along the map's axes.
    yaw
        Yaw of a frame in the map, rad.
    cov
        float64 (3, 3) of (x, y, yaw) along that frame's axes.

    Returns
    -------
    float64 (3, 3), covariance along that frame's axes
    """
    return np.linalg.inv(rotate_covariance(information, -yaw) + np.linalg.inv(cov))
