"""Plane detection by pooled moments.

Read in this order: `fits` is the interface; `search` is the kernel behind it, and its steps are
`blocks`, `region_growing`, `inliers`, `vertical_patches` and `vertical_planes`, `reassignment` and
`edge_planes`. After each tilt cycle follow `tracking` and, for the surface message,
`horizontal_strips`, `plane_noise` and `front_tops`.

The kernels are not replaced by PCL: in the time in which PCL finds the largest plane of a room,
they find all planes 8.8 to 12.9 times (PCL with at most 50 trials) or 27 to 40 times (PCL at 99 %
confidence); in a region of interest 1.8 to 5.2 times (`bench/bench_planes.py`,
docs/design/experiments/planes.md).
"""

from tccm_ros.planes.fits import PlaneFit, PlaneFits, find_planes

__all__ = ["PlaneFit", "PlaneFits", "find_planes"]
