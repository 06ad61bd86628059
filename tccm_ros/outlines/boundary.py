"""Concave outlines of planes, with holes.

A vertical plane is outlined from its front, in columns along its horizontal direction. Any other
plane is outlined from above, in the map's cells. The outline is then lifted onto the plane.
`raster`, `gaps` and `edge_cells` make a raster of the samples, `contour` traces its rings. All
planes of a map are outlined in one compiled call.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import CuboidArrays, Cuboids
from tccm_ros.cuboids.inclination import OUTLINED_BY_COLUMNS
from tccm_ros.kernels import kernel
from tccm_ros.outlines.contour import largest_polygon, trace
from tccm_ros.outlines.edge_cells import (
    bound_edges_horizontal,
    bound_edges_vertical,
    extend_edges,
    find_edges,
)
from tccm_ros.outlines.gaps import close_combs, fill_gaps, find_gaps
from tccm_ros.outlines.raster import (
    EMPTY,
    MARGIN,
    draw_runs,
    measure_vertical,
    runs_horizontal,
    runs_vertical,
)

MIN_HOLE = 6.0
"""Minimum area of a hole, in mean areas of a sample; smaller ones are gaps between samples.
Chosen."""

TOLERANCE = 1.0
"""Tolerance of the simplification of the outline, cells. Chosen: an edge is known no better than to
its cell."""

MAX_CELLS = 65_536
"""Maximum number of cells of a raster; larger ones are made coarser. Chosen: 256 x 256 cells, 5 m
at 20 mm; a floor needs no outline to the centimetre."""


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
        Area of the boundary minus the holes, m2.
    """

    boundary: Float64
    holes: tuple[Float64, ...]
    area: float


@kernel
def members_by_plane(labels: Int32, planes: int) -> tuple[Int64, Int64]:
    """Sort cuboids by plane, without those of label -1.

    Returns
    -------
    members : int64 (M,)
        Indices of cuboids, ascending within a plane.
    starts : int64 (planes + 1,)
        Index in `members` at which each plane begins.
    """
    starts = np.zeros(planes + 2, np.int64)
    for label in labels:
        if label >= 0:
            starts[label + 2] += 1
    for p in range(1, planes + 2):
        starts[p] += starts[p - 1]
    members = np.empty(starts[planes + 1], np.int64)
    for i in range(len(labels)):
        if labels[i] >= 0:
            members[starts[labels[i] + 1]] = i
            starts[labels[i] + 1] += 1
    return members, starts[: planes + 1]


def outlines(
    cuboids: Cuboids, members: Int64, starts: Int64, normals: Float64, offsets: Float64
) -> list[Outline]:
    """Return the outline of each plane of a map, that of its largest piece.

    Parameters
    ----------
    cuboids
        Cuboids of the map.
    members, starts
        Result of `members_by_plane`.
    normals, offsets
        float64 (F, 3) and (F,): the planes, ``normal . p = offset``, in m and the map's frame.
    """
    vertices, ends, rings, areas = outline_planes(cuboids.arrays, members, starts, normals, offsets)
    found, start, first = [], 0, 0
    for area, last in zip(areas.tolist(), rings.tolist(), strict=True):
        parts = []
        for end in ends[first:last].tolist():
            parts.append(vertices[start:end])
            start = end
        first = last
        found.append(Outline(parts[0] if parts else np.zeros((0, 3)), tuple(parts[1:]), area))
    return found


