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


@kernel
def _hit_box(o: Float64, d: Float64, half: Float64) -> tuple[float, int]:
    """Return (distance, face) at which a ray in the box's frame enters it; (-1, 0) if it misses."""
    near, far, face = -np.inf, np.inf, 0
    for k in range(3):
        if abs(d[k]) < 1e-12:
            if abs(o[k]) > half[k]:
                return -1.0, 0
            continue
        sign = 1.0 if d[k] > 0.0 else -1.0
        first, last = (-sign * half[k] - o[k]) / d[k], (sign * half[k] - o[k]) / d[k]
        if first > near:
            near, face = first, 2 * k + (0 if sign > 0.0 else 1)
        far = min(far, last)
        if near > far:
            return -1.0, 0
    return near, face


@kernel
def _hit_cylinder(o: Float64, d: Float64, half: Float64) -> tuple[float, int]:
    """Return (distance, face) at which a ray enters the cylinder, in its frame; (-1, 0) if not."""
    radius, height = half[0], half[2]
    if abs(d[2]) > 1e-12:
        sign = 1.0 if d[2] > 0.0 else -1.0
        t = (-sign * height - o[2]) / d[2]
        x, y = o[0] + t * d[0], o[1] + t * d[1]
        if t > 0.0 and x * x + y * y <= radius * radius:
            return t, 4 if sign > 0.0 else 5
    a = d[0] * d[0] + d[1] * d[1]
    b = o[0] * d[0] + o[1] * d[1]
    c = o[0] * o[0] + o[1] * o[1] - radius * radius
    root = b * b - a * c
    if a < 1e-18 or root <= 0.0:
        return -1.0, 0
    t = (-b - np.sqrt(root)) / a
    if abs(o[2] + t * d[2]) > height:
        return -1.0, 0
    return t, 0


@kernel(inline="always")
def _try_solids(
    items: Int64,
    solids: Solids,
    origin: Float64,
    direction: Float64,
    time: float,
    best: float,
    code: int,
    scratch: Float64,
) -> tuple[float, int]:
    """Return the nearest (distance, code) of a ray's hits on some solids and the nearest so far."""
    o, d, offset = scratch[0], scratch[1], scratch[2]
    for i in items:
        if solids.kind[i] == ABSENT:
            continue
        along, square = 0.0, 0.0
        for m in range(3):
            offset[m] = origin[m] - solids.center[i, m] - time * solids.velocity[i, m]
            along -= offset[m] * direction[m]
            square += offset[m] * offset[m]
        radius = solids.radius[i]
        if (
            square - along * along > radius * radius
            or along + radius < 0.0
            or along - radius > best
        ):
            continue  # the ray misses the bounding sphere
        for k in range(3):
            o[k], d[k] = 0.0, 0.0
            for m in range(3):
                o[k] += solids.R_solid_world[i, k, m] * offset[m]
                d[k] += solids.R_solid_world[i, k, m] * direction[m]
        if solids.kind[i] == BOX:
            t, face = _hit_box(o, d, solids.half[i])
        else:
            t, face = _hit_cylinder(o, d, solids.half[i])
        if solids.glass[i] and abs(d[face // 2]) < GLASS_COSINE:
            continue
        if NEAREST < t < best:
            best, code = t, i * FACES + face
    return best, code


@kernel(inline="always")
def _walk(
    solids: Solids,
    grid: Grid,
    origin: Float64,
    direction: Float64,
    time: float,
    best: float,
    code: int,
    scratch: Float64,
) -> tuple[float, int]:
    """Test the solids of the cells along a ray until no nearer hit is possible."""
    size = (grid.nx, grid.ny)
    enter, leave = 0.0, best
    for k in range(2):  # clip the ray to the grid
        o, d = origin[k] - grid.origin[k], direction[k]
        width = size[k] * grid.cell
        if abs(d) < 1e-12:
            if o < 0.0 or o > width:
                return best, code
            continue
        t0, t1 = -o / d, (width - o) / d
        enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
    if enter > leave:
        return best, code
    i = min(
        max(int((origin[0] + enter * direction[0] - grid.origin[0]) / grid.cell), 0), grid.nx - 1
    )
    j = min(
        max(int((origin[1] + enter * direction[1] - grid.origin[1]) / grid.cell), 0), grid.ny - 1
    )
    while 0 <= i < grid.nx and 0 <= j < grid.ny and enter <= best:
        c = i * grid.ny + j
        items = grid.items[grid.start[c] : grid.start[c + 1]]
        best, code = _try_solids(items, solids, origin, direction, time, best, code, scratch)
        tx = ty = np.inf
        if abs(direction[0]) >= 1e-12:
            edge = grid.origin[0] + (i + (1 if direction[0] > 0.0 else 0)) * grid.cell
            tx = (edge - origin[0]) / direction[0]
        if abs(direction[1]) >= 1e-12:
            edge = grid.origin[1] + (j + (1 if direction[1] > 0.0 else 0)) * grid.cell
            ty = (edge - origin[1]) / direction[1]
        if tx == np.inf and ty == np.inf:
            break
        enter = min(tx, ty)
        if tx <= ty:
            i += 1 if direction[0] > 0.0 else -1
        else:
            j += 1 if direction[1] > 0.0 else -1
    return best, code


@kernel
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
    scratch = np.empty((3, 3))
    for b in range(len(origins)):
        o, d, time = origins[b], directions[b], times[b]
        best, code = _try_solids(grid.everywhere, solids, o, d, time, max_range, -1, scratch)
        best, code = _walk(solids, grid, o, d, time, best, code, scratch)
        ranges[b] = best if code >= 0 else np.inf
        codes[b] = code
    return ranges, codes
