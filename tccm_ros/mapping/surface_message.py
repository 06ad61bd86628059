"""Surface message of a tilt cycle: points, free intervals, objects (docs/reference/nodes.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from tccm_ros.arrays import Bool, Float32, Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cycle_builder import TiltCycleData
from tccm_ros.cuboids.free_intervals import FreeIntervalTracer
from tccm_ros.cuboids.inclination import SEEN_AS_WALL
from tccm_ros.cuboids.merging import owners
from tccm_ros.cuboids.part_map import PartMap
from tccm_ros.geometry import inverse, transform, transform_plan
from tccm_ros.planes import PlaneFit, PlaneFits
from tccm_ros.planes.front_tops import on_walls, top_planes
from tccm_ros.planes.horizontal_strips import horizontal_strips
from tccm_ros.planes.plane_noise import are_too_thick, range_noise
from tccm_ros.records import (
    HITS_CUBE,
    ObjectBoxes,
    PlaneKind,
    PlaneRecord,
    SensorKind,
    SurfaceCloud,
    TabletopObject,
    ViewIntervals,
)
from tccm_ros.sensors.noise import depth_noise
from tccm_ros.sensors.point_cloud import first_in_voxels
from tccm_ros.tabletop.objects import find_objects

Segmentation = Callable[[Float64], Int32]
"""Function from points float64 (N, 3), m, in the base frame, to surface indices int32 (N,), -1 for
none."""

PLANE_SIGMAS = 3.0
"""Points further from their plane than this multiple of its rms plus `PLANE_SLACK` are outliers of
the surface. Chosen: rejects 0.3 % of Gaussian noise."""

PLANE_SLACK = 0.005
"""Tolerance of `PLANE_SIGMAS` for surfaces that are not perfectly flat, m; the rms of a clean plane
contains only sensor noise. Chosen."""

BEAMS_PER_COLUMN = 2.0
"""Beams of a scan per column at the distance `views.reach`; further beams are not traced. Chosen.
"""

HITS_DISTANCE = 0.4
"""Hits within this horizontal distance of a surface are kept, m; the grid keeps some up to twice as
far. Chosen: an open door of a cupboard."""

CLOSE = 0.1
"""Minimum distance of a sensor from a hit, m: the range limit of close sensors."""

HITS_FROM, HITS_TO = 0.15, 2.2
"""Range of heights of hits above z = 0 of the base, m. Chosen: the workspace of arms."""


def plane_labels(part: PartMap, fits: PlaneFits) -> Int32:
    """Return the plane index of each cuboid of a part map, int32 (N,), -1 for none.

    Each cuboid of a part map lies within one cuboid of the map that contains it.
    """
    if len(fits.cuboids) == 0 or len(part) == 0:
        return np.full(len(part), -1, np.int32)
    return fits.labels[_map_cuboids(part, fits)]


def _map_cuboids(part: PartMap, fits: PlaneFits) -> Int64:
    """Return the index of the map's cuboid that contains each part map cuboid, int64 (N,).

    Both maps have at least one cuboid.
    """
    c = fits.cuboids
    return np.asarray(owners(c.ix, c.iy, c.bottom, part.keys, part.bounds), np.int64)


def surface_cloud(
    cycle: TiltCycleData,
    fits: PlaneFits,
    T_odom_base: Float64,
    viewpoint: Float64,
    frame_id: str,
    wanted: bool,
    config: Config,
    segmentation: Segmentation | None = None,
) -> SurfaceCloud:
    """Return the points of the horizontal surfaces that the newest part map saw.

    Parameters
    ----------
    cycle
        The newest tilt cycle.
    fits
        Planes of the map, in odom.
    T_odom_base
        float64 (4, 4), the base at the stamp.
    viewpoint
        float64 (3,), position of the laser in odom; surfaces above it are seen from below.
    frame_id
        The base frame.
    wanted
        Whether the cloud is needed; otherwise it is empty.
    config
        Uses `views.voxel_size` and `sensors.depth_sigma`.
    segmentation
        Function that finds the surfaces instead of the planes.
    """
    part, T_base_odom = cycle.part, inverse(T_odom_base)
    points, surface = np.zeros((0, 3)), np.zeros(0, np.int64)
    if wanted and part.points is not None and len(part.points):
        if segmentation is not None:
            points = transform(T_base_odom, part.positions())
            labels = segmentation(points)
            points, surface = points[labels >= 0], labels[labels >= 0].astype(np.int64)
        else:
            points, surface = _horizontal_points(cycle, fits, viewpoint, config)
            points = transform(T_base_odom, points)
    return SurfaceCloud(
        cycle.stamp_ns,
        frame_id,
        points.astype(np.float32),
        surface.astype(np.uint32),
        transform(T_base_odom, viewpoint[None])[0].astype(np.float32) if len(points) else None,
        cycle.sensor_kind() if len(points) else SensorKind.LASER,
    )


def _horizontal_points(
    cycle: TiltCycleData, fits: PlaneFits, viewpoint: Float64, config: Config
) -> tuple[Float64, Int64]:
    """Return the points of horizontal planes and strips, and their surface indices, from 0.

    Strips consist of scan lines. A camera measures the same points with each image, so other points
    are thinned to one per voxel of edge `views.voxel_size`.
    """
    part, voxel = cycle.part, config.views.voxel_size
    labels, points = plane_labels(part, fits)[part.point_cuboids()], part.positions()
    record = part.lines(np.arange(len(points)))
    is_depth, in_line = cycle.is_of(SensorKind.DEPTH_IMAGE)[record], cycle.is_line()[record]
    is_wall = np.array([abs(f.normal[2]) < SEEN_AS_WALL for f in fits] + [False])
    on_planes, seen = _on_thin_planes(points, labels, is_depth, fits, viewpoint, config)
    with_strips = on_planes.copy()
    rows = np.flatnonzero(~is_wall[labels] & in_line)
    with_strips[rows] = horizontal_strips(
        points[rows], part.lines(rows), on_planes[rows], viewpoint
    )
    map_cuboid = _map_cuboids(part, fits)[part.point_cuboids()]
    surface = _kept(points, in_line, with_strips, voxel)
    surface[on_walls(points, map_cuboid, surface, fits)] = -1
    if seen:
        tops = top_planes(points, map_cuboid, labels, surface, in_line, seen, fits, viewpoint)
        surface = np.maximum(surface, _kept(points, in_line, tops, voxel))
    is_surface = surface >= 0
    _, number = np.unique(surface[is_surface], return_inverse=True)
    return points[is_surface], number.reshape(-1)


def _on_thin_planes(
    points: Float64,
    labels: Int32,
    is_depth: Bool,
    fits: PlaneFits,
    viewpoint: Float64,
    config: Config,
) -> tuple[Int64, list[PlaneFit]]:
    """Return the plane of each inlier, else -1, and the horizontal planes seen from above.

    Planes that are thicker than noise are left out.
    """
    seen = [f for f in fits if f.kind == PlaneKind.HORIZONTAL and f.normal @ viewpoint > f.offset]
    plane = np.full(len(points), -1, np.int64)
    inliers = _on_planes(points, labels, seen, len(fits))
    plane[inliers] = labels[inliers]
    is_thick = _are_too_thick(points, labels, plane, is_depth, fits, viewpoint, config)
    plane[is_thick[plane]] = -1
    return plane, [f for f in seen if not is_thick[f.index]]


def _are_too_thick(
    points: Float64,
    labels: Int32,
    surface: Int64,
    is_depth: Bool,
    fits: PlaneFits,
    viewpoint: Float64,
    config: Config,
) -> Bool:
    """Return which planes are too thick, bool (F + 1,); the last entry: points on no plane.

    Depths have the noise of their sensor; all other ranges have one noise, which the planes give.
    """
    normals = np.array([f.normal for f in fits]).reshape(-1, 3)
    offsets, rms = np.array([f.offset for f in fits]), np.array([f.rms for f in fits])
    sigma = depth_noise(np.linalg.norm(points - viewpoint, axis=1), config)
    if not is_depth.all():
        noise = range_noise(points, labels, normals, offsets, rms, viewpoint)
        sigma = np.where(is_depth, sigma, noise)
    of_plane = surface.astype(np.int32)
    thick = are_too_thick(points, of_plane, normals, offsets, sigma, viewpoint)
    return np.append(thick, False)


def _kept(points: Float64, in_line: Bool, surface: Int64, voxel: float) -> Int64:
    """Return the surface indices; outside scan lines, only one point per voxel keeps its index."""
    dense = np.flatnonzero(~in_line & (surface >= 0))
    is_kept = in_line.copy()
    is_kept[dense[first_in_voxels(points[dense], voxel)]] = True
    return np.where(is_kept, surface, -1)


def _on_planes(points: Float64, labels: Int32, chosen: list[PlaneFit], planes: int) -> Int64:
    """Return the rows of the inliers of the chosen planes, int64 (K,)."""
    is_chosen = np.zeros(planes + 1, np.bool_)  # the last is for -1
    normals, offsets, slack = np.zeros((planes, 3)), np.zeros(planes), np.zeros(planes)
    for fit in chosen:
        is_chosen[fit.index] = True
        normals[fit.index], offsets[fit.index] = fit.normal, fit.offset
        slack[fit.index] = PLANE_SIGMAS * fit.rms + PLANE_SLACK
    rows = np.flatnonzero(is_chosen[labels])
    plane = labels[rows]
    distance = np.abs(np.einsum("ij,ij->i", points[rows], normals[plane]) - offsets[plane])
    return rows[distance <= slack[plane]]


def view_intervals(
    cycle: TiltCycleData, config: Config, T_odom_base: Float64, frame_id: str
) -> ViewIntervals:
    """Return the free intervals along a tilt cycle's beams, in the base frame at the cycle's stamp.

    Parameters
    ----------
    cycle
        The tilt cycle.
    config
        Group `views`, and `scan.max_range`.
    T_odom_base
        float64 (4, 4), the base at the cycle's stamp.
    frame_id
        Name of the base frame.
    """
    columns = FreeIntervalTracer(config.views.cell_size, config.views.reach)
    T_base_odom = inverse(T_odom_base)
    # `views.reach` is a distance on the floor; a beam that also descends is up to 1.5 times as
    # long.
    longest = 1.5 * min(config.views.reach, config.scan.max_range)
    enough = config.views.cell_size, config.views.reach * BEAMS_PER_COLUMN
    for record in cycle.records:
        columns.add(*record.rays(longest, enough, T_base_odom))
    return ViewIntervals(cycle.stamp_ns, frame_id, columns.intervals(cycle.angle_step()))


def hits_near(
    cycle: TiltCycleData, fits: PlaneFits, surfaces: SurfaceCloud, T_odom_base: Float64
) -> Float32:
    """Return the hits of a tilt cycle near its horizontal surfaces, without the floor.

    Parameters
    ----------
    cycle
        The tilt cycle.
    fits
        Planes of the map, in odom. Points at the heights of horizontal planes are combined
        separately.
    surfaces
        Surface message of the cycle.
    T_odom_base
        float64 (4, 4), the base at the cycle's stamp.

    Returns
    -------
    float32 (M, 4)
        Rows of `ViewIntervals.hits`, in the base frame, in the order of their cubes.
    """
    tops = surfaces.points[surfaces.points[:, 2] > HITS_FROM].astype(np.float64)
    if not len(tops) or cycle.part.points is None:
        return np.zeros((0, 4), np.float32)
    in_odom = cycle.part.positions()
    points = transform(inverse(T_odom_base), in_odom)
    rows = np.flatnonzero((points[:, 2] > HITS_FROM) & (points[:, 2] < HITS_TO))
    corner = np.floor(tops[:, :2].min(axis=0) / HITS_DISTANCE).astype(np.int64) - 1
    cells = np.floor(tops[:, :2] / HITS_DISTANCE).astype(np.int64) - corner
    near = np.zeros(cells.max(axis=0) + 3, np.bool_)  # a border of cells all around
    for x, y in product((-1, 0, 1), repeat=2):
        near[cells[:, 0] + 1 + x, cells[:, 1] + 1 + y] = True
    cell = np.floor(points[rows, :2] / HITS_DISTANCE).astype(np.int64) - corner + 1
    inside = ((cell >= 0) & (cell < near.shape)).all(axis=1)
    rows = rows[inside][near[tuple(cell[inside].T)]]
    on_plane = np.zeros(len(rows), np.bool_)
    for fit in fits:
        if fit.kind == PlaneKind.HORIZONTAL:
            slack = PLANE_SIGMAS * fit.rms + PLANE_SLACK
            on_plane |= np.abs(in_odom[rows] @ fit.normal - fit.offset) <= slack
    assert surfaces.viewpoint is not None, "a message with points has one"
    return _cubes(points[rows], on_plane, surfaces.viewpoint.astype(np.float64))


def _cubes(points: Float64, on_plane: Bool, viewpoint: Float64) -> Float32:
    """Return the middle x and y and the lowest and highest z of the points in each cube.

    A cube at the foot of a wall has a row for the plane and one for the wall: their common middle
    is on neither. Errors of ranges move points along their beams. On a vertical face the heights at
    which the beams cross the middle of the points are nearer to each other than those of the
    points, and are taken instead.

    Parameters
    ----------
    points
        float64 (N, 3), m.
    on_plane
        bool (N,), whether a point is at the height of a horizontal plane.
    viewpoint
        float64 (3,), position of the sensor in the same frame, m.
    """
    if not len(points):
        return np.zeros((0, 4), np.float32)
    cubes = np.floor(points / HITS_CUBE).astype(np.int64) + (1 << 19)
    keys = (cubes[:, 0] << 41) | (cubes[:, 1] << 21) | (cubes[:, 2] << 1) | on_plane
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    sums = np.add.reduceat(points[order, :2], first)
    count = np.diff(np.append(first, len(order)))
    z = points[order, 2]
    ranges = np.hypot(*(points[order, :2] - viewpoint[:2]).T)
    middle = np.add.reduceat(ranges, first) / count
    on_face = z + (z - viewpoint[2]) * (np.repeat(middle, count) / np.maximum(ranges, CLOSE) - 1.0)
    ends = np.array(
        [[f.reduceat(heights, first) for f in (np.minimum, np.maximum)] for heights in (z, on_face)]
    )
    is_face = np.ptp(ends[1], axis=0) < np.ptp(ends[0], axis=0)
    low, high = np.where(is_face, ends[1], ends[0])
    return np.column_stack([sums / count[:, None], low, high]).astype(np.float32)


def object_boxes(
    cycle: TiltCycleData,
    fits: PlaneFits,
    planes: Sequence[PlaneRecord],
    config: Config,
    T_odom_base: Float64,
    frame_id: str,
    wanted: bool,
) -> ObjectBoxes:
    """Return the objects that the newest part map measured, at their position in this tilt cycle.

    Objects of the integration map may be `map.window_cycles` old; odometry has drifted since.

    Parameters
    ----------
    cycle
        The newest tilt cycle.
    fits, planes
        Plane fits of the map, in odom, and the tracked planes.
    config
        Group `objects`.
    T_odom_base
        float64 (4, 4), the base at the stamp.
    frame_id
        The base frame.
    wanted
        Whether objects are needed; otherwise the result is empty.
    """
    part = cycle.part
    objects: Sequence[TabletopObject] = ()
    if wanted and len(part):
        labels = plane_labels(part, fits)
        objects = find_objects(part.cuboids(), fits, planes, config, labels)
    T = inverse(T_odom_base)
    center = transform(T, np.array([item.center for item in objects]).reshape(-1, 3))
    half = np.array([0.5 * item.size[2] for item in objects])
    return ObjectBoxes(
        cycle.stamp_ns,
        frame_id,
        tuple(transform_plan(T, item.footprint, float(item.center[2])) for item in objects),
        np.column_stack([center[:, 2] - half, center[:, 2] + half]),
        np.array([item.points for item in objects], np.uint32),
    )