@kernel
def outline_planes(
    arrays: tuple[Any, ...], members: Int64, starts: Int64, normals: Float64, offsets: Float64
) -> tuple[Float64, Int64, Int64, Float64]:
    """Compute the outlines of planes: the kernel of `outlines`.

    Parameters
    ----------
    arrays
        The fields of `CuboidArrays`.
    members, starts, normals, offsets
        As in `outlines`.

    Returns
    -------
    vertices : float64 (V, 3)
        Vertices of all rings, m.
    ends : int64 (R,)
        Index in `vertices` at which each ring ends.
    rings : int64 (F,)
        Index in `ends` at which the rings of each plane end; the first is the boundary.
    areas : float64 (F,)
        Area of each outline, m2.
    """
    cuboids = CuboidArrays(*arrays)
    planes, tick = len(normals), cuboids.tick
    vertices, used = np.empty((1024, 3)), 0
    ends, rings, areas = np.empty(256, np.int64), np.empty(planes, np.int64), np.zeros(planes)
    total = 0
    for f in range(planes):
        chosen = members[starts[f] : starts[f + 1]]
        normal = normals[f]
        from_above = abs(normal[2]) >= OUTLINED_BY_COLUMNS
        if len(chosen) and from_above:
            flat, flat_ends, area, cell = outline_from_above(cuboids, chosen)
        elif len(chosen):
            flat, flat_ends, area, cell = outline_from_front(cuboids, chosen, normal)
        else:
            rings[f] = total
            continue
        while used + len(flat) > len(vertices):
            more = np.empty((2 * len(vertices), 3))
            more[:used] = vertices[:used]
            vertices = more
        while total + len(flat_ends) > len(ends):
            longer = np.empty(2 * len(ends), np.int64)
            longer[:total] = ends[:total]
            ends = longer
        lift(flat, flat_ends, normal, offsets[f], cell * tick, vertices[used:])
        for end in flat_ends:
            ends[total] = used + end
            total += 1
        used += len(flat)
        rings[f] = total
        seen = abs(normal[2]) if from_above else math.hypot(normal[0], normal[1])
        areas[f] = area * (cell * tick) ** 2 / seen
    return vertices[:used].copy(), ends[:total].copy(), rings, areas


@kernel
def coarseness(rows: float, columns: float) -> int:
    """Return log2 of the factor by which cells are enlarged for at most `MAX_CELLS` cells."""
    coarse = 0
    while rows * columns > MAX_CELLS * 4.0**coarse:
        coarse += 1
    return coarse


@kernel
def frame_of(runs: Int32) -> tuple[int, int, int, int]:
    """Return the first cell and the shape of the raster of runs, including its margin."""
    low_a, high_a = runs[0, 0], runs[0, 0]
    low_b, high_b = runs[0, 1], runs[0, 2]
    for k in range(len(runs)):
        low_a, high_a = min(low_a, runs[k, 0]), max(high_a, runs[k, 0])
        low_b, high_b = min(low_b, runs[k, 1]), max(high_b, runs[k, 2])
    rows, columns = high_a - low_a + 1 + 2 * MARGIN, high_b - low_b + 1 + 2 * MARGIN
    return low_a - MARGIN, low_b - MARGIN, rows, columns


class PlaneRaster(NamedTuple):
    """The samples of a plane in a raster.

    Attributes
    ----------
    cells
        int32 (A, B) after `find_edges`, with filled gaps between samples.
    low
        Its first cell (a, b).
    edges, bounds
        Result of `find_edges`, and a buffer, float64 (E, 4), for `edge_cells`.
    usual_a, usual_b
        Result of `find_gaps`.
    samples
        Number of samples.
    """

    cells: Int32
    low: tuple[int, int]
    edges: Int32
    bounds: Float64
    usual_a: Float64
    usual_b: Float64
    samples: int


@kernel
def make_raster(runs: Int32) -> PlaneRaster:
    """Draw runs of samples, int32 (N, 3) as in `draw_runs`, and find gaps and edges."""
    low_a, low_b, rows, columns = frame_of(runs)
    cells = np.full((rows, columns), EMPTY, np.int32)
    samples = draw_runs(cells, runs, low_a, low_b)
    gaps, usual_a, usual_b = find_gaps(cells, samples)
    fill_gaps(cells, gaps, usual_a, usual_b)
    edges = find_edges(cells)
    bounds = np.empty((len(edges), 4))
    return PlaneRaster(cells, (low_a, low_b), edges, bounds, usual_a, usual_b, samples)


