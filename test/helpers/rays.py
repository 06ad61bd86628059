"""Rays in the plane, cast without the simulator."""

import numpy as np

from tccm_ros.kernels import kernel


@kernel
def ranges_to_sides(directions, starts, sides, nearest):
    """Return the ranges (N,) along rays from the origin to the nearest side; inf without one.

    Directions (N, 2), and starts and vectors (M, 2) of the sides; ranges are more than `nearest`.
    """
    ranges = np.full(len(directions), np.inf)
    for n in range(len(directions)):
        dx, dy = directions[n, 0], directions[n, 1]
        for m in range(len(sides)):
            ax, ay, ex, ey = starts[m, 0], starts[m, 1], sides[m, 0], sides[m, 1]
            cross = dx * ey - dy * ex
            if cross != 0.0:
                r, u = (ax * ey - ay * ex) / cross, (ax * dy - ay * dx) / cross
                if 0.0 <= u <= 1.0 and nearest < r < ranges[n]:
                    ranges[n] = r
    return ranges
