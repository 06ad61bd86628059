"""Compiled loops over the pixels of a depth image. Their numpy twins are in the tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from tccm_ros.kernels import kernel

BLOCK = 8
"""Pixels along the edge of a block, in which thinning is uniform: at most one pixel stays."""


@kernel
def read_depths(depth: Any, scale: Any, max_depth: Any, rays: Any, z: Any) -> None:
    """Write the depths of an image.

    Parameters
    ----------
    depth
        uint16 or float32 (H, W), as measured.
    scale
        float32, m of one unit.
    max_depth
        float32, m; there is no depth beyond.
    rays
        float32 (H, W, 2), directions of the pixels; nan where the lens shows nothing: no depth.
    z
        float32 (H, W), is written: m, 0 where there is no depth.
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            d = np.float32(depth[v, u]) * scale
            is_depth = 0.0 < d <= max_depth and rays[v, u, 0] == rays[v, u, 0]
            z[v, u] = d if is_depth else np.float32(0.0)


@kernel
def drop_edges(z: Any, step_u: Any, step_v: Any, slope: Any, noise: Any, usable: Any) -> None:
    """Mark the pixels with a depth that are on no edge, in both image directions.

    Two neighbours are on an edge where their depths differ by more than a surface at the smallest
    angle of sight (`slope`) and the noise explain: between a surface and its background lie mixed
    depths, which belong to neither.

    Parameters
    ----------
    z
        float32 (H, W), m, 0 = nothing.
    step_u, step_v
        Distance of neighbouring pixels at z = 1.
    slope
        Largest change of depth per distance across the line of sight.
    noise
        a, b and c of the noise a + b (z - c)^2, times how many of it are allowed.
    usable
        uint8 (H, W), written.
    """
    height, width = z.shape
    a, b, c = np.float32(noise[0]), np.float32(noise[1]), np.float32(noise[2])
    across, down = np.float32(slope * step_u), np.float32(slope * step_v)
    for v in range(height):
        for u in range(width):
            usable[v, u] = z[v, u] > 0.0
    for v in range(height):
        for u in range(width - 1):
            p, q = z[v, u], z[v, u + 1]
            near = min(p, q)
            jump = abs(p - q) > across * near + a + b * (near - c) * (near - c)
            if jump and near > 0.0:
                usable[v, u] = 0
                usable[v, u + 1] = 0
    for v in range(height - 1):
        for u in range(width):
            p, q = z[v, u], z[v + 1, u]
            near = min(p, q)
            jump = abs(p - q) > down * near + a + b * (near - c) * (near - c)
            if jump and near > 0.0:
                usable[v, u] = 0
                usable[v + 1, u] = 0


