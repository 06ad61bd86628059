"""Rigid transforms of the simulator.

They are independent of `tccm_ros.geometry`, so that a sign error in one of the two is found by the
tests. ``T_a_b`` maps coordinates in b to a.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Bool, Float64
from tccm_ros.kernels import kernel


def rotation_rpy(roll: float, pitch: float, yaw: float) -> Float64:
    """Return Rz(yaw) Ry(pitch) Rx(roll); a positive pitch rotates x downwards.

    Parameters
    ----------
    roll, pitch, yaw
        rad, about the fixed axes x, y, z.

    Returns
    -------
    float64 (3, 3)
    """
    cr, sr, cp, sp, cy, sy = cos(roll), sin(roll), cos(pitch), sin(pitch), cos(yaw), sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rigid(xyz: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)) -> Float64:
    """Return T_a_b, float64 (4, 4), of b's origin in a (m) and b's roll, pitch, yaw (rad)."""
    roll, pitch, yaw = np.asarray(rpy, float)
    T = np.eye(4)
    T[:3, :3] = rotation_rpy(roll, pitch, yaw)
    T[:3, 3] = xyz
    return T


def invert(T_a_b: Float64) -> Float64:
    """Return T_b_a, float64 (..., 4, 4)."""
    T = np.zeros_like(T_a_b)
    T[..., :3, :3] = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    T[..., :3, 3:] = -T[..., :3, :3] @ T_a_b[..., :3, 3:]
    T[..., 3, 3] = 1.0
    return T


def quaternion_xyzw(T_a_b: Float64) -> Float64:
    """Return the rotation as a unit quaternion, float64 (4,), w >= 0 (for angles below pi)."""
    R = T_a_b[:3, :3]
    # Use the column of the 4 x 4 outer product q q^T with the largest norm, for stability.
    K = np.empty((4, 4))
    K[:3, :3] = R + R.T + (1.0 - np.trace(R)) * np.eye(3)
    K[:3, 3] = K[3, :3] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[3, 3] = 1.0 + np.trace(R)
    q: Float64 = K[:, np.argmax(np.diag(K))]
    return q / (np.linalg.norm(q) * (-1.0 if q[3] < 0.0 else 1.0))


@kernel
def chain_poses(origins: Float64, axes: Float64, slides: Bool, positions: Float64) -> Float64:
    """Return the poses of the end of a chain of joints.

    Parameters
    ----------
    origins
        float64 (J, 4, 4), each joint's frame in the frame of the previous joint, at zero.
    axes
        float64 (J, 3), unit axis of motion in the joint's frame; zero for a fixed joint.
    slides
        bool (J,), whether a joint moves along its axis instead of rotating about it.
    positions
        float64 (B, J), rad or m.

    Returns
    -------
    float64 (B, 4, 4)
    """
    poses = np.zeros((len(positions), 4, 4))
    R, t = np.empty((3, 3)), np.empty(3)
    R_joint, step = np.empty((3, 3)), np.empty((3, 3))
    for b in range(len(positions)):
        R[:], t[:] = 0.0, 0.0
        R[0, 0] = R[1, 1] = R[2, 2] = 1.0
        for j in range(len(origins)):
            for k in range(3):
                for m in range(3):
                    t[k] += R[k, m] * origins[j, m, 3]
            _multiply(R, origins[j], step)
            if slides[j]:
                R[:] = step
                for k in range(3):
                    for m in range(3):
                        t[k] += R[k, m] * axes[j, m] * positions[b, j]
            else:
                _rotate_about(axes[j], positions[b, j], R_joint)
                _multiply(step, R_joint, R)
        poses[b, :3, :3], poses[b, :3, 3], poses[b, 3, 3] = R, t, 1.0
    return poses


@kernel
def _multiply(A: Float64, B: Float64, product: Float64) -> None:
    """Write the product of the upper left (3, 3) of A and B."""
    for i in range(3):
        for j in range(3):
            product[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def _rotate_about(axis: Float64, angle: float, R: Float64) -> None:
    """Write the rotation by `angle` about `axis` (Rodrigues) to R; a zero axis gives identity."""
    x, y, z = axis
    if x == 0.0 and y == 0.0 and z == 0.0:
        angle = 0.0
    c, s = np.cos(angle), np.sin(angle)
    k = 1.0 - c
    R[0, 0], R[0, 1], R[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    R[1, 0], R[1, 1], R[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    R[2, 0], R[2, 1], R[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k
