"""The common area of two outlines, integrated along parallel lines.

All pairs of a tilt cycle's planes and tracks are compared in one compiled call; shapely would need
two polygons and an intersection for each pair.
"""

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.cuboids.moments import tangents
from tccm_ros.kernels import kernel
from tccm_ros.outlines.rings import signed_area

LINES = 48
"""Number of lines across the common extent of both outlines. Chosen: enough to find the outline
with the largest overlap."""


@kernel
def overlap_fractions(
    a: Float64, ends_a: Int64, normals: Float64, b: Float64, ends_b: Int64, pairs: Int64
) -> Float64:
    """Return the common area of pairs of planar rings, as a fraction of the smaller area.

    Parameters
    ----------
    a, ends_a
        float64 (V, 3), corners of rings, m, and int64 (A,), the index at which each ring ends.
    normals
        float64 (A, 3), unit; a pair is projected along the normal of its first ring.
    b, ends_b
        The other rings, as `a` and `ends_a`.
    pairs
        int64 (P, 2), a ring of `a` and one of `b`.

    Returns
    -------
    float64 (P,), 0 to 1.
    """
    fractions = np.empty(len(pairs))
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        u, v = tangents(normals[i])
        first = project_ring(a[ends_a[i - 1] if i else 0 : ends_a[i]], u, v)
        second = project_ring(b[ends_b[j - 1] if j else 0 : ends_b[j]], u, v)
        fractions[k] = overlap_fraction(first, second)
    return fractions


@kernel
def project_ring(ring: Float64, u: Float64, v: Float64) -> Float64:
    """Return the coordinates of a ring along two directions.

    Parameters
    ----------
    ring
        float64 (N, 3), m.
    u, v
        float64 (3,), unit.

    Returns
    -------
    float64 (N, 2), m.
    """
    out = np.empty((len(ring), 2))
    for i in range(len(ring)):
        x, y, z = ring[i, 0], ring[i, 1], ring[i, 2]
        out[i, 0] = x * u[0] + y * u[1] + z * u[2]
        out[i, 1] = x * v[0] + y * v[1] + z * v[2]
    return out


@kernel
def overlap_fraction(a: Float64, b: Float64) -> float:
    """Return the common area of two rings (N, 2), as a fraction of the smaller area, 0 to 1.

    The inside is defined by the even-odd rule, so that rings may self-intersect.
    """
    if len(a) < 3 or len(b) < 3:
        return 0.0
    low, high = max(a[:, 1].min(), b[:, 1].min()), min(a[:, 1].max(), b[:, 1].max())
    if low >= high or max(a[:, 0].min(), b[:, 0].min()) >= min(a[:, 0].max(), b[:, 0].max()):
        return 0.0
    smaller = min(abs(signed_area(a)), abs(signed_area(b)))
    if smaller <= 0.0:
        return 0.0
    cuts_a, cuts_b = np.empty(len(a)), np.empty(len(b))
    total, step = 0.0, (high - low) / LINES
    for line in range(LINES):
        y = low + (line + 0.5) * step
        total += shared_length(cuts_a[: cut_ring(a, y, cuts_a)], cuts_b[: cut_ring(b, y, cuts_b)])
    return min(total * step / smaller, 1.0)


@kernel
def cut_ring(ring: Float64, y: float, cuts: Float64) -> int:
    """Compute the crossings of a ring with a line of constant y.

    Parameters
    ----------
    ring
        float64 (N, 2).
    y
        Coordinate of the line.
    cuts
        float64 (>= N,), receives x of the crossings, ascending.

    Returns
    -------
    int
        Number of crossings.
    """
    n, j = 0, len(ring) - 1
    for i in range(len(ring)):
        if (ring[i, 1] > y) != (ring[j, 1] > y):
            t = (y - ring[i, 1]) / (ring[j, 1] - ring[i, 1])
            x = ring[i, 0] + t * (ring[j, 0] - ring[i, 0])
            k = n
            while k > 0 and cuts[k - 1] > x:
                cuts[k] = cuts[k - 1]
                k -= 1
            cuts[k] = x
            n += 1
        j = i
    return n


@kernel
def shared_length(a: Float64, b: Float64) -> float:
    """Return the common length of two sets of intervals, given by their sorted ends."""
    i, j, total = 0, 0, 0.0
    while i + 1 < len(a) and j + 1 < len(b):
        total += max(min(a[i + 1], b[j + 1]) - max(a[i], b[j]), 0.0)
        if a[i + 1] < b[j + 1]:
            i += 2
        else:
            j += 2
    return total
