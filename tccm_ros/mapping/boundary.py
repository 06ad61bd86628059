"""The true outline of a plane's cuboids: holes stay holes, an L stays an L.

A lying plane is outlined in the map's cells and lifted onto the plane, a standing one in columns
along its level direction. How samples become rings is told in `raster`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon, make_valid, union_all
from shapely.geometry.polygon import orient

from tccm_ros.mapping.cuboids import TICK, TICKS_PER_M, Cuboids
from tccm_ros.mapping.moments import tangents
from tccm_ros.mapping.raster import cells_lying, cells_standing, rings_around

__all__ = ["Outline", "outline"]

Array = NDArray[np.float64]

STEEP = 0.35
"""Planes with a smaller vertical component of the normal (above 70 deg) are outlined by columns."""

LEAST_HOLE = 6.0
"""Holes smaller than this many samples' share of the area are gaps between samples."""

SIMPLIFY = 0.35
"""Vertices that move the outline by less than this share of a cell are left out."""

MOST_CELLS = 250_000
"""A raster of more cells is made coarser: a floor needs no outline to the centimetre."""


@dataclass(frozen=True, eq=False)
class Outline:
    """Outline of a plane.

    Attributes
    ----------
    boundary
        float64 (N, 3), open ring in the map's frame, counter-clockwise seen against the normal.
    holes
        Rings as `boundary`, clockwise.
    area
        m2, of the boundary less the holes.
    """

    boundary: Array
    holes: tuple[Array, ...]
    area: float


def outline(
    cuboids: Cuboids, members: NDArray[np.int64], normal: ArrayLike, offset: float
) -> Outline:
    """Return the outline of some of a map's cuboids, projected onto a plane.

    Of several pieces the largest is taken.

    Parameters
    ----------
    cuboids, members
        The map, and the indices of the cuboids, int (M,).
    normal, offset
        The plane, ``normal . p = offset``, in m and the map's frame.
    """
    n = np.asarray(normal, float)
    if len(members) == 0:
        return Outline(np.zeros((0, 3)), (), 0.0)
    draw = _lying if abs(n[2]) >= STEEP else _standing
    return draw(cuboids, members, n, offset)


def _lying(cuboids: Cuboids, members: NDArray[np.int64], n: Array, offset: float) -> Outline:
    ix, iy = cuboids.ix[members], cuboids.iy[members]
    coarse = _coarseness(int(np.ptp(ix)) + 1, int(np.ptp(iy)) + 1)
    a, b, reach = cells_lying(
        cuboids.s, cuboids.S, cuboids.count, cuboids.ix, cuboids.iy, members,
        cuboids.cell_size * TICKS_PER_M, coarse,
    )  # fmt: skip
    polygon = _polygon(a, b, reach, len(members))
    cell = cuboids.cell_size * (1 << coarse)

    def lift(ring: Array) -> Array:
        xy = ring * cell
        z = (offset - xy @ n[:2]) / n[2]
        xyz = np.column_stack([xy, z])
        return xyz if n[2] > 0.0 else xyz[::-1]

    return _outline(polygon, lift, cell * cell / abs(n[2]))


def _standing(cuboids: Cuboids, members: NDArray[np.int64], n: Array, offset: float) -> Outline:
    u, v = tangents(n)
    count = cuboids.count[members]
    ticks = cuboids.cell_size * TICKS_PER_M
    local = cuboids.s[members] / count[:, None]
    variance = cuboids.S[members][:, [0, 3, 5]] / count[:, None] - local**2
    spread = np.sqrt(3.0 * np.maximum(variance, 0.0))
    middle_u = u[0] * (local[:, 0] + np.rint(cuboids.ix[members] * ticks)) + u[1] * (
        local[:, 1] + np.rint(cuboids.iy[members] * ticks)
    )
    spread_u = np.hypot(u[0] * spread[:, 0], u[1] * spread[:, 1])
    # The top is a point; the bottom lies below the lowest by a depth that may vary.
    high = cuboids.top[members].astype(float)
    low = np.clip(local[:, 2] - spread[:, 2], cuboids.bottom[members], high)
    across = (np.ptp(middle_u) / ticks + 2.0, (high.max() - low.min()) / ticks + 2.0)
    cell = ticks * (1 << _coarseness(*across))
    a, b, reach = cells_standing(middle_u / cell, spread_u / cell, low / cell, high / cell)
    polygon = _polygon(a, b, reach, len(a))
    cell *= TICK

    def lift(ring: Array) -> Array:
        # The point of the plane at height z and place u along it.
        along, z = ring[:, 0] * cell, ring[:, 1] * cell
        rise = (z - offset * n[2]) / v[2]
        return along[:, None] * u + rise[:, None] * v + offset * n

    return _outline(polygon, lift, cell * cell / v[2])


def _coarseness(rows: float, columns: float) -> int:
    return max(0, math.ceil(math.log2(rows * columns / MOST_CELLS) / 2.0))


def _polygon(a: NDArray[np.int32], b: NDArray[np.int32], reach: Array, samples: int) -> Polygon:
    """Return the largest polygon around cells, in cells, without specks, counter-clockwise."""
    vertices, ends = rings_around(a, b, reach)
    rings = np.split(vertices, ends[:-1])
    areas = [_signed_area(ring) for ring in rings]
    shell = int(np.argmax(areas))
    least = LEAST_HOLE * areas[shell] / samples
    holes = [r for r, area in zip(rings, areas, strict=True) if -area > least and len(r) > 3]
    return _clean(_only(Polygon(rings[shell]).buffer(0.0)), holes)


def _clean(shell: Polygon, holes: list[Array]) -> Polygon:
    inside = union_all([make_valid(Polygon(h)) for h in holes]) if holes else Polygon()
    shape = _only(shell.difference(inside) if holes else shell)
    simple = shape.simplify(SIMPLIFY, preserve_topology=False)
    return orient(_only(simple if simple.is_valid else make_valid(simple)), 1.0)


def _only(shape: object) -> Polygon:
    """Return the largest polygon of a geometry."""
    parts = getattr(shape, "geoms", [shape])
    polygons = [p for p in parts if isinstance(p, Polygon)]
    return max(polygons, key=lambda p: p.area, default=Polygon())


def _signed_area(ring: Array) -> float:
    x, y = ring.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _outline(polygon: Polygon, lift, scale: float) -> Outline:  # type: ignore[no-untyped-def]
    if polygon.is_empty:
        return Outline(np.zeros((0, 3)), (), 0.0)
    holes = tuple(lift(np.asarray(h.coords)[:-1]) for h in polygon.interiors)
    return Outline(lift(np.asarray(polygon.exterior.coords)[:-1]), holes, polygon.area * scale)
