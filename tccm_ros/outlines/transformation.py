"""Outlines in another frame, seen from above."""

from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Float64


def transform_outline(T_a_b: Float64, outline_b: BaseGeometry, z: float = 0.0) -> BaseGeometry:
    """Return x and y in frame a of an outline at height `z`, m, of frame b.

    Parameters
    ----------
    T_a_b
        float64 (4, 4)
    outline_b
        Its x and y in b, m.
    """
    (a, b), (c, d) = T_a_b[:2, :2]
    return affine_transform(outline_b, [a, b, c, d, *(T_a_b[:2, 3] + T_a_b[:2, 2] * z)])
