"""Plane detection by pooled moments.

Read in this order: `fits` is what users call; `search` is the kernel behind it, and its steps are
`blocks`, `growth`, `members`, `places`, `equations` and `standing` (upright planes), `disputes` and
`edges`.
"""

from tccm_ros.planes.fits import PlaneFit, PlaneFits, find_planes, select, without_plane

__all__ = ["PlaneFit", "PlaneFits", "find_planes", "select", "without_plane"]
