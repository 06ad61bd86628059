"""Surfaces with given outlines."""

import numpy as np
import shapely
from shapely import box

from tccm_ros.records import Surface

L_SHAPE = shapely.union_all([box(0, 0, 2.4, 0.6), box(1.8, -2.1, 2.4, 0.6)])


RECTANGLE_WITH_HOLE = box(0, 0, 2, 1).difference(box(0.4, 0.2, 1.6, 0.8))


def surface(polygon, slope=(0.0, 0.0), height=0.74, label="table", number=3):
    """Return a surface with an outline; `slope` is the rise of its plane along x and y."""
    normal = np.array([-slope[0], -slope[1], 1.0])
    normal /= np.linalg.norm(normal)
    centroid = np.array([*polygon.centroid.coords[0], height])
    offset = float(normal @ centroid)

    def lift(ring):
        xy = np.asarray(ring.coords)[:-1]
        return np.column_stack([xy, (offset - xy @ normal[:2]) / normal[2]])

    polygon = shapely.geometry.polygon.orient(polygon)
    return Surface(
        id=number, label=label, confidence=0.9, height=height, normal=normal, offset=offset,
        area=polygon.area, centroid=centroid, boundary=lift(polygon.exterior),
        holes=tuple(map(lift, polygon.interiors)), points=100, height_std=0.0, first_seen_ns=1,
        last_seen_ns=2, views=(),
    )  # fmt: skip