@kernel
def outline_from_above(
    cuboids: CuboidArrays, members: Int64
) -> tuple[Float64, Int32, float, float]:
    """Compute the outline of a plane that is not vertical, seen from above.

    Returns
    -------
    vertices, ends, area
        As in `contour.largest_polygon`; a along x and b along y, from the map's origin.
    cell
        Edge of a cell, ticks.
    """
    ix, iy = cuboids.ix, cuboids.iy
    low_x = high_x = ix[members[0]]
    low_y = high_y = iy[members[0]]
    for i in members:
        low_x, high_x = min(low_x, ix[i]), max(high_x, ix[i])
        low_y, high_y = min(low_y, iy[i]), max(high_y, iy[i])
    coarse = coarseness(high_x - low_x + 1.0, high_y - low_y + 1.0)
    runs = np.empty((len(members), 3), np.int32)
    runs_horizontal(ix, iy, members, coarse, runs)
    raster = make_raster(runs)
    scale = 1.0 / (1 << coarse)
    bound_edges_horizontal(raster.cells, runs, raster.low, cuboids, members, scale, raster.bounds)
    vertices, ends, area = trace_polygon(raster)
    return vertices, ends, area, cuboids.cell / scale


@kernel
def outline_from_front(
    cuboids: CuboidArrays, members: Int64, normal: Float64
) -> tuple[Float64, Int32, float, float]:
    """Compute the outline of a vertical plane, seen from its front.

    Parameters
    ----------
    cuboids
        Cuboids of the map.
    members
        int64 (M,), indices of the plane's cuboids, M > 0.
    normal
        float64 (3,), unit, of the plane.

    Returns
    -------
    vertices, ends, area, cell
        As in `outline_from_above`, with a along the plane's horizontal direction and b upwards
        from height 0 of the map.
    """
    slope, size = math.hypot(normal[0], normal[1]), cuboids.cell
    extent = np.empty((len(members), 4))
    measure_vertical(cuboids, members, -normal[1] / slope, normal[0] / slope, extent)
    across = extent[:, 0].max() - extent[:, 0].min()
    upwards = extent[:, 3].max() - extent[:, 2].min()
    cell = size * (1 << coarseness(across / size + 2.0, upwards / size + 2.0))
    runs = np.empty((len(members), 3), np.int32)
    runs_vertical(extent, 1.0 / cell, runs)
    raster = make_raster(runs)
    bound_edges_vertical(raster.cells, runs, raster.low, extent, 1.0 / cell, raster.bounds)
    vertices, ends, area = trace_polygon(raster)
    return vertices, ends, area, cell


@kernel
def trace_polygon(raster: PlaneRaster) -> tuple[Float64, Int32, float]:
    """Extend sparse edges and fill combs of a raster, and return its largest polygon.

    Returns
    -------
    vertices, ends, area
        As in `contour.largest_polygon`, in cells from the map's origin.
    """
    cells, bounds, usual_a, usual_b = raster.cells, raster.bounds, raster.usual_a, raster.usual_b
    extend_edges(cells, raster.edges, bounds, usual_a, usual_b)
    close_combs(cells, usual_a.max(), usual_b.max())
    vertices, ends = trace(cells, bounds)
    vertices, ends, area = largest_polygon(vertices, ends, TOLERANCE, MIN_HOLE / raster.samples)
    vertices[:, 0] += raster.low[0]
    vertices[:, 1] += raster.low[1]
    return vertices, ends, area


@kernel
def lift(
    flat: Float64, ends: Int32, normal: Float64, offset: float, cell: float, out: Float64
) -> None:
    """Lift rings from the raster onto their plane.

    Parameters
    ----------
    flat
        float64 (V, 2), corners (a, b), cells from the map's origin.
    ends
        int32 (R,), index in `flat` at which each ring ends.
    normal, offset
        The plane, ``normal . p = offset``, m.
    cell
        Edge of a raster's cell, m.
    out
        float64 (>= V, 3), receives the corners, m. Outer rings are counter-clockwise seen against
        the normal.
    """
    nx, ny, nz = normal[0], normal[1], normal[2]
    slope = math.hypot(nx, ny)
    for k in range(len(flat)):
        a, b = flat[k, 0] * cell, flat[k, 1] * cell
        if abs(nz) >= OUTLINED_BY_COLUMNS:
            out[k, 0], out[k, 1], out[k, 2] = a, b, (offset - a * nx - b * ny) / nz
        else:
            # The point of the plane at height b and position a along its horizontal direction.
            back = (offset - b * nz) / slope
            out[k, 0] = (-ny * a + nx * back) / slope
            out[k, 1] = (nx * a + ny * back) / slope
            out[k, 2] = b
    if nz <= -OUTLINED_BY_COLUMNS:
        start = 0
        for end in ends:
            out[start:end] = out[start:end][::-1].copy()
            start = end
