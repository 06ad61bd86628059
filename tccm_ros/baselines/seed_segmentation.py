"""The published pipeline (surface mapping, IV.A): iterative RANSAC and Euclidean clustering.

A baseline, selected by ``surfaces.segmentation: seed``, that finds the surfaces of each tilt cycle
instead of the TCCM's planes. The largest plane of the cloud is found and its inliers are removed,
repeatedly. The inliers of roughly horizontal planes are clustered, and clusters with enough points
are surfaces. It ends when no plane has enough points. As published, it does not test from which
side a plane is seen.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.kernels import kernel
from tccm_ros.union_find import find_root, merge_sets

TRIALS = 600
"""Random planes per round: a plane with 1 % of the cloud's triples is found with 99.7 %."""

SAMPLE = 3000
"""Number of points for scoring a random plane; the best is refined on all points. Chosen."""

MAX_ROUNDS = 100
"""Maximum number of planes. Chosen."""

CELL_FRACTION = 0.577
"""Edge of a cell in cluster distances. Chosen: just below 1 / sqrt(3), so that all points of a cell
are within the distance."""

CELL_STEPS = 2
"""Number of cells to each side that may contain neighbours within the cluster distance: 1 /
`CELL_FRACTION`, rounded up."""

SEED = 20110509
"""Seed, which makes the result reproducible."""


def segment(points: Float64, config: Config) -> Int32:
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
    for round_number in range(MAX_ROUNDS):
        if len(rest) < max(rules.min_points, 3):
            break
        plane = _largest_plane(points[rest], rules.seed_distance, SEED + round_number)
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


@kernel
def _best_of(points: Float64, sample: Float64, triples: Int64, distance: float) -> Float64:
    """Return the plane through one of the triples (T, 3) with the most inliers in the sample."""
    best = np.array([0.0, 0.0, 1.0, 0.0])
    max_count = -1
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
        if count > max_count:
            max_count = count
            best[:3] = normal
            best[3] = offset
    return best


def cluster(points: Float64, distance: float) -> Int64:
    """Cluster points (N, 3) by single linkage with a distance of `distance` m.

    Returns
    -------
    int64 (N,)
        Cluster of each point, numbered in the order of their first points.
    """
    if len(points) == 0:
        return np.zeros(0, np.int64)
    # Any two points of such a cell are neighbours, so a cell has one cluster.
    cells = np.floor(points / (CELL_FRACTION * distance)).astype(np.int64)
    cells -= cells.min(axis=0)
    size = cells.max(axis=0) + 1 + 2 * CELL_STEPS
    cells += CELL_STEPS
    keys = (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]
    order = np.argsort(keys, kind="stable")
    known, starts = np.unique(keys[order], return_index=True)
    ends = np.append(starts[1:], len(points))
    steps = np.arange(-CELL_STEPS, CELL_STEPS + 1)
    x, y, z = (step.ravel() for step in np.meshgrid(steps, steps, steps, indexing="ij"))
    offsets = (x * size[1] + y) * size[2] + z
    roots = _merge_cells(points[order], known, starts, ends, offsets[offsets > 0], distance)
    of_point = np.empty(len(points), np.int64)
    of_point[order] = np.repeat(roots, ends - starts)
    _, first, label = np.unique(of_point, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[label]


@kernel
def _merge_cells(
    points: Float64, keys: Int64, starts: Int64, ends: Int64, offsets: Int64, distance: float
) -> Int32:
    """Merge cells (C,) that have neighbouring points; return the first cell of each cluster."""
    parent = np.arange(len(keys)).astype(np.int32)
    for a in range(len(keys)):
        for offset in offsets:
            b = np.searchsorted(keys, keys[a] + offset)
            if b == len(keys) or keys[b] != keys[a] + offset:
                continue
            if find_root(parent, a) != find_root(parent, b) and _touch(
                points, starts[a], ends[a], starts[b], ends[b], distance
            ):
                merge_sets(parent, a, b)
    for a in range(len(keys)):
        parent[a] = find_root(parent, a)
    return parent


@kernel
def _touch(points: Float64, a: int, a_end: int, b: int, b_end: int, distance: float) -> bool:
    """Return whether a point of rows [a, a_end) is within `distance` of one of [b, b_end)."""
    for i in range(a, a_end):
        for j in range(b, b_end):
            dx, dy, dz = (
                points[i, 0] - points[j, 0],
                points[i, 1] - points[j, 1],
                points[i, 2] - points[j, 2],
            )
            if dx * dx + dy * dy + dz * dz <= distance * distance:
                return True
    return False
