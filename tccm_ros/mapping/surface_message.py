"""What a tilt cycle hands over to the surface map (DESIGN section 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.baselines.seed_segmentation import segment
from tccm_ros.config import Config
from tccm_ros.cuboids.beams import sweep_beams
from tccm_ros.cuboids.cycle_builder import Sweep
from tccm_ros.cuboids.free_intervals import FreeColumns
from tccm_ros.cuboids.merging import owners
from tccm_ros.cuboids.part import PartMap
from tccm_ros.geometry import inverse, transform
from tccm_ros.planes import PlaneFit, PlaneFits
from tccm_ros.planes.level_strips import level_strips
from tccm_ros.planes.plane_noise import are_too_thick
from tccm_ros.planes.wall_contact import beside_boards
from tccm_ros.records import SurfaceCloud, ViewIntervals

__all__ = ["plane_labels", "surface_cloud", "view_intervals"]

Float64 = NDArray[np.float64]

PLANE_SIGMAS = 3.0
"""Points further from their plane than this many times its rms are not handed over,"""

PLANE_SLACK = 0.005
"""plus this, m: the rms of a clean plane is that of its noise alone."""

UPRIGHT = 0.35
"""Planes with a smaller vertical component of the normal stand: no strip lies on them."""

BEAMS_PER_COLUMN = 2.0
"""Beams per column at the end of the reach are enough to see through."""


def plane_labels(part: PartMap, fits: PlaneFits) -> NDArray[np.int32]:
    """Return the plane of the map at each of the part map's cuboids, int32 (N,), -1 for none.

    A part map's cuboid lies within one cuboid of the map that it was added to.
    """
    if len(fits.cuboids) == 0 or len(part) == 0:
        return np.full(len(part), -1, np.int32)
    c = fits.cuboids
    return fits.labels[owners(c.ix, c.iy, c.bottom, part.keys, part.bounds)]


def surface_cloud(
    sweep: Sweep,
    fits: PlaneFits,
    config: Config,
    T_odom_base: Float64,
    viewpoint: Float64,
    frame_id: str,
    wanted: bool,
) -> SurfaceCloud:
    """Return the points of the horizontal surfaces that the newest part map saw.

    Parameters
    ----------
    sweep
        The newest cycle.
    fits
        Planes of the map, in odom.
    config
        `surfaces.segmentation` says whether these planes tell the surfaces, or the published
        pipeline.
    T_odom_base
        float64 (4, 4), the base at the stamp.
    viewpoint
        float64 (3,), the laser in odom: of surfaces above it only the underside is seen.
    frame_id
        The base frame.
    wanted
        Otherwise the cloud is empty.
    """
    part, T_base_odom = sweep.part, inverse(T_odom_base)
    points, surface = np.zeros((0, 3)), np.zeros(0, np.int64)
    levels = [f for f in fits if f.kind == "horizontal" and f.normal @ viewpoint > f.offset]
    if wanted and part.points is not None and len(part.points):
        if config.surfaces.segmentation == "seed":
            points = transform(T_base_odom, part.positions())
            labels = segment(points, config)
            points, surface = points[labels >= 0], labels[labels >= 0].astype(np.int64)
        else:
            points, surface = _level_points(part, fits, levels, viewpoint)
            points = transform(T_base_odom, points)
    return SurfaceCloud(
        sweep.stamp_ns, frame_id, points.astype(np.float32), surface.astype(np.uint32)
    )


def _level_points(
    part: PartMap, fits: PlaneFits, levels: list[PlaneFit], viewpoint: Float64
) -> tuple[Float64, NDArray[np.int64]]:
    """Return the points of level planes and strips, and their surface's index, from 0."""
    labels, points = plane_labels(part, fits)[part.point_cuboids()], part.positions()
    normals = np.array([f.normal for f in fits]).reshape(-1, 3)
    offsets, rms = np.array([f.offset for f in fits]), np.array([f.rms for f in fits])
    thick = are_too_thick(points, labels, normals, offsets, rms, viewpoint)
    levels = [f for f in levels if not thick[f.index]]
    stands = np.array([abs(f.normal[2]) < UPRIGHT for f in fits] + [False])
    wanted = np.flatnonzero(~stands[labels])
    labels, points = labels[wanted], points[wanted]
    surface = np.full(len(points), -1, np.int64)
    on = _on_planes(points, labels, levels, len(fits))
    surface[on] = labels[on]
    surface = level_strips(points, part.lines(wanted), surface, viewpoint)
    surface[beside_boards(points, surface, fits, stands)] = -1
    chosen = surface >= 0
    _, surface = np.unique(surface[chosen], return_inverse=True)
    return points[chosen], surface.reshape(-1)


def _on_planes(
    points: Float64, labels: NDArray[np.int32], levels: list[PlaneFit], planes: int
) -> NDArray[np.int64]:
    """Return the rows of the points that are near their plane, where that is one of the levels."""
    is_level = np.zeros(planes + 1, np.bool_)  # the last is for -1
    normals, offsets, slack = np.zeros((planes, 3)), np.zeros(planes), np.zeros(planes)
    for fit in levels:
        is_level[fit.index] = True
        normals[fit.index], offsets[fit.index] = fit.normal, fit.offset
        slack[fit.index] = PLANE_SIGMAS * fit.rms + PLANE_SLACK
    chosen = np.flatnonzero(is_level[labels])
    of = labels[chosen]
    distance = np.abs(np.einsum("ij,ij->i", points[chosen], normals[of]) - offsets[of])
    return chosen[distance <= slack[of]]


def view_intervals(
    sweep: Sweep, config: Config, T_odom_base: Float64, frame_id: str
) -> ViewIntervals:
    """Return what the beams of a sweep saw through, in the base frame at the sweep's stamp."""
    columns = FreeColumns(config.views.cell_size, config.views.reach)
    T_base_odom = inverse(T_odom_base)
    # Half again: the reach is a distance on the floor, the beam goes down as well.
    longest = 1.5 * min(config.views.reach, config.scan.max_range)
    for scan in sweep.scans:
        spacing = abs(scan.posed.scan.angle_increment) * config.views.reach * BEAMS_PER_COLUMN
        every = max(int(config.views.cell_size / max(spacing, 1e-9)), 1)
        columns.add(*sweep_beams(scan, longest, every, T_base_odom))
    return ViewIntervals(sweep.stamp_ns, frame_id, columns.intervals(sweep.angle_step()))
