"""Intersection over union of planar outlines."""

import numpy as np
import shapely
from numpy.typing import NDArray

from tccm_ros.arrays import Float64, Int64


def overlaps(
    first: list[Float64], normals: Float64, second: list[Float64], pairs: Int64
) -> Float64:
    """Return the common area of pairs of planar rings, as a fraction of their union.

    A pair is projected along the axis that is nearest to the normal of its first ring, which does
    not change the ratio of areas.

    Parameters
    ----------
    first, second
        Rings float64 (N, 3), N > 2, m.
    normals
        float64 (A, 3), of the first rings.
    pairs
        int64 (P, 2), a ring of `first` and one of `second`.

    Returns
    -------
    float64 (P,), 0 to 1.
    """
    found = np.zeros(len(pairs))
    axis = np.abs(normals).argmax(axis=1)[pairs[:, 0]]
    for k in range(3):
        one, other = pairs[axis == k].T
        a, b = _projected(first, one, k), _projected(second, other, k)
        shared = shapely.area(shapely.intersection(a, b))
        union = shapely.area(a) + shapely.area(b) - shared
        found[axis == k] = np.divide(shared, union, out=np.zeros(len(a)), where=union > 0.0)
    return found


def _projected(rings: list[Float64], chosen: Int64, axis: int) -> NDArray[np.object_]:
    """Return the chosen rings as polygons, seen along an axis, object (P,)."""
    used, of = np.unique(chosen, return_inverse=True)
    seen = [c for c in range(3) if c != axis]
    polygons = np.array([shapely.Polygon(rings[k][:, seen]) for k in used], object)
    is_invalid = ~shapely.is_valid(polygons)
    polygons[is_invalid] = shapely.make_valid(polygons[is_invalid])
    return polygons[of]
