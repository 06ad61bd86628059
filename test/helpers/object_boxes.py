"""Objects of a view from boxes."""

import numpy as np

from tccm_ros.records import ObjectBoxes
from tccm_ros.tabletop.free_places import rectangle_corners


def prism(x, y, z, length, width, height, yaw):
    """Return footprint, lower and upper end of a box."""
    ring = rectangle_corners(length, width, yaw) + np.array([x, y])
    return ring, z - height / 2, z + height / 2


def objects_of(stamp_ns, rows, points=50):
    """Return objects from rows (N, 7): middle x, y, z, edges and yaw, in the base frame."""
    prisms = [prism(*row) for row in rows]
    z = np.array([ends for _, *ends in prisms]).reshape(-1, 2)
    counts = np.full(len(prisms), points, np.uint32)
    return ObjectBoxes(stamp_ns, "base", tuple(ring for ring, *_ in prisms), z, counts)
