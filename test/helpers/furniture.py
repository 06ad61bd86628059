"""Surfaces of furniture with the errors of mapped surfaces."""

import numpy as np

from tccm_ros.surfaces.merging.merged_surface import MergedSurface


def noisy_surface(polygon, height, rng):
    """Return a surface with an outline up to 2 cm too small and a height error of 3 mm."""
    seen = polygon.buffer(-rng.uniform(0.0, 0.02))
    x, y, z = *seen.centroid.coords[0], height + rng.normal(0.0, 0.003)
    normal = np.array([0.0, 0.0, 1.0])
    return MergedSurface((), seen, np.array([x, y, z]), np.eye(3), normal, z, 1000)
