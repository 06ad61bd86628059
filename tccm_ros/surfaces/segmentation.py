"""The published pipeline (surface mapping, IV.A): iterative RANSAC and Euclidean clustering.

A baseline, selected by ``surfaces.segmentation: seed``. The largest plane of the cloud is found
and taken out again and again; the inliers of roughly horizontal ones are clustered, clusters with
enough points are surfaces. It ends when no plane has enough points.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.records import SurfaceCloud

__all__ = ["cluster", "seed_cloud", "segment"]

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

TRIALS = 600
"""Random planes a round: finds one with 1 % of the cloud's triples in it with 99.7 %."""

SAMPLE = 3000
"""Points that a random plane is scored on; the winner is refined on all points."""

MAX_ROUNDS = 100
"""Planes that are looked for at most."""

SEED = 20110509
"""The same cloud gives the same surfaces."""


def segment(points: Float64, config: Config) -> NDArray[np.int32]:
    """Segment the horizontal surfaces of a cloud.

    Parameters
    ----------
    points
        float64 (N, 3), m, in a frame whose z points up (the base frame).
    config
        Uses `surfaces.min_points`, `surfaces.cluster_distance`, `surfaces.seed_distance` and
        `planes.horizontal_angle`.

    Returns
    -------
    int32 (N,)
        Surface of each point, counted from 0 in the order found; -1 = none.
    """
    rules = config.surfaces
    labels = np.full(len(points), -1, np.int32)
    rest = np.arange(len(points))
    found = 0
    for turn in range(MAX_ROUNDS):
        if len(rest) < max(rules.min_points, 3):
            break
        plane = _largest_plane(points[rest], rules.seed_distance, SEED + turn)
        inliers = np.abs(points[rest] @ plane[:3] - plane[3]) <= rules.seed_distance
        if inliers.sum() < rules.min_points:
            break
        if abs(plane[2]) >= np.cos(config.planes.horizontal_angle):
            groups = cluster(points[rest[inliers]], rules.cluster_distance)
            for group in np.flatnonzero(np.bincount(groups) >= rules.min_points):
                labels[rest[inliers][groups == group]] = found
                found += 1
        rest = rest[~inliers]
    return labels


def _largest_plane(points: Float64, distance: float, seed: int) -> Float64:
    """Return the plane (normal, offset) float64 (4,) with the most inliers, refitted to them."""
    rng = np.random.default_rng(seed)
    triples = rng.integers(0, len(points), (TRIALS, 3))
    sample = points[rng.integers(0, len(points), min(SAMPLE, len(points)))]
    plane = _best_of(points, sample, triples, distance)
    for _ in range(3):
        near = points[np.abs(points @ plane[:3] - plane[3]) <= distance]
        if len(near) < 3:
            break
        mean = near.mean(axis=0)
        normal = np.linalg.eigh((near - mean).T @ (near - mean))[1][:, 0]
        plane = np.array([*normal, normal @ mean])
    return plane


@njit(nogil=True, cache=True)
def _best_of(points: Float64, sample: Float64, triples: Int64, distance: float) -> Float64:
    """Return the plane through one of the triples (T, 3) that most of the sample lies on."""
    best = np.array([0.0, 0.0, 1.0, 0.0])
    most = -1
    for t in range(len(triples)):
        a, b, c = points[triples[t, 0]], points[triples[t, 1]], points[triples[t, 2]]
        normal = np.cross(b - a, c - a)
        length = np.sqrt(normal @ normal)
        if length < 1e-9:
            continue
        normal /= length
        offset = normal @ a
        count = 0
        for i in range(len(sample)):
            p = sample[i]
            if abs(normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2] - offset) <= distance:
                count += 1
        if count > most:
            most = count
            best[:3] = normal
            best[3] = offset
    return best


def cluster(points: Float64, distance: float) -> Int64:
    """Cluster points (N, 3): neighbours within `distance` m belong together.

    Returns
    -------
    int64 (N,)
        Cluster of each point, counted in the order of their first points.
    """
    if len(points) == 0:
        return np.zeros(0, np.int64)
    cells = np.floor(points / distance).astype(np.int64)
    cells -= cells.min(axis=0)
    size = cells.max(axis=0) + 3
    keys = ((cells[:, 0] + 1) * size[1] + cells[:, 1] + 1) * size[2] + cells[:, 2] + 1
    order = np.argsort(keys, kind="stable")
    return _flood(points, keys[order], order, size, distance)


@njit(nogil=True, cache=True)
def _flood(points: Float64, keys: Int64, order: Int64, size: Int64, distance: float) -> Int64:
    """Grow clusters; `keys` are the sorted cells and `order` the points in them."""
    cell_of = np.empty(len(points), np.int64)
    cell_of[order] = keys
    label = np.full(len(points), -1, np.int64)
    stack = np.empty(len(points), np.int64)
    found = 0
    for seed in range(len(points)):
        if label[seed] >= 0:
            continue
        label[seed] = found
        stack[0] = seed
        depth = 1
        while depth > 0:
            depth -= 1
            i = stack[depth]
            for dx in range(-1, 2):
                for dy in range(-1, 2):
                    first = cell_of[i] + (dx * size[1] + dy) * size[2] - 1
                    for k in range(np.searchsorted(keys, first), len(keys)):
                        if keys[k] > first + 2:
                            break
                        j = order[k]
                        if label[j] < 0:
                            d = points[i] - points[j]
                            if d @ d <= distance * distance:
                                label[j] = found
                                stack[depth] = j
                                depth += 1
        found += 1
    return label


def seed_cloud(points: Float64, stamp_ns: int, frame_id: str, config: Config) -> SurfaceCloud:
    """Return the hand-over of a cycle by the published pipeline instead of the TCCM's planes.

    Parameters
    ----------
    points
        float64 (N, 3), m: all points of the part map in the base frame of `stamp_ns`.
    stamp_ns, frame_id
        Of the cycle.
    config
        As in `segment`.
    """
    labels = segment(points, config)
    kept = labels >= 0
    return SurfaceCloud(
        stamp_ns, frame_id, points[kept].astype(np.float32), labels[kept].astype(np.uint32)
    )
