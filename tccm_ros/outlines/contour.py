"""Rings around the full cells of a raster: marching squares, simplified by Douglas and Peucker.

Each side between a full and an empty cell has one point, on the line between the centres of the two
cells, moved to the end of the surface. Each corner of the contour has another point. So rings never
cross or touch, for any bounds of the edge cells. Corners are then removed by Douglas and Peucker's
rule, as long as the rings still do not cross.
"""

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.kernels import kernel
from tccm_ros.outlines.raster import EMPTY
from tccm_ros.outlines.rings import crosses, is_inside, signed_area, simplify

MAX_SHIFT = 0.49
"""Maximum distance by which a point is moved from its side, cells. Chosen: below one half, rings do
not touch."""

HALVINGS = 6
"""Maximum number of halvings of the tolerance before every corner is kept. Chosen."""


@kernel
def trace(raster: Int32, bounds: Float64) -> tuple[Float64, Int32]:
    """Trace the contours of the full cells; cells that only touch at a corner are separate.

    Parameters
    ----------
    raster
        int32 (A, B), as in `raster`, empty at its border.
    bounds
        float64 (E, 4), bounds of the edge cells (`edge_cells`).

    Returns
    -------
    vertices : float64 (V, 2)
        Vertices in cells; outer rings counter-clockwise, holes clockwise.
    ends : int32 (R,)
        Index in `vertices` at which each ring ends.
    """
    rows, columns = raster.shape
    done = np.zeros((rows, columns), np.bool_)  # sides that run in +a, below their cell
    vertices, ends = np.empty((1024, 2)), np.empty(64, np.int32)
    used, rings = 0, 0
    for a0 in range(1, rows):
        for b0 in range(1, columns):
            if raster[a0, b0] == EMPTY or raster[a0, b0 - 1] != EMPTY or done[a0, b0]:
                continue
            # A corner (a, b) is the low corner of cell (a, b); heading 0 +a, 1 +b, 2 -a, 3 -b.
            a, b, heading, first, turned = a0, b0, 0, used, False
            while True:
                if used + 2 > len(vertices):
                    more = np.empty((2 * len(vertices), 2))
                    more[:used] = vertices[:used]
                    vertices = more
                closed = heading == 0 and done[a, b]
                if closed:
                    x, y = vertices[first, 0], vertices[first, 1]
                elif heading == 0:
                    done[a, b] = True
                    x, y = a + 0.5, edge_at(raster[a, b], bounds, 2, b)
                    a += 1
                    left, right = raster[a, b] != EMPTY, raster[a, b - 1] != EMPTY
                elif heading == 1:
                    x, y = edge_at(raster[a - 1, b], bounds, 1, a), b + 0.5
                    b += 1
                    left, right = raster[a - 1, b] != EMPTY, raster[a, b] != EMPTY
                elif heading == 2:
                    x, y = a - 0.5, edge_at(raster[a - 1, b - 1], bounds, 3, b)
                    a -= 1
                    left, right = raster[a - 1, b - 1] != EMPTY, raster[a - 1, b] != EMPTY
                else:
                    x, y = edge_at(raster[a, b - 1], bounds, 0, a), b - 0.5
                    b -= 1
                    left, right = raster[a, b - 1] != EMPTY, raster[a - 1, b - 1] != EMPTY
                if turned:
                    # The corner between the previous side and this one.
                    along_b = heading == 0 or heading == 2
                    vertices[used, 0] = vertices[used - 1, 0] if along_b else x
                    vertices[used, 1] = y if along_b else vertices[used - 1, 1]
                    used += 1
                if closed:
                    break
                vertices[used, 0], vertices[used, 1] = x, y
                used += 1
                # Where two cells touch at a corner, the rings cut the corner to stay separate.
                turned = left == right
                if not left:
                    heading = (heading + 1) % 4
                elif right:
                    heading = (heading + 3) % 4
            if rings == len(ends):
                longer = np.empty(2 * rings, np.int32)
                longer[:rings] = ends
                ends = longer
            ends[rings] = used
            rings += 1
    return vertices[:used], ends[:rings]


@kernel
def edge_at(cell: int, bounds: Float64, side: int, border: int) -> float:
    """Return the coordinate at which the surface ends near a side of a cell; default: its border.

    Parameters
    ----------
    cell
        Element of the raster: number of an edge cell, or negative.
    bounds
        float64 (E, 4), bounds of the edge cells (`edge_cells`).
    side
        Column of `bounds`: low a, high a, low b, high b.
    border
        Coordinate of the cell's border on that side, cells.
    """
    if cell < 0 or abs(bounds[cell, side] - border) > 1.0:
        return float(border)
    return border + min(max(bounds[cell, side] - border, -MAX_SHIFT), MAX_SHIFT)


@kernel
def largest_polygon(
    vertices: Float64, ends: Int32, tolerance: float, min_hole: float
) -> tuple[Float64, Int32, float]:
    """Return the largest of the polygons that rings enclose, with few corners.

    Parameters
    ----------
    vertices, ends
        Result of `trace`.
    tolerance
        Tolerance of the simplification, cells.
    min_hole
        Minimum area of a hole, as a fraction of that of the outer ring; smaller holes are closed.

    Returns
    -------
    vertices, ends
        The outer ring, counter-clockwise, and the holes, clockwise. They do not cross or touch.
    area : float
        Area minus the holes, square cells.
    """
    shell_start, shell_end, largest, start = 0, 0, 0.0, 0
    for end in ends:
        area = signed_area(vertices[start:end])
        if area > largest:
            shell_start, shell_end, largest = start, end, area
        start = end
    if largest <= 0.0:
        return np.zeros((0, 2)), np.zeros(0, np.int32), 0.0
    shell = vertices[shell_start:shell_end]
    rings = [shell]
    start = 0
    for end in ends:
        ring = vertices[start:end]
        start = end
        if -signed_area(ring) > min_hole * largest and is_inside(shell, ring[0, 0], ring[0, 1]):
            rings.append(ring)
    return join_rings(rings, tolerance)


@kernel
def join_rings(rings: list[Float64], tolerance: float) -> tuple[Float64, Int32, float]:
    """Simplify rings, the outer one first, as far as they stay disjoint, and concatenate them."""
    total = 0
    for ring in rings:
        total += len(ring)
    vertices, ends = np.empty((total, 2)), np.empty(len(rings), np.int32)
    for attempt in range(HALVINGS + 1):
        used, kept, area = 0, 0, 0.0
        for r in range(len(rings)):
            ring = rings[r]
            if attempt < HALVINGS:
                ring = simplify(ring, tolerance * 0.5**attempt)
            if r > 0 and len(ring) < 3:
                continue
            vertices[used : used + len(ring)] = ring
            used += len(ring)
            ends[kept] = used
            kept += 1
            area += signed_area(ring)
        if used > 2 and area > 0.0 and not crosses(vertices[:used], ends[:kept]):
            break
    return vertices[:used].copy(), ends[:kept].copy(), area
