"""Plane detection by pooled moments.

Read in this order: `fits` is what users call; `search` is the kernel behind it, and its steps are
`blocks`, `region_growing`, `inliers`, `vertical_patches` and `vertical_planes`, `reassignment` and
`edge_planes`. After each tilt cycle follow `tracking` and, for the surface message,
`horizontal_strips`, `plane_noise` and `wall_contact`.

The kernels stay ours: all planes of a room are found in a 27th to a 40th of the time that PCL takes
for the largest one, and in a region of interest in a half to a fifth (`bench/bench_planes.py`,
figures in docs/design/planes.md).
"""

from tccm_ros.planes.fits import PlaneFit, PlaneFits, find_planes

__all__ = ["PlaneFit", "PlaneFits", "find_planes"]
