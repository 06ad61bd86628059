"""A local map for matching: points with normals from several scans, in a bucket grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.slam.point_sets import extent_near_median, place_scans
from tccm_ros.slam.seen_through import passes_and_hits
from tccm_ros.slam.surface_normals import BUCKET, fit_missing_normals, mean_normals

__all__ = ["BUCKET", "LineMap", "make_line_map"]

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

SPACING = 0.05
"""A point nearer than this (m) to one that is there already, and facing its way, adds nothing."""

ALONG, ACROSS, ALIKE = 0.15, 0.04, 0.9
"""Points of two scans show one surface where they are this near along it and across it (m) and
their normals agree (cosine); without normals, where they are as near as it is across."""

MAX_SIDE = 4096
"""Buckets along a side, at most: points beyond belong to no room and are dropped."""


class LineMap(NamedTuple):
    """Points and normals, float64 (N, 2), sorted into buckets; compiled code takes it as it is.

    Attributes
    ----------
    points, normals
        In the map's own frame; the normal is zero where the surroundings are not flat.
    origin
        float64 (2,), lower corner of the bucket grid.
    starts
        int32 (rows, columns, 2): first point of each bucket and the one past its last.
    confirmed
        bool (N,), whether another scan saw a surface there, too: one that moves along with the
        robot is elsewhere in each scan.
    variances
        float64 (N,), of the normals' directions, rad^2; zero without a normal.
    """

    points: Float64
    normals: Float64
    origin: Float64
    starts: Int32
    confirmed: NDArray[np.bool_]
    variances: Float64


def make_line_map(
    poses: Float64, points: list[Float64], normals: list[Float64], origins: list[Float64]
) -> LineMap:
    """Put scans into one map; the first scan to see a place defines it, all tell its normal.

    What more scans saw through than saw has moved, and is not in the map.

    Parameters
    ----------
    poses
        float64 (K, 3), the scans' planar poses in the map's frame.
    points, normals
        K arrays float64 (N_k, 2) in the scans' frames.
    origins
        K arrays float64 (2,), the laser in the scans' frames.
    """
    counts = np.array([len(q) for q in points])
    p, n = place_scans(poses, counts, np.concatenate(points), np.concatenate(normals))
    if not len(p):
        nothing = np.zeros(0)
        return LineMap(
            p, n, np.zeros(2), np.zeros((1, 1, 2), np.int32), nothing.astype(bool), nothing
        )
    near, low, high = extent_near_median(p, 0.5 * MAX_SIDE * BUCKET - BUCKET)
    scan = np.repeat(np.arange(len(counts)), counts)[near]
    p, n = p[near], n[near]
    origin = low - 1.5 * BUCKET
    shape = ((high - origin) / BUCKET).astype(np.int64) + 3
    owner = _thin(p, n, origin, shape)
    stay = np.flatnonzero(owner == np.arange(len(p)))
    lasers, _ = place_scans(poses, np.ones_like(counts), np.stack(origins), np.zeros_like(poses))
    passes, hits = passes_and_hits(p[stay], lasers, np.bincount(scan, minlength=len(counts)), p)
    stay = stay[passes <= hits]
    order, starts = _sort_into_buckets(p[stay], origin, shape)
    kept = stay[order]
    mean, variances = mean_normals(n, owner)
    at, mean, variances = p[kept], mean[kept], variances[kept]
    fit_missing_normals(at, mean, variances, lasers[scan[kept]], origin, starts, p)
    confirmed = _confirmed(at, mean, scan[kept], origin, starts, p, n, scan)
    return LineMap(at, mean, origin, starts, confirmed, variances)


@njit(nogil=True, cache=True)
def _thin(
    points: Float64, normals: Float64, origin: Float64, shape: NDArray[np.int64]
) -> NDArray[np.int64]:  # pragma: no cover - compiled
    """Return for each point the earlier one within SPACING that faces its way, or itself."""
    heads = np.full((shape[0], shape[1]), -1, np.int32)
    links = np.full(len(points), -1, np.int32)
    owner = np.arange(len(points))
    for i in range(len(points)):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        found = False
        for gx in range(int((x - SPACING) / BUCKET), int((x + SPACING) / BUCKET) + 1):
            for gy in range(int((y - SPACING) / BUCKET), int((y + SPACING) / BUCKET) + 1):
                j = heads[gx, gy]
                while j >= 0 and not found:
                    dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                    if dx * dx + dy * dy < SPACING * SPACING:
                        dot = normals[j, 0] * normals[i, 0] + normals[j, 1] * normals[i, 1]
                        plain = normals[i, 0] == 0.0 and normals[i, 1] == 0.0
                        found = dot > 0.5 or plain
                        if found:
                            owner[i] = j
                    j = links[j]
        if not found:
            cx, cy = int(x / BUCKET), int(y / BUCKET)
            links[i], heads[cx, cy] = heads[cx, cy], i
    return owner


@njit(nogil=True, cache=True)
def _sort_into_buckets(
    points: Float64, origin: Float64, shape: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Int32]:  # pragma: no cover - compiled
    """Counting sort by bucket: the points' new order, and each bucket's first and last.

    The order within a bucket stays.
    """
    starts = np.zeros((shape[0], shape[1], 2), np.int32)
    cells = np.empty((len(points), 2), np.int32)
    for i in range(len(points)):
        cells[i, 0] = int((points[i, 0] - origin[0]) / BUCKET)
        cells[i, 1] = int((points[i, 1] - origin[1]) / BUCKET)
        starts[cells[i, 0], cells[i, 1], 1] += 1
    total = 0
    for x in range(shape[0]):
        for y in range(shape[1]):
            n = starts[x, y, 1]
            starts[x, y, 0] = starts[x, y, 1] = total
            total += n
    order = np.empty(len(points), np.int64)
    for i in range(len(points)):
        k = starts[cells[i, 0], cells[i, 1], 1]
        order[k] = i
        starts[cells[i, 0], cells[i, 1], 1] = k + 1
    return order, starts


@njit(nogil=True, cache=True)
def _confirmed(
    points: Float64,
    normals: Float64,
    scan: NDArray[np.int64],
    origin: Float64,
    starts: Int32,
    all_points: Float64,
    all_normals: Float64,
    all_scan: NDArray[np.int64],
) -> NDArray[np.bool_]:  # pragma: no cover - compiled
    """Mark the points of a map whose surface another scan saw within ALONG and ACROSS."""
    confirmed = np.zeros(len(points), np.bool_)
    for i in range(len(all_points)):
        x, y = all_points[i, 0] - origin[0], all_points[i, 1] - origin[1]
        nx, ny = all_normals[i, 0], all_normals[i, 1]
        for gx in range(int((x - ALONG) / BUCKET), int((x + ALONG) / BUCKET) + 1):
            for gy in range(int((y - ALONG) / BUCKET), int((y + ALONG) / BUCKET) + 1):
                for j in range(starts[gx, gy, 0], starts[gx, gy, 1]):
                    if confirmed[j] or scan[j] == all_scan[i]:
                        continue
                    dx, dy = points[j, 0] - all_points[i, 0], points[j, 1] - all_points[i, 1]
                    distance2 = dx * dx + dy * dy
                    dot = normals[j, 0] * nx + normals[j, 1] * ny
                    if dot > ALIKE:
                        away = nx * dx + ny * dy
                        confirmed[j] = distance2 < ALONG * ALONG and abs(away) < ACROSS
                    else:
                        confirmed[j] = distance2 < ACROSS * ACROSS
    return confirmed
