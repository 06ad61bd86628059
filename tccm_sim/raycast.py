"""Exact distances along rays to boxes and cylinders.

A scene consists of arrays of all solids (`Solids`) and a grid over x, y with the solids of each
cell (`Grid`). Solids are hit from outside only; a ray that starts inside one leaves it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel

ABSENT, BOX, CYLINDER = -1, 0, 1
FACES = 6
"""Codes of faces: 2 * axis + (1 on the positive side); a cylinder's side is 0, its caps 4 and 5."""

NEAREST = 1e-6  # m; a closer hit is the ray's own start

GLASS_COSINE = 0.978
"""Cosine of the maximum angle of incidence at which glass returns a beam: 12 deg. Chosen, in the
range reported for lasers indoors."""


class Solids(NamedTuple):
    """All solids of a scene as arrays of N rows.

    Attributes
    ----------
    kind
        int8 (N,), `BOX`, `CYLINDER` or `ABSENT`.
    center, velocity
        float64 (N, 3) in the world, m and m/s.
    R_solid_world
        float64 (N, 3, 3).
    half
        float64 (N, 3), half edges, or (radius, radius, half height), m.
    radius
        float64 (N,), of a bounding sphere, m.
    glass
        bool (N,), whether only beams near normal incidence are returned.
    """

    kind: NDArray[np.int8]
    center: Float64
    velocity: Float64
    R_solid_world: Float64
    half: Float64
    radius: Float64
    glass: NDArray[np.bool_]


class Grid(NamedTuple):
    """Solids by cell of a grid over x, y.

    Attributes
    ----------
    origin
        float64 (2,), corner in the world, m.
    cell
        Edge length of a cell, m.
    nx, ny
        Number of cells.
    start, items
        int64; cell (i, j) holds `items[start[i * ny + j] : start[i * ny + j + 1]]`.
    everywhere
        int64, solids tested for every ray: large and moving ones.
    """

    origin: Float64
    cell: float
    nx: int
    ny: int
    start: Int64
    items: Int64
    everywhere: Int64


@kernel(inline="always", error_model="numpy")
def _hit_box(
    R: Float64, half: Float64, i: int, x: float, y: float, z: float, u: float, v: float, w: float,
    best: float,
) -> tuple[float, int, float]:  # fmt: skip
    """Return (distance, face, cosine) at which a ray enters box i; (-1, 0, 0) if not before best.

    The ray is in the world's axes: its start (x, y, z) from the box's centre, and its direction
    (u, v, w).
    """
    near, far, face, cosine = -np.inf, np.inf, 0, 0.0
    for k in range(3):
        o = R[i, k, 0] * x + R[i, k, 1] * y + R[i, k, 2] * z
        d = R[i, k, 0] * u + R[i, k, 1] * v + R[i, k, 2] * w
        if abs(d) < 1e-12:
            if abs(o) > half[i, k]:
                near = np.inf
            continue
        sign = 1.0 if d > 0.0 else -1.0
        first, last = (-sign * half[i, k] - o) / d, (sign * half[i, k] - o) / d
        if first > near:
            near, face, cosine = first, 2 * k + (0 if sign > 0.0 else 1), abs(d)
        far = min(far, last)
        if near > far or near >= best or far < 0.0:
            break
    if near > far or near >= best:
        return -1.0, 0, 0.0
    return near, face, cosine


