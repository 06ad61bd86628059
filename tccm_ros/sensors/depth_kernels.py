"""Compiled loops over the pixels of a depth image. The tests contain a numpy reference.

An image is processed in bands of `BLOCK` rows that fit in the first-level cache; the only output of
the size of the image is its points. Operations on all pixels go row by row without branches, so
that the compiler can vectorise them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float32, Float64
from tccm_ros.kernels import kernel

BLOCK = 8
"""Edge of a block, pixels; thinning is uniform within a block and keeps at least one pixel."""

_HALF = BLOCK // 2
_NOTHING = np.float32(0.0)
_U0, _U1, _U2 = np.uint64(0), np.uint64(1), np.uint64(2)


class DepthLimits(NamedTuple):
    """Limits and density of the depths to use.

    Attributes
    ----------
    unit
        float32, unit of the image in m.
    max_depth
        float32, maximum valid depth, m.
    edges
        float32 (5,): maximum difference of neighbouring columns and rows per depth; a, b and c of
        the noise a + b (z - c)^2, m, multiplied by the allowed number of sigmas.
    max_z
        float32, maximum mapped depth, m.
    half
        Distance on a surface to which points are thinned, m.
    steps
        Distances between neighbouring columns and rows at z = 1.
    """

    unit: np.float32
    max_depth: np.float32
    edges: Float32
    max_z: np.float32
    half: float
    steps: tuple[float, float]


class SightLines(NamedTuple):
    """Selection of traced rays.

    Attributes
    ----------
    every
        Pixel step between rays along both axes; 0 for none.
    passed
        float64 (3,): a, b and c of a + b (z - c)^2, m; rays to surfaces beyond `DepthLimits.max_z`
        end that much before them.
    """

    every: int
    passed: Float64


@kernel
def place_image(
    depth: Any, rays: Any, limits: Any, sight: Any, T: Any, points: Any, ends: Any, hits: Any
) -> Any:
    """Write the points and rays of a depth image, and return the number of each.

    Two neighbours are on an edge if their depths differ by more than a surface and the noise
    explain: mixed depths between a surface and its background belong to neither. Pixels on edges
    and lines of single pixels are dropped. The others are thinned to `limits.half`: the first pixel
    of each patch is kept.

    Parameters
    ----------
    depth
        uint16 or float32 (H, W), raw depths.
    rays
        float32 (2, H, W), x and y of the pixels' rays at z = 1; NaN outside the lens model.
    limits, sight
        `DepthLimits` and `SightLines`.
    T
        float64 (3, 4), pose of the optical frame in the frame of the points.
    points
        float64 (H W, 3), m, written from the start.
    ends, hits
        float64 (L, 3), m, and bool (L,): end of each ray, and whether it is on a surface; written
        from the start.
    """
    height, width = depth.shape
    # Rows of the band plus the previous and the next row, with an empty column on each side.
    z = np.zeros((BLOCK + 2, width + 2), np.float32)
    mapped = np.zeros((BLOCK, width), np.bool_)
    this, below = np.empty(width, np.float32), np.empty(width, np.float32)
    above_edge, below_edge = np.zeros(width, np.bool_), np.zeros(width, np.bool_)
    beside_edge = np.zeros(width + 1, np.bool_)
    _read_row(depth[0], rays[0, 0], limits, this)
    n, lines, ready = _U0, _U0, 0
    for first in range(0, height, BLOCK):
        last = min(first + BLOCK, height)
        if first > 0:
            z[0], z[1] = z[BLOCK], z[BLOCK + 1]
        while ready < first + BLOCK + 1:
            row = z[ready - first + 1, 1 : width + 1]
            if ready < height:
                if ready + 1 < height:
                    _read_row(depth[ready + 1], rays[0, ready + 1], limits, below)
                    _mark_edges(this, below, limits.edges[1], limits.edges, below_edge)
                else:
                    below_edge[:] = False
                _mark_edges(
                    this[:-1], this[1:], limits.edges[0], limits.edges, beside_edge[1:width]
                )
                _keep_surfaces(this, (beside_edge[:-1], beside_edge[1:]), above_edge, row)
                _drop_marked(row, below_edge)
                above_edge, below_edge = below_edge, above_edge
                this, below = below, this
            else:
                row[:] = _NOTHING
            ready += 1
        for v in range(last - first):
            _mark_mapped(z[v], z[v + 1], z[v + 2], limits.max_z, mapped[v])
        n = _place_band(z, mapped, rays, (first, last), limits, T, points, n)
        if sight.every > 0:
            lines = _end_lines(z, rays, (first, last), limits.max_z, sight, T, ends, hits, lines)
    return np.int64(n), np.int64(lines)


@kernel
def _read_row(depth: Any, x: Any, limits: Any, row: Any) -> None:
    """Write the depths of a row, m; 0 for no depth."""
    unit, max_depth = limits.unit, limits.max_depth
    for u in range(len(row)):
        d = np.float32(depth[u]) * unit
        is_depth = (d > _NOTHING) & (d <= max_depth) & (x[u] == x[u])
        row[u] = d if is_depth else _NOTHING


@kernel
def _mark_edges(one: Any, other: Any, slope: Any, edges: Any, marks: Any) -> None:
    """Mark where two rows of depths differ by more than a surface and the noise explain."""
    a, b, c = edges[2], edges[3], edges[4]
    for u in range(len(marks)):
        p, q = one[u], other[u]
        near = p if p < q else q
        allowed = slope * near + a + b * (near - c) * (near - c)
        marks[u] = (abs(p - q) > allowed) & (near > _NOTHING)


@kernel
def _keep_surfaces(depths: Any, beside: Any, above: Any, row: Any) -> None:
    """Write the depths without an edge to the left, right or above; 0 for others."""
    left, right = beside
    for u in range(len(row)):
        row[u] = _NOTHING if left[u] | right[u] | above[u] else depths[u]


@kernel
def _drop_marked(row: Any, marks: Any) -> None:
    for u in range(len(row)):
        row[u] = _NOTHING if marks[u] else row[u]


@kernel
def _mark_mapped(above: Any, row: Any, below: Any, max_z: Any, mapped: Any) -> None:
    """Mark the depths up to `max_z` that have a neighbour along both image axes.

    A line of one pixel, such as the one left of a board's front, may belong to any surface.
    """
    for u in range(len(mapped)):
        d = row[u + 1]
        beside = (row[u] > _NOTHING) | (row[u + 2] > _NOTHING)
        over = (above[u + 1] > _NOTHING) | (below[u + 1] > _NOTHING)
        mapped[u] = (d > _NOTHING) & (d <= max_z) & beside & over


@kernel
def _sum_columns(z: Any, first: Any, sums: Any, counts: Any) -> None:
    """Write the sums and counts of depths of each column over `_HALF` rows of a band."""
    sums[:], counts[:] = _NOTHING, 0
    for v in range(first + 1, first + 1 + _HALF):
        for u in range(len(sums)):
            sums[u] += z[v, u + 1]
            counts[u] += z[v, u + 1] > _NOTHING


@kernel
def _place_band(
    z: Any, mapped: Any, rays: Any, rows: Any, limits: Any, T: Any, points: Any, n: Any
) -> Any:
    """Write the points of a band of rows after the first `n`; return the new count."""
    first, last = rows
    height, width = last - first, mapped.shape[1]
    xs, ys = rays[0, first:last], rays[1, first:last]
    upper, lower = np.empty(width, np.float32), np.empty(width, np.float32)
    n_upper, n_lower = np.empty(width, np.int32), np.empty(width, np.int32)
    if limits.half > 0.0:
        _sum_columns(z, 0, upper, n_upper)
        _sum_columns(z, _HALF, lower, n_lower)
    for left in range(0, width, BLOCK):
        right = min(left + BLOCK, width)
        across = down = np.int64(1)
        if limits.half > 0.0:
            ray = rays[:, (first + last) // 2, (left + right) // 2]
            halves = upper[left:right], lower[left:right]
            numbers = n_upper[left:right], n_lower[left:right]
            across, down = _strides(halves, numbers, ray, limits)
        for v0 in range(0, height, down):
            for u0 in range(left, right, across):
                v, u = np.uint64(v0), np.uint64(u0)
                if not mapped[v, u]:
                    v, u, found = _first_mapped(
                        mapped, v, min(v0 + down, height), u, min(u0 + across, right)
                    )
                    if not found:
                        continue
                d = np.float64(z[v + _U1, u + _U1])
                x, y = xs[v, u] * d, ys[v, u] * d
                points[n, _U0] = T[0, 0] * x + T[0, 1] * y + T[0, 2] * d + T[0, 3]
                points[n, _U1] = T[1, 0] * x + T[1, 1] * y + T[1, 2] * d + T[1, 3]
                points[n, _U2] = T[2, 0] * x + T[2, 1] * y + T[2, 2] * d + T[2, 3]
                n += _U1
    return n


@kernel
def _strides(halves: Any, numbers: Any, ray: Any, limits: Any) -> Any:
    """Return the column and row strides that thin a block.

    The slope of the surface is computed from the means of the block's halves, which average out
    pixel noise. A stride k is sufficient if every k-th pixels are closer than `limits.half` on the
    surface. A block with less than half of its pixels, or across an edge, is not thinned.
    """
    width = len(halves[0])
    middle = min(_HALF, width)
    s00 = s01 = s10 = s11 = 0.0
    n00 = n01 = n10 = n11 = np.int64(0)
    for u in range(middle):
        s00, n00 = s00 + halves[0][u], n00 + numbers[0][u]
        s10, n10 = s10 + halves[1][u], n10 + numbers[1][u]
    for u in range(middle, width):
        s01, n01 = s01 + halves[0][u], n01 + numbers[0][u]
        s11, n11 = s11 + halves[1][u], n11 + numbers[1][u]
    total = n00 + n01 + n10 + n11
    if 2 * total < BLOCK * BLOCK or min(min(n00, n01), min(n10, n11)) == 0:
        return np.int64(1), np.int64(1)
    mean = (s00 + s01 + s10 + s11) / total
    slope_u = ((s01 + s11) / (n01 + n11) - (s00 + s10) / (n00 + n10)) / _HALF
    slope_v = ((s10 + s11) / (n10 + n11) - (s00 + s01) / (n00 + n01)) / _HALF
    x, y = np.float64(ray[0]), np.float64(ray[1])
    square_u = (mean * limits.steps[0] + slope_u * x) ** 2 + slope_u**2 * (y * y + 1.0)
    square_v = (mean * limits.steps[1] + slope_v * y) ** 2 + slope_v**2 * (x * x + 1.0)
    across = np.int64(min(max(limits.half / np.sqrt(square_u), 1.0), 1.0 * BLOCK))
    down = np.int64(min(max(limits.half / np.sqrt(square_v), 1.0), 1.0 * BLOCK))
    return across, down


@kernel
def _first_mapped(mapped: Any, v0: Any, v1: Any, u0: Any, u1: Any) -> Any:
    """Return row and column of the first mapped pixel of a patch, and whether there is one."""
    for v in range(v0, np.uint64(v1)):
        for u in range(u0, np.uint64(u1)):
            if mapped[v, u]:
                return v, u, True
    return v0, u0, False


@kernel
def _end_lines(
    z: Any, rays: Any, rows: Any, max_z: Any, sight: Any, T: Any, ends: Any, hits: Any, n: Any
) -> Any:
    """Write the ends of a band's rays after the first `n`; return the new count.

    A ray ends on the surface, or before it where the surface is too noisy to map.
    """
    every, passed = sight.every, sight.passed
    first, last = rows
    width = z.shape[1] - 2
    for v in range(first, last):
        if v % every != every // 2:
            continue
        for u in range(every // 2, width, every):
            d = np.float64(z[v - first + 1, u + 1])
            if d == 0.0:
                continue
            hits[n] = d <= max_z
            if not hits[n]:
                d = max(d - passed[0] - passed[1] * (d - passed[2]) ** 2, np.float64(max_z))
            x, y = rays[0, v, u] * d, rays[1, v, u] * d
            for i in range(3):
                ends[n, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * d + T[i, 3]
            n += _U1
    return n