@kernel
def block_strides(z: Any, usable: Any, rays: Any, steps: Any, half: Any, strides: Any) -> Any:
    """Write which pixels of each block are enough, and return how many there are at most.

    The slope of the surface is that between the means of a block's halves, in which the noise of
    single pixels is gone. Every k-th column and row is enough where points at that distance on the
    surface are nearer than `half`; a block with less than half of its pixels, or on both sides of
    an edge, is not thinned.

    Parameters
    ----------
    z, usable, rays
        As of `place_pixels`.
    steps
        Distance of neighbouring columns and rows at z = 1.
    half
        Half of a cell, m.
    strides
        int8 (ceil(H / BLOCK), ceil(W / BLOCK), 2), written: of columns and rows.
    """
    height, width = z.shape
    bound, middle = 0, BLOCK // 2
    sums, counts = np.empty((2, 2)), np.empty((2, 2), np.int64)
    for b in range(strides.shape[0]):
        v0, v1 = b * BLOCK, min((b + 1) * BLOCK, height)
        for c in range(strides.shape[1]):
            u0, u1 = c * BLOCK, min((c + 1) * BLOCK, width)
            sums[:], counts[:] = 0.0, 0
            for v in range(v0, v1):
                low = np.int64(v - v0 >= middle)
                left_sum, right_sum = np.float32(0.0), np.float32(0.0)
                left, right = 0, 0
                for u in range(u0, min(u0 + middle, u1)):
                    left_sum += z[v, u] * usable[v, u]
                    left += usable[v, u]
                for u in range(min(u0 + middle, u1), u1):
                    right_sum += z[v, u] * usable[v, u]
                    right += usable[v, u]
                sums[low, 0] += left_sum
                sums[low, 1] += right_sum
                counts[low, 0] += left
                counts[low, 1] += right
            total = counts.sum()
            across, down = np.int64(1), np.int64(1)
            if 2 * total >= BLOCK * BLOCK and counts.min() > 0:
                mean = sums.sum() / total
                x = np.float64(rays[(v0 + v1) // 2, (u0 + u1) // 2, 0])
                y = np.float64(rays[(v0 + v1) // 2, (u0 + u1) // 2, 1])
                left_mean = sums[:, 0].sum() / counts[:, 0].sum()
                right_mean = sums[:, 1].sum() / counts[:, 1].sum()
                upper_mean = sums[0].sum() / counts[0].sum()
                lower_mean = sums[1].sum() / counts[1].sum()
                slope_u = (right_mean - left_mean) / middle
                slope_v = (lower_mean - upper_mean) / middle
                square_u = (mean * steps[0] + slope_u * x) ** 2 + slope_u**2 * (y * y + 1.0)
                square_v = (mean * steps[1] + slope_v * y) ** 2 + slope_v**2 * (x * x + 1.0)
                across = np.int64(min(max(half / np.sqrt(square_u), 1.0), 1.0 * BLOCK))
                down = np.int64(min(max(half / np.sqrt(square_v), 1.0), 1.0 * BLOCK))
            strides[b, c, 0], strides[b, c, 1] = across, down
            columns, rows = -(-(u1 - u0) // across), -(-(v1 - v0) // down)
            bound += min(columns * rows, total)
    return bound


@kernel
def _is_lone(usable: Any, v: Any, u: Any) -> Any:
    """Return whether a pixel has no neighbour along one of the image directions.

    A line of one pixel, as it is left of the front of a board, may be of any surface.
    """
    height, width = usable.shape
    beside = (u > 0 and usable[v, u - 1] != 0) or (u + 1 < width and usable[v, u + 1] != 0)
    above = (v > 0 and usable[v - 1, u] != 0) or (v + 1 < height and usable[v + 1, u] != 0)
    return not (beside and above)


@kernel
def place_pixels(
    z: Any, usable: Any, rays: Any, max_z: Any, strides: Any, T: Any, points: Any
) -> Any:
    """Write the points of the pixels that are enough, and return how many there are.

    Of each patch of a block's strides the first pixel that shows a surface stays.

    Parameters
    ----------
    z, usable
        float32 (H, W), m, and uint8 (H, W): where it is a surface.
    rays
        float32 (H, W, 2), x and y of the pixels' lines of sight at z = 1.
    max_z
        Depths beyond are not mapped, m.
    strides
        As of `block_strides`.
    T
        float64 (3, 4), pose of the optical frame in the frame of the points.
    points
        float64 (N, 3), written.
    """
    height, width = z.shape
    n = 0
    for b in range(strides.shape[0]):
        v0, v1 = b * BLOCK, min((b + 1) * BLOCK, height)
        for c in range(strides.shape[1]):
            u0, u1 = c * BLOCK, min((c + 1) * BLOCK, width)
            across, down = np.int64(strides[b, c, 0]), np.int64(strides[b, c, 1])
            for top in range(v0, v1, down):
                for left in range(u0, u1, across):
                    v, u = _first_usable(
                        z, usable, (top, min(top + down, v1)), (left, min(left + across, u1)), max_z
                    )
                    if v < 0:
                        continue
                    d = np.float64(z[v, u])
                    x, y = rays[v, u, 0] * d, rays[v, u, 1] * d
                    for i in range(3):
                        points[n, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * d + T[i, 3]
                    n += 1
    return n


@kernel
def _first_usable(z: Any, usable: Any, rows: Any, columns: Any, max_z: Any) -> Any:
    """Return row and column of the first pixel of a patch that can be mapped, -1 if none can."""
    for v in range(rows[0], rows[1]):
        for u in range(columns[0], columns[1]):
            if usable[v, u] != 0 and z[v, u] <= max_z and not _is_lone(usable, v, u):
                return v, u
    return -1, -1


@kernel
def sight_lines(
    z: Any, usable: Any, rays: Any, every: Any, max_z: Any, noise: Any, T: Any, ends: Any, hits: Any
) -> Any:
    """Write where the lines of sight of every so manieth pixel end, and return how many there are.

    A line ends on the surface, or before it where it is too noisy to be mapped.

    Parameters
    ----------
    z, usable, rays, T
        As of `place_pixels`.
    every
        Step between the pixels, along both axes.
    max_z
        Lines to surfaces beyond end before them, m,
    noise
        by this many sigmas: a, b and c of a + b (z - c)^2, m.
    ends, hits
        float64 (N, 3), and bool (N,): whether the line ended on a surface; written.
    """
    height, width = z.shape
    n = 0
    for v in range(every // 2, height, every):
        for u in range(every // 2, width, every):
            d = np.float64(z[v, u])
            if usable[v, u] == 0:
                continue
            hits[n] = d <= max_z
            if not hits[n]:
                d = max(d - noise[0] - noise[1] * (d - noise[2]) ** 2, max_z)
            x, y = rays[v, u, 0] * d, rays[v, u, 1] * d
            for i in range(3):
                ends[n, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * d + T[i, 3]
            n += 1
    return n
