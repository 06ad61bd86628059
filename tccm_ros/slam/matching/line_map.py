"""A local map for matching: points with normals from several scans, in a bucket grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.slam.matching.buckets import BUCKET, Buckets, extent_near_median, sort_into_buckets
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.matching.surface_normals import fit_missing_normals, mean_normals
from tccm_ros.slam.matching.visibility import passes_and_hits
from tccm_ros.slam.se2 import transform_scans

SPACING = 0.05
"""Minimum distance (m) between points of the map with the same orientation (chosen)."""

ALONG, ACROSS, ALIKE = 0.15, 0.04, 0.9
"""Points of two scans are on one surface within these distances along and across it (m), if the
cosine between their normals exceeds the last; without normals, within the distance across
(chosen)."""

SAME_SIDE = 0.5
"""Minimum cosine between normals of points with the same orientation (chosen)."""

MAX_SIDE = 4096
"""Maximum number of buckets along a side; points beyond are dropped as outliers. Chosen."""

BORDER = 1.5
"""Empty border around the points, in buckets. Chosen: more than any search radius over a bucket."""


class LineMap(NamedTuple):
    """A local map: points with normals, float64 (N, 2), sorted into buckets (for compiled code).

    Attributes
    ----------
    points, normals
        In the map's own frame; the normal is zero where the neighbourhood is not flat.
    buckets
        Ranges of points per bucket.
    confirmed
        bool (N,), whether another scan observed the same surface: a person who walks along with the
        robot is at another place in each scan.
    variances
        float64 (N,), variances of the normals' directions, rad^2; zero without a normal.
    """

    points: Float64
    normals: Float64
    buckets: Buckets
    confirmed: Bool
    variances: Float64


class _Seen(NamedTuple):
    """Points and normals, float64 (N, 2), and the index of their scan, int64 (N,)."""

    points: Float64
    normals: Float64
    scan: Int64


def make_line_map(poses: Float64, scans: Sequence[LevelScan]) -> LineMap:
    """Return a map of several scans.

    Each point is from the first scan that observed it; its normal is the mean over all scans.
    Points that more scans see through than hit have moved, and are removed.

    Parameters
    ----------
    poses
        float64 (K, 3), the scans' planar poses in the map's frame.
    scans
        The K scans.
    """
    counts = np.array([len(scan.points) for scan in scans])
    p, n = transform_scans(
        poses,
        counts,
        np.concatenate([scan.points for scan in scans]),
        np.concatenate([scan.normals for scan in scans]),
    )
    if not len(p):
        buckets = Buckets(np.zeros(2), np.zeros((1, 1, 2), np.int32))
        return LineMap(p, n, buckets, np.zeros(0, bool), np.zeros(0))
    near, low, high = extent_near_median(p, 0.5 * MAX_SIDE * BUCKET - BUCKET)
    seen = _Seen(p[near], n[near], np.repeat(np.arange(len(counts)), counts)[near])
    origin = low - BORDER * BUCKET
    shape = ((high - origin) / BUCKET).astype(np.int64) + 3
    owner = _thin(seen.points, seen.normals, origin, shape)
    stay = np.flatnonzero(owner == np.arange(len(owner)))
    lasers, _ = transform_scans(
        poses, np.ones_like(counts), np.stack([s.origin for s in scans]), np.zeros_like(poses)
    )
    ends = np.bincount(seen.scan, minlength=len(counts))
    passes, hits = passes_and_hits(seen.points[stay], lasers, ends, seen.points)
    stay = stay[passes <= hits]
    order, starts = sort_into_buckets(seen.points[stay], origin, shape)
    kept, buckets = stay[order], Buckets(origin, starts)
    mean, variances = mean_normals(seen.normals, owner)
    mapped = _Seen(seen.points[kept], mean[kept], seen.scan[kept])
    variances = variances[kept]
    fit_missing_normals(
        mapped.points, mapped.normals, variances, lasers[mapped.scan], buckets, seen.points
    )
    confirmed = _confirmed(mapped, buckets, seen)
    return LineMap(mapped.points, mapped.normals, buckets, confirmed, variances)


@kernel
def _thin(points: Float64, normals: Float64, origin: Float64, shape: Int64) -> Int64:
    """Return for each point an earlier one within SPACING with the same orientation, or itself."""
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
                        found = dot > SAME_SIDE or plain
                        if found:
                            owner[i] = j
                    j = links[j]
        if not found:
            cx, cy = int(x / BUCKET), int(y / BUCKET)
            links[i], heads[cx, cy] = heads[cx, cy], i
    return owner


@kernel
def _confirmed(mapped: _Seen, buckets: Buckets, seen: _Seen) -> Bool:
    """Mark the map points whose surface another scan observed within ALONG and ACROSS."""
    confirmed, starts = np.zeros(len(mapped.points), np.bool_), buckets.starts
    for i in range(len(seen.points)):
        px, py = seen.points[i, 0], seen.points[i, 1]
        nx, ny = seen.normals[i, 0], seen.normals[i, 1]
        x, y = px - buckets.origin[0], py - buckets.origin[1]
        for gx in range(int((x - ALONG) / BUCKET), int((x + ALONG) / BUCKET) + 1):
            for gy in range(int((y - ALONG) / BUCKET), int((y + ALONG) / BUCKET) + 1):
                for j in range(starts[gx, gy, 0], starts[gx, gy, 1]):
                    if confirmed[j] or mapped.scan[j] == seen.scan[i]:
                        continue
                    dx, dy = mapped.points[j, 0] - px, mapped.points[j, 1] - py
                    distance2 = dx * dx + dy * dy
                    dot = mapped.normals[j, 0] * nx + mapped.normals[j, 1] * ny
                    if dot > ALIKE:
                        away = nx * dx + ny * dy
                        confirmed[j] = distance2 < ALONG * ALONG and abs(away) < ACROSS
                    else:
                        confirmed[j] = distance2 < ACROSS * ACROSS
    return confirmed
