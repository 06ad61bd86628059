"""Plane detection by pooled moments.

Read in this order: `fits` is what users call; `search` is the kernel behind it, and its steps are
`blocks`, `region_growing`, `inliers`, `vertical_patches` and `vertical_planes`, `reassignment` and
`edge_planes`. What follows each cycle: `tracking`, and for the surface message `horizontal_strips`,
`plane_noise` and `wall_contact`.
"""

from tccm_ros.planes.fits import PlaneFit, PlaneFits, find_planes

__all__ = ["PlaneFit", "PlaneFits", "find_planes"]
