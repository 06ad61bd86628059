"""Center cores, and the plane detector that the paper builds on them (IV.B, IV.C), as a baseline.

`planes.detector: center_cores` chooses it.

The center core of a cuboid is the long axis of the ellipsoid of its points. A trial draws a few
cores; if they lie in one plane, its inlier cores are collected and rated by Eq. (8). The best of 10
or 50 trials is the plane.

`find_core_planes` removes the cores of the best plane and continues until a plane of a tenth of the
remaining cores would have been drawn. In a whole room no plane has that many, so the detector needs
a region of interest (`map.region`), as in the paper. The cores of a plane are clustered by their
cells, so that two tables of one height are two planes.

The printed formulas are incomplete. The normals b of Eq. (6) are given a common sign before they
are averaged, pairs of parallel, aligned cores (b = 0) are skipped, and Eq. (8) is computed from the
ends and the middle of all inlier cores, in m2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.baselines.plane_fits import fits_of_groups
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.kernels import kernel
from tccm_ros.planes import PlaneFits

MIN_POINTS = 3
"""Minimum number of points of a center core. Chosen: the covariance of two points is a line."""

SOUGHT_FRACTION = 0.1
"""The search ends when a plane with this fraction of the remaining cores would have been found. A
table or a shelf's front has 0.2 to 0.8 of those of the paper's region (bench/plane_scenes.py)."""

CONFIDENCE = 0.99
"""Probability that a plane with `SOUGHT_FRACTION` of the cores has been drawn when the search ends;
the usual value of RANSAC."""


@dataclass(frozen=True, slots=True, eq=False)
class CenterCores:
    """The long axes of cuboids.

    Attributes
    ----------
    cuboid
        int64 (K,), index of each core's cuboid.
    center
        float64 (K, 3), mean of its points, m.
    axis
        float64 (K, 3), unit direction; the largest component is positive.
    length
        float64 (K,), standard deviation along the axis, m.
    """

    cuboid: Int64
    center: Float64
    axis: Float64
    length: Float64

    def __len__(self) -> int:
        return len(self.cuboid)

    def select(self, rows: Int64) -> CenterCores:
        """Return some of the cores, rows int64 (M,)."""
        return CenterCores(self.cuboid[rows], self.center[rows], self.axis[rows], self.length[rows])

    def ends(self) -> Float64:
        """Return both ends of each core, two standard deviations out, float64 (K, 2, 3), m."""
        offsets = (2.0 * self.length)[:, None] * self.axis
        return np.stack([self.center - offsets, self.center + offsets], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class CorePlane:
    """A plane found from center cores.

    Attributes
    ----------
    normal, offset
        Unit normal float64 (3,) and offset, ``normal . p = offset``, m.
    cores
        int64 (M,), indices of the cores that belong to it.
    quality
        Val of Eq. (8), m2.
    """

    normal: Float64
    offset: float
    cores: Int64
    quality: float


def center_cores(cuboids: Cuboids, min_length: float = 0.0) -> CenterCores:
    """Return the center cores of a map.

    Parameters
    ----------
    cuboids
        The map.
    min_length
        Minimum length, m (standard deviation along the axis).
    """
    chosen = np.flatnonzero(cuboids.count >= MIN_POINTS)
    xx, xy, xz, yy, yz, zz = cuboids.cov()[chosen].T
    matrices = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(matrices)
    axis, length = vectors[:, :, 2], np.sqrt(np.maximum(values[:, 2], 0.0))
    largest = np.take_along_axis(axis, np.abs(axis).argmax(axis=1)[:, None], axis=1)
    axis = axis * np.where(largest < 0.0, -1.0, 1.0)
    keep = length > min_length
    return CenterCores(chosen[keep], cuboids.mean()[chosen[keep]], axis[keep], length[keep])


def find_core_planes(cuboids: Cuboids, config: Config, viewpoint: ArrayLike) -> PlaneFits:
    """Find the planes of a map by center cores, in order of falling val.

    The paper finds several planes in one map (Fig. 12) but does not describe how; here the cores of
    a plane are removed before the search for the next. The search ends after `max_missed_rounds`
    rounds of `center_core.trials` without a plane. The cuboids of a plane are those of its cores.

    Parameters
    ----------
    cuboids, config, viewpoint
        As in `find_planes`, which it replaces; also uses the group `center_core`.
    """
    cores = center_cores(cuboids, config.center_core.min_length)
    rest = np.arange(len(cores))
    groups = []
    seed = missed = 0
    while missed < max_missed_rounds(config):
        plane = find_core_plane(cores.select(rest), config, seed=seed)
        seed += 1
        if plane is None:
            missed += 1
            continue
        missed = 0
        members = rest[plane.cores]
        clusters = cluster_by_cell(cuboids, cores.cuboid[members], config)
        groups += [(cluster, plane.normal, plane.offset) for cluster in clusters]
        rest = np.setdiff1d(rest, members, assume_unique=True)
    return fits_of_groups(cuboids, groups, config, viewpoint)


def max_missed_rounds(config: Config) -> int:
    """Return the number of rounds of trials without a plane after which the search ends.

    All l cores of a trial are of a plane with probability f^l, where f is its fraction of the
    cores.

    Parameters
    ----------
    config
        Uses `center_core.cores` (l) and `center_core.trials`.
    """
    drawn = SOUGHT_FRACTION**config.center_core.cores
    trials = math.log(1.0 - CONFIDENCE) / math.log1p(-drawn)
    return math.ceil(trials / config.center_core.trials)


def cluster_by_cell(cuboids: Cuboids, members: Int64, config: Config) -> list[Int64]:
    """Cluster the cuboids of a plane (IV.C) by the distances of their cells.

    Parameters
    ----------
    cuboids
        The map.
    members
        int64 (M,), rows of the cuboids whose cores are inliers of the plane.
    config
        Uses `center_core.cluster_distance`, between the centres of two cells.

    Returns
    -------
    list of int64 (K,)
        Rows of each cluster, in the order of their first cuboid.
    """
    cells = np.stack([cuboids.ix[members], cuboids.iy[members]], axis=1).astype(float)
    max_cells = config.center_core.cluster_distance / cuboids.cell_size
    pairs = cKDTree(cells).query_pairs(max_cells, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(members), len(members)))
    count, cluster = connected_components(links, directed=False)
    return [members[cluster == k] for k in range(count)]


def find_core_plane(
    cores: CenterCores, config: Config, trials: int | None = None, seed: int = 0
) -> CorePlane | None:
    """Find the best plane by random trials (IV.C).

    Parameters
    ----------
    cores
        Cores of one map.
    config
        Group `center_core`: cores drawn in a trial, thresholds, trials, minimum quality.
    trials
        Replaces `center_core.trials`.
    seed
        Seed of the random draws; the same seed gives the same plane.

    Returns
    -------
    CorePlane or None
        None if no trial has at least `center_core.min_quality`.
    """
    c = config.center_core
    count = c.trials if trials is None else trials
    if len(cores) < c.cores:
        return None
    draws = np.random.default_rng(seed).random((count, c.cores))
    best = _best_trial(
        cores.center, cores.axis, cores.length, draws, c.angle_threshold, c.distance_threshold
    )
    normal, offset, quality = best[:3], float(best[3]), float(best[4])
    if quality == 0.0 or quality < c.min_quality:
        return None
    belongs = _belongs(cores.center, cores.axis, best, c.angle_threshold, c.distance_threshold)
    return CorePlane(normal, offset, np.flatnonzero(belongs), quality)


@kernel
def _best_trial(
    center: Float64, axis: Float64, length: Float64, draws: Float64, angle: float, distance: float
) -> Float64:
    """Return normal, offset and val of the best trial, float64 (5,); val 0 if there is none."""
    best = np.zeros(5)
    plane = np.zeros(5)
    chosen = np.empty(draws.shape[1], np.int64)
    for trial in range(len(draws)):
        for k in range(len(chosen)):
            chosen[k] = int(draws[trial, k] * len(center))
        if not _common_plane(center, axis, length, chosen, angle, plane):
            continue
        plane[4] = _quality(center, axis, length, plane, angle, distance)
        if plane[4] > best[4]:
            best[:] = plane
    return best


@kernel
def _common_plane(
    center: Float64, axis: Float64, length: Float64, chosen: Int64, angle: float, plane: Float64
) -> bool:
    """Write the plane of a few cores by Eq. (6) and (7); return whether there is one."""
    count = len(chosen)
    total = np.zeros(3)
    first = np.zeros(3)
    normals = np.empty((count * (count - 1), 3))
    used = 0
    for i in range(count):
        for j in range(count):
            a = center[chosen[i]] - center[chosen[j]]
            size = math.sqrt(a @ a)
            if i == j or size < 1e-6:
                continue
            b = np.cross(axis[chosen[j]], a)
            norm = math.sqrt(b @ b)
            if norm < 1e-3 * size:
                continue
            b /= norm
            if used == 0:
                first[:] = b
            elif b @ first < 0.0:
                b = -b
            normals[used] = b
            total += b
            used += 1
    if used < 2:
        return False
    min_cosine = math.cos(angle)
    for i in range(used):
        for j in range(i):
            if abs(normals[i] @ normals[j]) < min_cosine:
                return False
    norm = math.sqrt(total @ total)
    if norm < 1e-9:
        return False
    longest = chosen[np.argmax(length[chosen])]
    plane[:3] = total / norm
    plane[3] = plane[:3] @ center[longest]
    return True


@kernel
def _belongs(center: Float64, axis: Float64, plane: Float64, angle: float, distance: float) -> Bool:
    """Return which cores are inliers of a plane: parallel to it, and near it."""
    max_sine = math.sin(angle)
    result = np.empty(len(center), np.bool_)
    for k in range(len(center)):
        across = axis[k, 0] * plane[0] + axis[k, 1] * plane[1] + axis[k, 2] * plane[2]
        off = center[k, 0] * plane[0] + center[k, 1] * plane[1] + center[k, 2] * plane[2]
        result[k] = abs(across) < max_sine and abs(off - plane[3]) < distance
    return result


@kernel
def _quality(
    center: Float64, axis: Float64, length: Float64, plane: Float64, angle: float, distance: float
) -> float:
    """Return val of Eq. (8) over the inlier cores: l1 l2 / l3 of their covariance, m2.

    A core counts with its spread along its axis, as its points would.
    """
    belongs = _belongs(center, axis, plane, angle, distance)
    n = 0
    total = np.zeros(3)
    second = np.zeros((3, 3))
    for k in range(len(center)):
        if belongs[k]:
            n += 1
            for i in range(3):
                total[i] += center[k, i]
                for j in range(3):
                    spread = length[k] * length[k] * axis[k, i] * axis[k, j]
                    second[i, j] += center[k, i] * center[k, j] + spread
    if n < 3:
        return 0.0
    mean = total / n
    for i in range(3):
        for j in range(3):
            second[i, j] = second[i, j] / n - mean[i] * mean[j]
    values = np.linalg.eigvalsh(second)
    # No set of cores can be known to be flatter than the quantisation of 0.1 mm (1e-9 m2).
    return values[2] * values[1] / max(values[0], 1e-9)
