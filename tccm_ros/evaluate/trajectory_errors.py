"""Errors of a trajectory: relations, absolute, relative over distance, consistency.

All functions take poses float64 (N, 4, 4) and return `Errors`; none reads files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.geometry import interpolate_poses, inverse, pose

SAME_STAMP_NS = 1_000_000
"""Maximum difference of equal stamps, ns: text files round stamps to microseconds or less, and no
sensor measures at 1 kHz."""

MAX_GAP_NS = 1_000_000_000
"""Maximum time between the poses before and after a stamp at which poses are interpolated, ns;
chosen."""

NEAR_M, MIN_PATH_M = 3.0, 10.0
"""Maximum distance of poses that meet, and minimum path length between them, m; chosen: a room, and
the way around it."""


class Order(StrEnum):
    """Order of factors in the error of a relation, see `relation_errors`."""

    KUEMMERLE = "kuemmerle"
    CARTOGRAPHER = "cartographer"


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of poses or relative poses.

    Attributes
    ----------
    translation
        float64 (N,), m, >= 0.
    rotation
        float64 (N,), rad, 0 to pi.
    """

    translation: Float64
    rotation: Float64

    @classmethod
    def of(cls, T_errors: Float64) -> Errors:
        """Return the errors of transforms (N, 4, 4)."""
        T = np.asarray(T_errors, float).reshape(-1, 4, 4)
        angles = Rotation.from_matrix(T[:, :3, :3]).magnitude() if len(T) else np.zeros(0)
        return cls(np.linalg.norm(T[:, :3, 3], axis=1), angles)

    def __len__(self) -> int:
        return len(self.translation)


def poses_at(stamps_ns: Int64, poses: Float64, asked_ns: Int64) -> tuple[Float64, Bool]:
    """Return the poses of a trajectory at given stamps.

    A pose within `SAME_STAMP_NS` is returned as it is; others are interpolated.

    Parameters
    ----------
    stamps_ns, poses
        int64 (N,), strictly ascending, and float64 (N, 4, 4).
    asked_ns
        int64 (M,), stamps of the result. Those in a gap (`MAX_GAP_NS`), or outside of the
        trajectory, are unknown.

    Returns
    -------
    float64 (M, 4, 4), and whether each is known, bool (M,)
    """
    after = np.clip(np.searchsorted(stamps_ns, asked_ns), 0, len(stamps_ns) - 1)
    before = np.clip(np.where(stamps_ns[after] > asked_ns, after - 1, after), 0, None)
    is_later = np.abs(stamps_ns[after] - asked_ns) < np.abs(stamps_ns[before] - asked_ns)
    nearest = np.where(is_later, after, before)
    is_same = np.abs(stamps_ns[nearest] - asked_ns) <= SAME_STAMP_NS
    before, after = np.where(is_same, nearest, before), np.where(is_same, nearest, after)
    gap = (stamps_ns[after] - stamps_ns[before]).astype(float)
    since = (asked_ns - stamps_ns[before]).astype(float)
    fraction = np.divide(since, gap, out=np.zeros_like(gap), where=gap > 0)
    is_within = (asked_ns >= stamps_ns[0]) & (asked_ns <= stamps_ns[-1])
    known = is_same | (is_within & (gap <= MAX_GAP_NS))
    fraction = np.clip(fraction, 0.0, 1.0)
    return interpolate_poses(poses[before], poses[after], fraction), known


def relation_errors(
    T_map_from: Float64, T_map_to: Float64, deltas: Float64, order: Order = Order.KUEMMERLE
) -> Errors:
    """Compare relative poses with relations (Kuemmerle et al., 2009, Eq. 2).

    Parameters
    ----------
    T_map_from, T_map_to
        float64 (N, 4, 4), estimated poses of both ends.
    deltas
        float64 (N, 4, 4), the relations delta*.
    order
        `KUEMMERLE`: inverse(delta*) * delta, the error in the frame of the relation's end.
        `CARTOGRAPHER`: delta * inverse(delta*), as in that project's tool. The rotation errors are
        equal; the translation errors differ if delta and delta* have different rotations.
    """
    found = inverse(T_map_from) @ T_map_to
    if order == Order.KUEMMERLE:
        return Errors.of(inverse(deltas) @ found)
    return Errors.of(found @ inverse(deltas))


def align(points: Float64, truth: Float64) -> Float64:
    """Return T_truth_map (4, 4) that aligns points (N, 3) with truth (N, 3) by least squares.

    Umeyama's solution without scale; for a planar trajectory z remains vertical.
    """
    a, b = points.mean(axis=0), truth.mean(axis=0)
    U, _, Vt = np.linalg.svd((truth - b).T @ (points - a))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = U @ flip @ Vt
    flat = np.ptp(points[:, 2]) < 1e-6 and np.ptp(truth[:, 2]) < 1e-6
    if flat or len(points) < 3:
        cross = (points - a)[:, :2].T @ (truth - b)[:, :2]
        yaw = np.arctan2(cross[0, 1] - cross[1, 0], cross[0, 0] + cross[1, 1])
        R = Rotation.from_euler("z", yaw).as_matrix()
    return pose(R, b - R @ a)


def absolute_errors(poses: Float64, truth: Float64, *, aligned: bool = True) -> Errors:
    """Compare poses with truth.

    Parameters
    ----------
    poses, truth
        float64 (N, 4, 4).
    aligned
        Whether the positions are aligned first (see `align`).
    """
    T = align(poses[:, :3, 3], truth[:, :3, 3]) if aligned else np.eye(4)
    return Errors.of(inverse(truth) @ (T @ poses))


def distance_errors(poses: Float64, truth: Float64, distance: float) -> Errors:
    """Compare relative poses over a given path length.

    Parameters
    ----------
    poses, truth
        float64 (N, 4, 4).
    distance
        Length of the true path, m; all poses that have a successor at that distance are used.
    """
    steps = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1)
    path = np.concatenate([[0.0], np.cumsum(steps)])
    ends = np.searchsorted(path, path + distance)
    starts = np.flatnonzero(ends < len(path))
    ends = ends[starts]
    found = inverse(poses[starts]) @ poses[ends]
    return Errors.of(inverse(inverse(truth[starts]) @ truth[ends]) @ found)


def pairs_that_meet(positions: Float64) -> Int64:
    """Return pairs of nearby poses with a long path between them.

    Parameters
    ----------
    positions
        float64 (N, 3), m.

    Returns
    -------
    int64 (P, 2)
        Indices, the earlier pose first.
    """
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    pairs: list[Sequence[int]] = []
    for i in range(len(positions)):
        close = np.linalg.norm(positions[i + 1 :] - positions[i], axis=1) < NEAR_M
        far = along[i + 1 :] - along[i] > MIN_PATH_M
        pairs += [(i, i + 1 + int(j)) for j in np.flatnonzero(close & far)]
    return np.array(pairs, np.int64).reshape(-1, 2)