@kernel(inline="always", error_model="numpy")
def _hit_cylinder(
    R: Float64, half: Float64, i: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> tuple[float, int, float]:  # fmt: skip
    """Return (distance, face, cosine) at which a ray enters cylinder i, as `_hit_box`."""
    radius, height = half[i, 0], half[i, 2]
    ox = R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * z
    oy = R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * z
    oz = R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * z
    dx = R[i, 0, 0] * u + R[i, 0, 1] * v + R[i, 0, 2] * w
    dy = R[i, 1, 0] * u + R[i, 1, 1] * v + R[i, 1, 2] * w
    dz = R[i, 2, 0] * u + R[i, 2, 1] * v + R[i, 2, 2] * w
    if abs(dz) > 1e-12:
        sign = 1.0 if dz > 0.0 else -1.0
        t = (-sign * height - oz) / dz
        at_x, at_y = ox + t * dx, oy + t * dy
        if t > 0.0 and at_x * at_x + at_y * at_y <= radius * radius:
            return t, 4 if sign > 0.0 else 5, abs(dz)
    a = dx * dx + dy * dy
    b = ox * dx + oy * dy
    c = ox * ox + oy * oy - radius * radius
    root = b * b - a * c
    if a < 1e-18 or root <= 0.0:
        return -1.0, 0, 0.0
    t = (-b - np.sqrt(root)) / a
    if abs(oz + t * dz) > height:
        return -1.0, 0, 0.0
    return t, 0, abs(dx)


@kernel(inline="always", error_model="numpy")
def _try_solids(
    items: Int64, start: int, end: int, solids: Solids, tested: Int64, b: int, x: float, y: float,
    z: float, u: float, v: float, w: float, time: float, best: float, code: int,
) -> tuple[float, int]:  # fmt: skip
    """Return the nearest (distance, code) of ray b's hits on some solids and the nearest so far.

    Solids in several cells are tested once: `tested` has the last ray tested for each.
    """
    for k in range(start, end):
        i = items[k]
        if solids.kind[i] == ABSENT or tested[i] == b:
            continue
        tested[i] = b
        x0 = x - solids.center[i, 0] - time * solids.velocity[i, 0]
        y0 = y - solids.center[i, 1] - time * solids.velocity[i, 1]
        z0 = z - solids.center[i, 2] - time * solids.velocity[i, 2]
        along = -x0 * u - y0 * v - z0 * w
        square = x0 * x0 + y0 * y0 + z0 * z0
        radius = solids.radius[i]
        if (
            square - along * along > radius * radius
            or along + radius < 0.0
            or along - radius > best
        ):
            continue  # the ray misses the bounding sphere
        if solids.kind[i] == BOX:
            t, face, cosine = _hit_box(
                solids.R_solid_world, solids.half, i, x0, y0, z0, u, v, w, best
            )
        else:
            t, face, cosine = _hit_cylinder(
                solids.R_solid_world, solids.half, i, x0, y0, z0, u, v, w
            )
        if solids.glass[i] and cosine < GLASS_COSINE:
            continue
        if NEAREST < t < best:
            best, code = t, i * FACES + face
    return best, code


@kernel(error_model="numpy")
def cast(
    solids: Solids,
    grid: Grid,
    origins: Float64,
    directions: Float64,
    times: Float64,
    max_range: float,
) -> tuple[Float64, Int64]:
    """Return the distance along each ray to the first solid.

    Parameters
    ----------
    solids, grid
        The scene; a moving solid is at ``center + time * velocity``.
    origins, directions
        float64 (B, 3) in the world, m; unit directions.
    times
        float64 (B,), s, relative to the time of the solids' centres.
    max_range
        Maximum distance of a hit, m.

    Returns
    -------
    ranges
        float64 (B,), m; +inf without a hit.
    codes
        int64 (B,): FACES * solid + face, or -1.
    """
    ranges, codes = np.empty(len(origins)), np.empty(len(origins), np.int64)
    tested = np.full(len(solids.kind), -1)
    everywhere, n_everywhere = grid.everywhere, len(grid.everywhere)
    for b in range(len(origins)):
        x, y, z = origins[b, 0], origins[b, 1], origins[b, 2]
        u, v, w = directions[b, 0], directions[b, 1], directions[b, 2]
        best, code = _try_solids(
            everywhere, 0, n_everywhere, solids, tested, b, x, y, z, u, v, w, times[b], max_range,
            -1,
        )  # fmt: skip
        enter, leave = 0.0, best if len(grid.items) else -1.0
        for k in range(2):  # clip the ray to the grid
            o, d = (x, u) if k == 0 else (y, v)
            o -= grid.origin[k]
            width = (grid.nx if k == 0 else grid.ny) * grid.cell
            if abs(d) < 1e-12:
                if o < 0.0 or o > width:
                    leave = -1.0
                continue
            t0, t1 = -o / d, (width - o) / d
            enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
        if enter <= leave:
            i = min(max(int((x + enter * u - grid.origin[0]) / grid.cell), 0), grid.nx - 1)
            j = min(max(int((y + enter * v - grid.origin[1]) / grid.cell), 0), grid.ny - 1)
            tx, ty = np.inf, np.inf
            if abs(u) >= 1e-12:
                tx = (grid.origin[0] + (i + (1 if u > 0.0 else 0)) * grid.cell - x) / u
            if abs(v) >= 1e-12:
                ty = (grid.origin[1] + (j + (1 if v > 0.0 else 0)) * grid.cell - y) / v
            while 0 <= i < grid.nx and 0 <= j < grid.ny and enter <= best:
                c = i * grid.ny + j
                best, code = _try_solids(
                    grid.items, grid.start[c], grid.start[c + 1], solids, tested, b, x, y, z, u, v,
                    w, times[b], best, code,
                )  # fmt: skip
                enter = min(tx, ty)
                if enter == np.inf:
                    break
                if tx <= ty:
                    i += 1 if u > 0.0 else -1
                    tx = (grid.origin[0] + (i + (1 if u > 0.0 else 0)) * grid.cell - x) / u
                else:
                    j += 1 if v > 0.0 else -1
                    ty = (grid.origin[1] + (j + (1 if v > 0.0 else 0)) * grid.cell - y) / v
        ranges[b] = best if code >= 0 else np.inf
        codes[b] = code
    return ranges, codes
