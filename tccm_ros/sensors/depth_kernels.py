"""Compiled loops over the pixels of a depth image. Their numpy twins are in the tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

TOP_LEVEL = 4
"""Images are thinned to every 2^4th pixel at most."""


@njit(nogil=True, cache=True)
def read_depths(depth: Any, scale: Any, max_depth: Any, rays: Any, z: Any) -> None:
    """Write the depths in m, float32 (H, W), 0 where there is none.

    There is none beyond `max_depth`, and where the lens shows nothing: `rays` are nan.
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            d = np.float32(depth[v, u]) * scale
            is_depth = 0.0 < d <= max_depth and rays[v, u, 0] == rays[v, u, 0]
            z[v, u] = d if is_depth else np.float32(0.0)


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
def _is_needless(
    z: Any, usable: Any, rays: Any, va: Any, ua: Any, vb: Any, ub: Any, half: Any
) -> Any:
    """Return whether what two pixels see is so near to each other that none is needed between."""
    if usable[va, ua] == 0 or usable[vb, ub] == 0:
        return False
    p, q = z[va, ua], z[vb, ub]
    dx = rays[va, ua, 0] * p - rays[vb, ub, 0] * q
    dy = rays[va, ua, 1] * p - rays[vb, ub, 1] * q
    return dx * dx + dy * dy + (p - q) * (p - q) < half * half


@njit(nogil=True, cache=True)
def _is_lone(usable: Any, v: Any, u: Any) -> Any:
    """Return whether a pixel has no neighbour along one of the image directions.

    A line of one pixel, as it is left of the front of a board, may be of any surface.
    """
    height, width = usable.shape
    beside = (u > 0 and usable[v, u - 1] != 0) or (u + 1 < width and usable[v, u + 1] != 0)
    above = (v > 0 and usable[v - 1, u] != 0) or (v + 1 < height and usable[v + 1, u] != 0)
    return not (beside and above)


@njit(nogil=True, cache=True)
def place_pixels(z: Any, usable: Any, rays: Any, max_z: Any, half: Any, T: Any, points: Any) -> Any:
    """Write the points of the pixels that are needed, and return how many there are.

    Columns and rows are thinned each, by halves: a column that 2^k divides, and no more, is left
    out at a pixel where those 2^k to either side see points nearer than `half` to each other. So
    what stays has nowhere more than `half` between, and nothing is left out where it would be.

    Parameters
    ----------
    z, usable
        float32 (H, W), m, and uint8 (H, W): where it is a surface.
    rays
        float32 (H, W, 2), x and y of the pixels' lines of sight at z = 1.
    max_z
        Depths beyond are not mapped, m.
    half
        Half of a cell, m.
    T
        float64 (3, 4), pose of the optical frame in the frame of the points.
    points
        float64 (N, 3), written.
    """
    height, width = z.shape
    n = 0
    for v in range(height):
        kv = 1
        while kv < 1 << TOP_LEVEL and v % (2 * kv) == 0:
            kv *= 2
        inner_v = kv < 1 << TOP_LEVEL and v + kv < height
        for u in range(width):
            d = z[v, u]
            if usable[v, u] == 0 or d > max_z:
                continue
            ku = 1
            while ku < 1 << TOP_LEVEL and u % (2 * ku) == 0:
                ku *= 2
            if (
                ku < 1 << TOP_LEVEL
                and u + ku < width
                and _is_needless(z, usable, rays, v, u - ku, v, u + ku, half)
            ):
                continue
            if inner_v and _is_needless(z, usable, rays, v - kv, u, v + kv, u, half):
                continue
            if _is_lone(usable, v, u):
                continue
            x, y = np.float64(rays[v, u, 0] * d), np.float64(rays[v, u, 1] * d)
            for i in range(3):
                points[n, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * d + T[i, 3]
            n += 1
    return n


@njit(nogil=True, cache=True)
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
