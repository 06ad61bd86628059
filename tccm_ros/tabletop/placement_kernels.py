"""Kernels of `placements`: the position of a rectangle with the most clearance in a polygon.

The clearance of a rectangle changes by no more than its displacement. So the clearance in a square
of positions is at most that in its middle plus half its diagonal. Squares that cannot contain the
best position are discarded, the others divided (as `polylabel` does for a point). `shapely`'s exact
erosion of the polygon took ten times as long.
"""

import math

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.kernels import kernel


@kernel
def box_clearance(
    sides: Float64, x: float, y: float, half_x: float, half_y: float, enough: float
) -> float:
    """Return the distance of a rectangle from the sides of a polygon; 0 where it is not inside.

    Parameters
    ----------
    sides
        float64 (N, 4), x y of both ends of every side of the rings, m, along axes parallel to the
        rectangle's sides. The even-odd rule defines the inside.
    x, y
        Middle of the rectangle, m.
    half_x, half_y
        Half its sides, m.
    enough
        The search for the nearest side ends at a distance up to this, m.
    """
    inside = False
    nearest2 = np.inf
    enough = max(enough, 0.0)
    for i in range(len(sides)):
        ax, ay = sides[i, 0] - x, sides[i, 1] - y
        bx, by = sides[i, 2] - x, sides[i, 3] - y
        if (ay > 0.0) != (by > 0.0) and ax + (bx - ax) * ay / (ay - by) > 0.0:
            inside = not inside
        # Bounding boxes exclude sides that are too far.
        far_x = max(min(ax, bx) - half_x, -half_x - max(ax, bx), 0.0)
        far_y = max(min(ay, by) - half_y, -half_y - max(ay, by), 0.0)
        if far_x * far_x + far_y * far_y >= nearest2:
            continue
        distance2 = _segment_to_box2(ax, ay, bx, by, half_x, half_y)
        if distance2 < nearest2:
            nearest2 = distance2
            if nearest2 <= enough * enough:
                return math.sqrt(nearest2)
    return math.sqrt(nearest2) if inside and len(sides) else 0.0


@kernel
def _segment_to_box2(
    ax: float, ay: float, bx: float, by: float, half_x: float, half_y: float
) -> float:
    """Return the squared distance of a segment from a box around the origin; 0 where they meet."""
    dx, dy = bx - ax, by - ay
    low, high = 0.0, 1.0
    meets = True
    for axis in range(2):
        start, step, half = (ax, dx, half_x) if axis == 0 else (ay, dy, half_y)
        if step == 0.0:
            meets = meets and abs(start) <= half
            continue
        t0, t1 = (-half - start) / step, (half - start) / step
        low, high = max(low, min(t0, t1)), min(high, max(t0, t1))
    if meets and low <= high:
        return 0.0
    nearest2 = np.inf
    for end in range(2):
        px, py = (ax, ay) if end == 0 else (bx, by)
        ex, ey = max(abs(px) - half_x, 0.0), max(abs(py) - half_y, 0.0)
        nearest2 = min(nearest2, ex * ex + ey * ey)
    length2 = dx * dx + dy * dy
    if length2 > 0.0:
        for corner in range(4):
            cx = half_x if corner & 1 else -half_x
            cy = half_y if corner & 2 else -half_y
            t = min(max(((cx - ax) * dx + (cy - ay) * dy) / length2, 0.0), 1.0)
            ex, ey = ax + t * dx - cx, ay + t * dy - cy
            nearest2 = min(nearest2, ex * ex + ey * ey)
    return nearest2


@kernel
def best_position(
    sides: Float64,
    half: Float64,
    disc: Float64,
    limits: Float64,
    tolerance: float,
) -> tuple[float, float, float]:
    """Return the position of a rectangle with the most clearance, and that clearance.

    Parameters
    ----------
    sides
        float64 (N, 4), as in `box_clearance`.
    half
        float64 (2,), half the rectangle's sides, m.
    disc
        float64 (3,), x, y and radius of a circle that must contain the position, m; radius inf for
        any position.
    limits
        float64 (2,), minimum clearance, and clearance at which the search ends, m.
    tolerance
        Maximum difference from the greatest clearance, m, > 0.

    Returns
    -------
    x, y, clearance : float
        In m; clearance 0 where there is no such position.
    """
    best_x = best_y = best = 0.0
    if len(sides) == 0:
        return best_x, best_y, best
    low_x, low_y = sides[:, 0].min() + half[0], sides[:, 1].min() + half[1]
    high_x, high_y = sides[:, 0].max() - half[0], sides[:, 1].max() - half[1]
    if math.isfinite(disc[2]):
        low_x, high_x = max(low_x, disc[0] - disc[2]), min(high_x, disc[0] + disc[2])
        low_y, high_y = max(low_y, disc[1] - disc[2]), min(high_y, disc[1] + disc[2])
    if low_x > high_x or low_y > high_y:
        return best_x, best_y, best
    step = max(min(high_x - low_x, high_y - low_y), 4.0 * tolerance)
    columns = math.ceil((high_x - low_x) / step) or 1
    rows = math.ceil((high_y - low_y) / step) or 1
    squares = np.empty((columns * rows, 2))
    for i in range(columns):
        for j in range(rows):
            squares[i * rows + j, 0] = low_x + (i + 0.5) * step
            squares[i * rows + j, 1] = low_y + (j + 0.5) * step
    while len(squares):
        half_diagonal = step * math.sqrt(0.5)
        divided, n = np.empty((4 * len(squares), 2)), 0
        for k in range(len(squares)):
            x, y = squares[k, 0], squares[k, 1]
            distance = math.hypot(x - disc[0], y - disc[1]) if math.isfinite(disc[2]) else 0.0
            if distance - half_diagonal > disc[2]:
                continue
            needed = max(best + tolerance, limits[0])
            enough = min(needed - half_diagonal, best)
            clearance = box_clearance(sides, x, y, half[0], half[1], enough)
            if clearance > best and clearance >= limits[0] and distance <= disc[2]:
                best_x, best_y, best = x, y, clearance
                if best >= limits[1]:
                    return best_x, best_y, best
            if clearance + half_diagonal > max(best + tolerance, limits[0]):
                for quarter in range(4):
                    divided[n, 0] = x + (0.25 if quarter & 1 else -0.25) * step
                    divided[n, 1] = y + (0.25 if quarter & 2 else -0.25) * step
                    n += 1
        squares = divided[:n]
        step *= 0.5
        if half_diagonal < 0.5 * tolerance:
            break
    return best_x, best_y, best
