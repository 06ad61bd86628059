"""Rigid transforms in space and in the plane.

``T_a_b`` maps coordinates in frame b to frame a: ``p_a = T_a_b @ p_b``. Three-dimensional poses are
float64 arrays (..., 4, 4); planar poses are float64 arrays (..., 3) of (x, y, yaw), in m and rad.
Quaternions are (x, y, z, w). Angles are wrapped to (-pi, pi].
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from tccm_ros.arrays import Float64


def wrap_angle(angle: ArrayLike) -> Float64:
    """Wrap angles in rad to (-pi, pi]."""
    return -((-np.asarray(angle, float) + np.pi) % (2.0 * np.pi) - np.pi)


def pose(R_a_b: ArrayLike, t_a_b: ArrayLike) -> Float64:
    """Return T_a_b (..., 4, 4) of rotation matrices (..., 3, 3) and translations (..., 3)."""
    R, t = np.asarray(R_a_b, float), np.asarray(t_a_b, float)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], t.shape[:-1]), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = t
    T[..., 3, 3] = 1.0
    return T


def pose_from_quaternion(t_a_b: ArrayLike, q_a_b: ArrayLike) -> Float64:
    """Return T_a_b (..., 4, 4) of translations (..., 3) and quaternions (..., 4) xyzw.

    Quaternions are normalised; a zero quaternion raises ValueError.
    """
    return pose(Rotation.from_quat(np.asarray(q_a_b, float)).as_matrix(), t_a_b)


def pose_from_rpy(xyz_rpy: ArrayLike) -> Float64:
    """Return T_a_b (4, 4) of (x, y, z, roll, pitch, yaw): R = Rz Ry Rx, as in URDF."""
    values = np.asarray(xyz_rpy, float)
    return pose(Rotation.from_euler("xyz", values[3:]).as_matrix(), values[:3])


def quaternion(T_a_b: ArrayLike) -> Float64:
    """Return the rotations of poses (..., 4, 4) as quaternions (..., 4) xyzw with w >= 0."""
    T = np.asarray(T_a_b, float)
    q = Rotation.from_matrix(T[..., :3, :3].reshape(-1, 3, 3)).as_quat(canonical=True)
    return q.reshape(*T.shape[:-2], 4)


def pose_from_roll_pitch(roll_pitch: ArrayLike) -> Float64:
    """Return T_a_b (..., 4, 4) of rolls and pitches (..., 2), rad: R = Ry Rx, without yaw."""
    values = np.asarray(roll_pitch, float)
    angles = np.concatenate([values, np.zeros((*values.shape[:-1], 1))], axis=-1)
    R = Rotation.from_euler("xyz", angles.reshape(-1, 3)).as_matrix()
    return pose(R.reshape(*values.shape[:-1], 3, 3), np.zeros(3))


def inverse(T_a_b: ArrayLike) -> Float64:
    """Return T_b_a of rigid poses (..., 4, 4)."""
    T = np.asarray(T_a_b, float)
    R_b_a = np.swapaxes(T[..., :3, :3], -1, -2)
    result = np.zeros(T.shape)
    result[..., :3, :3] = R_b_a
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", R_b_a, T[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def transform(T_a_b: ArrayLike, points_b: ArrayLike) -> Float64:
    """Map points (..., N, 3) in frame b to frame a by T_a_b (..., 4, 4)."""
    T, points = np.asarray(T_a_b, float), np.asarray(points_b, float)
    return points @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]


def transform_plan(T_a_b: ArrayLike, plan_b: ArrayLike, height_b: float) -> Float64:
    """Return x and y in a of points (N, 2) at one height in b, float64 (N, 2)."""
    points = np.asarray(plan_b, np.float64)
    return transform(T_a_b, np.column_stack([points, np.full(len(points), height_b)]))[:, :2]


def interpolate_poses(T0: ArrayLike, T1: ArrayLike, fraction: ArrayLike) -> Float64:
    """Interpolate between pairs of poses: translation linearly, rotation about one axis.

    Parameters
    ----------
    T0, T1
        float64 (..., 4, 4).
    fraction
        float64 (...), 0 at T0 and 1 at T1; broadcasts against the poses.

    Returns
    -------
    float64 (..., 4, 4)
    """
    T0, T1, f = np.asarray(T0, float), np.asarray(T1, float), np.asarray(fraction, float)
    shape = np.broadcast_shapes(T0.shape[:-2], T1.shape[:-2], f.shape)
    T0, T1 = np.broadcast_to(T0, (*shape, 4, 4)), np.broadcast_to(T1, (*shape, 4, 4))
    f = np.broadcast_to(f, shape)
    # Copies, since SciPy before 1.14 takes no read-only arrays.
    R0 = Rotation.from_matrix(T0[..., :3, :3].reshape(-1, 3, 3).copy())
    R1 = Rotation.from_matrix(T1[..., :3, :3].reshape(-1, 3, 3).copy())
    partial = (R0.inv() * R1).as_rotvec() * f.reshape(-1, 1)
    R = (R0 * Rotation.from_rotvec(partial)).as_matrix().reshape(*shape, 3, 3)
    return pose(R, T0[..., :3, 3] * (1.0 - f[..., None]) + T1[..., :3, 3] * f[..., None])


def planar(T_a_b: ArrayLike) -> Float64:
    """Project poses (..., 4, 4) to (x, y, yaw) (..., 3); yaw is that of the x axis."""
    T = np.asarray(T_a_b, float)
    result = np.empty((*T.shape[:-2], 3))
    result[..., :2] = T[..., :2, 3]
    result[..., 2] = np.arctan2(T[..., 1, 0], T[..., 0, 0])
    return result


def spatial(pose2: ArrayLike, z: ArrayLike = 0.0) -> Float64:
    """Lift planar poses (..., 3) to (..., 4, 4) at heights z (...), with roll = pitch = 0."""
    p = np.asarray(pose2, float)
    c, s = np.cos(p[..., 2]), np.sin(p[..., 2])
    T = np.zeros((*p.shape[:-1], 4, 4))
    T[..., 0, 0], T[..., 0, 1], T[..., 0, 3] = c, -s, p[..., 0]
    T[..., 1, 0], T[..., 1, 1], T[..., 1, 3] = s, c, p[..., 1]
    T[..., 2, 3] = z
    T[..., 2, 2] = T[..., 3, 3] = 1.0
    return T


def level(T_a_b: ArrayLike) -> Float64:
    """Return poses (..., 4, 4) with the same translation and yaw, without roll and pitch."""
    T = np.asarray(T_a_b, float)
    return spatial(planar(T), T[..., 2, 3])


def compose2(p_a_b: ArrayLike, p_b_c: ArrayLike) -> Float64:
    """Compose planar poses (..., 3): p_a_c = p_a_b * p_b_c."""
    a, b = np.asarray(p_a_b, float), np.asarray(p_b_c, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    result = np.empty(np.broadcast(a, b).shape)
    result[..., 0] = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    result[..., 1] = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    result[..., 2] = wrap_angle(a[..., 2] + b[..., 2])
    return result


def inverse2(p_a_b: ArrayLike) -> Float64:
    """Invert planar poses (..., 3)."""
    p = np.asarray(p_a_b, float)
    c, s = np.cos(p[..., 2]), np.sin(p[..., 2])
    result = np.empty(p.shape)
    result[..., 0] = -c * p[..., 0] - s * p[..., 1]
    result[..., 1] = s * p[..., 0] - c * p[..., 1]
    result[..., 2] = wrap_angle(-p[..., 2])
    return result


def between2(p_a_b: ArrayLike, p_a_c: ArrayLike) -> Float64:
    """Return the planar pose of c in b (..., 3): inverse(p_a_b) * p_a_c."""
    return compose2(inverse2(p_a_b), p_a_c)


def transform2(p_a_b: ArrayLike, points_b: ArrayLike) -> Float64:
    """Map planar points (..., N, 2) in frame b to frame a by planar poses (..., 3)."""
    p, points = np.asarray(p_a_b, float), np.asarray(points_b, float)
    c, s = np.cos(p[..., 2])[..., None], np.sin(p[..., 2])[..., None]
    x = p[..., None, 0] + c * points[..., 0] - s * points[..., 1]
    result = np.empty((*x.shape, 2))
    result[..., 0] = x
    result[..., 1] = p[..., None, 1] + s * points[..., 0] + c * points[..., 1]
    return result
