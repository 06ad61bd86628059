"""Flat patches: blocks of adjacent beams in adjacent scans that are in one plane.

Whether a block is flat hardly depends on the rig's errors (a wrong tilt zero rotates it as a
whole), so patches are cut once and then transformed for any rig parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.calibrate.model import CycleBeams, RigModel, RigValues, beams_of, join_beams
from tccm_ros.calibrate.recording import CycleScans, evenly
from tccm_ros.geometry import inverse, transform

BEAMS, MIN_SIDE, MIN_HITS = 36, 3, 12
"""Beams of a block; minimum number of scans and of beams along its sides, and of hits (chosen: the
normal of a patch is then accurate to a degree)."""

MAX_THICKNESS, MAX_THICKNESS_RATIO = 0.025, 0.25
"""Maximum standard deviation of a flat patch along its normal, m, and maximum ratio to the patch's
width (chosen: three times the noise of the laser)."""

MIN_WIDTH_RATIO = 0.05
"""Minimum ratio of a patch's smaller width to its larger one (chosen)."""

HITS, MIN_KEPT, ALL_HITS = 20, 3, 16_000
"""Maximum and minimum number of hits kept per patch, and maximum of all patches together (chosen:
computing time)."""


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """P patches, each with a sample of its hits.

    Attributes
    ----------
    centers
        Centroids, as beams at the middle of the patch.
    normals
        float64 (P, 3), towards the laser, in its frame at that time.
    spread
        float64 (P,), standard deviation of the normal due to noise, rad.
    hits
        Sampled hits.
    patch
        int64 (N,), patch of each hit.
    """

    centers: CycleBeams
    normals: Float64
    spread: Float64
    hits: CycleBeams
    patch: Int64

    def __len__(self) -> int:
        return len(self.normals)


def cut_patches(cycles: Mapping[int, CycleScans], model: RigModel, values: RigValues) -> Patches:
    """Return the flat blocks of all tilt cycles.

    Parameters
    ----------
    cycles
        Scans by tilt cycle number, in order.
    model, values
        The rig under which patches are cut; it may be inaccurate.
    """
    beams = sum(int(np.isfinite(cycle.ranges).sum()) for cycle in cycles.values())
    max_hits = int(np.clip(ALL_HITS * BEAMS / max(beams, 1), MIN_KEPT, HITS))
    parts = [_cut(number, cycle, model, values, max_hits) for number, cycle in cycles.items()]
    firsts = np.cumsum([0, *(len(part) for part in parts)])
    return Patches(
        join_beams([part.centers for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.spread for part in parts]),
        join_beams([part.hits for part in parts]),
        np.concatenate([part.patch + first for part, first in zip(parts, firsts)]),
    )


def _cut(
    number: int, cycle: CycleScans, model: RigModel, values: RigValues, max_hits: int
) -> Patches:
    beams, columns = beams_of(number, cycle), np.nonzero(np.isfinite(cycle.ranges))[1]
    blocks = _blocks(beams, cycle, columns, model, values)
    order = np.argsort(blocks, kind="stable")
    kept, patch, size = _full(blocks[order])
    order, points_place = order[kept], model.transform_points(beams, values)[order[kept]]
    mean, normal, widths = _fit(points_place, patch, size)
    flat = (widths[:, 0] < MAX_THICKNESS) & (widths[:, 0] < MAX_THICKNESS_RATIO * widths[:, 1])
    flat &= widths[:, 1] > MIN_WIDTH_RATIO * widths[:, 2]
    middle = order[np.cumsum(size) - size + size // 2]
    centers = beams.take(middle)
    T_base_laser = model.T_base_laser(number, centers.stamps_ns, values)
    T_laser_place = inverse(centers.T_place_base @ T_base_laser)
    points = transform(T_laser_place, mean[:, None, :])[:, 0]
    normals = np.einsum("nij,nj->ni", T_laser_place[:, :3, :3], normal)
    normals *= -np.sign(np.sum(normals * points, axis=1, keepdims=True))
    centers = replace(centers, points=points)
    sample = _sample(size, flat, max_hits)
    by_time = np.argsort(beams.stamps_ns[order[sample]], kind="stable")
    new = np.cumsum(flat) - 1
    spread = widths[:, 0] / np.sqrt(size) / np.maximum(widths[:, 1], 1e-6)
    return Patches(
        centers.take(flat),
        normals[flat],
        spread[flat],
        beams.take(order[sample][by_time]),
        new[patch[sample]][by_time],
    )


def _blocks(
    beams: CycleBeams, cycle: CycleScans, columns: Int64, model: RigModel, values: RigValues
) -> Int64:
    """Return the block of each beam: square, in equal steps of tilt and bearing, or of pixels."""
    beams_per_line = cycle.ranges.shape[1]
    if cycle.is_image:
        side = round(np.sqrt(BEAMS))
        rows = np.nonzero(np.isfinite(cycle.ranges))[0]
        pixels: Int64 = rows // side * (beams_per_line // side + 1) + columns // side
        return pixels
    tilt = model.measured(beams, values)
    between_lines = float(np.ptp(tilt)) / max(len(cycle.ranges) - 1, 1)
    between_beams = float(np.linalg.norm(cycle.directions[0, 1] - cycle.directions[0, 0]))
    side = np.sqrt(BEAMS * between_lines * between_beams)
    high = max(side, MIN_SIDE * between_lines, 1e-6)
    wide = max(round(side / max(between_beams, 1e-9)), MIN_SIDE)
    up = np.floor((tilt - tilt.min()) / high).astype(np.int64)
    result: Int64 = up * (beams_per_line // wide + 1) + columns // wide
    return result


def _full(blocks: Int64) -> tuple[Bool, Int64, Int64]:
    """Return a mask of sorted entries in blocks with enough hits, their patches, and sizes."""
    _, index, counts = np.unique(blocks, return_inverse=True, return_counts=True)
    enough = counts >= MIN_HITS
    kept = enough[index]
    return kept, (np.cumsum(enough) - 1)[index[kept]], counts[enough]


def _fit(points: Float64, patch: Int64, size: Int64) -> tuple[Float64, Float64, Float64]:
    """Return means, normals (P, 3) and standard deviations (P, 3) along the axes, ascending."""
    n = len(size)
    mean = np.stack([np.bincount(patch, points[:, i], n) for i in range(3)], axis=1) / size[:, None]
    d = points - mean[patch]
    cov = np.empty((n, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            cov[:, i, j] = cov[:, j, i] = np.bincount(patch, d[:, i] * d[:, j], n) / size
    spread, axes = np.linalg.eigh(cov)
    return mean, axes[:, :, 0], np.sqrt(np.maximum(spread, 0.0))


def _sample(size: Int64, wanted: Bool, max_hits: int) -> Int64:
    """Return the rows of up to `max_hits` hits of each selected patch, evenly spaced."""
    firsts = np.cumsum(size) - size
    chosen = {count: evenly(count, max_hits) for count in np.unique(size[wanted]).tolist()}
    rows = [
        first + chosen[count]
        for first, count in zip(firsts[wanted].tolist(), size[wanted].tolist())
    ]
    return np.concatenate(rows) if rows else np.zeros(0, np.int64)
