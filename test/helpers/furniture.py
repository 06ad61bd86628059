"""Surfaces of furniture as a map has them."""

import numpy as np

from tccm_ros.surfaces.merged_surface import MergedSurface


def merged(polygon, height, rng):
    """A surface as a map has it: the outline loses a few centimetres, the height some mm."""
    seen = polygon.buffer(-rng.uniform(0.0, 0.02))
    x, y, z = *seen.centroid.coords[0], height + rng.normal(0.0, 0.003)
    normal = np.array([0.0, 0.0, 1.0])
    return MergedSurface((), seen, np.array([x, y, z]), np.eye(3), normal, z, 1000)
