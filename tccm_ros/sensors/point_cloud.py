"""Point clouds of lidars and cameras: their streams, and conversion of records to points in odom.

Each point has the pose at its own time. Points are thinned to the resolution of the map.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float32, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.kernels import kernel
from tccm_ros.records import PointCloud, Posed, SensorKind
from tccm_ros.robot import MountKind, Stream
from tccm_ros.sensors.cloud_messages import CLOUD_READER, MIN_RANGE, has_returned
from tccm_ros.sensors.laser_scan_kernels import refine_poses
from tccm_ros.sensors.measured import MeasuredPoints, in_region, without_robot

MAX_LINES = 10_000
"""Maximum number of traced rays of a cloud. Chosen: one for each column at `views.reach`."""

ELEVATION_BIN = math.radians(0.1)
"""Resolution of elevations, rad: the finest lidars have a ring each 0.1 deg."""

VOXELS_PER_CELL = 4
"""Voxels along the edge of a cell; each voxel keeps one point."""


MAX_WAITING = 50
"""Maximum number of waiting clouds: 80 MB of 130,000 points."""


class PosedCloud(Posed):
    """A point cloud with the poses of its sensor."""

    __slots__ = ()
    sensor_kind = SensorKind.POINT_CLOUD

    @property
    def cloud(self) -> PointCloud:
        """The cloud."""
        cloud: PointCloud = self.record
        return cloud


def time_span(cloud: PointCloud) -> tuple[int, int]:
    """Return the times of the first and the last point, ns."""
    return cloud.time_span


NOTHING_SEEN = "nothing seen"
TOO_FAR = "points beyond scan.max_range: are they millimetres?"
"""Reasons of dropped clouds."""

LOST_FRACTION = 0.01
"""If a smaller fraction of a cloud's points is within range, the unit is wrong."""


def rejection_reason(cloud: PointCloud, max_range: float = math.inf) -> str | None:
    """Return why a cloud is rejected; None if it is not. `max_range` is in m."""
    if not len(cloud.points):
        return "empty"
    is_point = has_returned(cloud.points)
    points = np.count_nonzero(is_point)
    if not points:
        return NOTHING_SEEN
    square = np.einsum("ij,ij->i", cloud.points, cloud.points)
    within = np.count_nonzero(is_point & (square <= max_range**2))
    return TOO_FAR if within < LOST_FRACTION * points else None


def remark(cloud: PointCloud) -> str | None:
    """Return a remark on an unusual cloud that is used anyway; None for a usual one."""
    return cloud.remark or None


def at_once(cloud: PointCloud) -> PointCloud:
    """Return a cloud with all points at its stamp."""
    return replace(cloud, since_ns=None)


def cloud_stream(topic: str, config: Config | None = None, *, can_be_base: bool = False) -> Stream:
    """Return the stream of the point clouds on a topic, whose name is the role of the stream.

    The configuration gives `scan.max_range`.
    """
    max_range = (config or Config()).scan.max_range
    return Stream(
        role=topic,
        record=PointCloud,
        reader=CLOUD_READER,
        mount=MountKind.ANY,
        processor="tccm",
        event=PosedCloud,
        time_span=time_span,
        rejection_reason=partial(rejection_reason, max_range=max_range),
        remark=remark,
        at_once=at_once,
        sees_robot=True,
        max_waiting=MAX_WAITING,
        can_be_base=can_be_base,
    )


class PlacedPoints(NamedTuple):
    """The points of a cloud within range, and their viewpoints.

    Attributes
    ----------
    points, origins
        float64 (N, 3), the points, and the sensor's position at the time of each, in odom, m.
    indices
        int64 (N,), row indices of the cloud.
    """

    points: Float64
    origins: Float64
    indices: Int64


def placed_points(posed: PosedCloud, config: Config) -> PlacedPoints:
    """Return the points of a cloud within range, each with the pose at its own time."""
    cloud = posed.cloud
    times, T = refine_poses(
        (posed.pose_stamps_ns - cloud.stamp_ns) * 1e-9,
        np.ascontiguousarray(posed.T_odom_base @ posed.T_base_sensor),
    )
    since_ns = np.zeros(0, np.int64) if cloud.since_ns is None else cloud.since_ns
    points = np.empty((len(cloud.points), 3))
    origins, indices = np.empty_like(points), np.empty(len(points), np.int64)
    # Kernels are compiled for writable arrays only.
    xyz = cloud.points if cloud.points.flags.writeable else cloud.points.copy()
    args = xyz, since_ns, *_limits(config), times, T
    n = place_points(*args, points, origins, indices)
    return PlacedPoints(points[:n], origins[:n], indices[:n])


def measure_cloud(posed: PosedCloud, config: Config) -> MeasuredPoints:
    """Return the points of a cloud in odom, and a sample of its rays."""
    cloud, placed = posed.cloud, placed_points(posed, config)
    every = max(len(placed.points) // MAX_LINES, 1)
    ends = placed.points[::every].copy()
    kept = first_in_voxels(placed.points, config.map.cell_size / VOXELS_PER_CELL)
    stamps_ns = None
    if cloud.since_ns is not None:
        stamps_ns = cloud.stamp_ns + cloud.since_ns[placed.indices[kept]]
    line_angle = angle_between_rings(cloud.points, *_limits(config))
    points = placed.points[kept]
    measured = MeasuredPoints(
        points=points,
        stamps_ns=stamps_ns,
        origins=placed.origins[::every].copy(),
        ends=ends,
        hits=np.ones(len(ends), np.bool_),
        line_angle=line_angle,
        gaps=line_angle * np.linalg.norm(points - placed.origins[kept], axis=1),
    )
    return in_region(without_robot(measured, posed, config), posed, config)


def _limits(config: Config) -> tuple[float, float]:
    return max(config.scan.min_range, MIN_RANGE), config.scan.max_range


def angle_between_rings(xyz: Float32, low: float, high: float) -> float:
    """Return the angle between the rings of a lidar, rad; `ELEVATION_BIN` where it has no rings.

    The median step between occupied elevation bins. Range noise is along the beam, so that a ring
    occupies one bin.

    Parameters
    ----------
    xyz
        float32 (N, 3), in the sensor's frame, m.
    low, high
        Range limits of the points to use, m.
    """
    square = np.einsum("ij,ij->i", xyz, xyz)
    seen = xyz[(square >= low * low) & (square <= high * high)]
    elevations = np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))
    bins = np.unique(np.floor(elevations / ELEVATION_BIN).astype(np.int64))
    steps = np.diff(bins)
    steps = steps[steps > 1] if (steps > 1).sum() > len(steps) // 4 else steps
    return ELEVATION_BIN * float(np.median(steps)) if len(steps) else ELEVATION_BIN


@kernel
def place_points(
    xyz: Any, since_ns: Any, low: Any, high: Any, times: Any, T: Any,
    points: Any, origins: Any, indices: Any,
) -> Any:  # fmt: skip
    """Transform points with the pose at their own time, and return their number.

    Parameters
    ----------
    xyz
        float32 (N, 3), m, in the sensor's frame; points that are not finite are left out.
    since_ns
        int64 (N,), times of the points on the clock of `times`, ns; empty where all are 0.
    low, high
        Limits of the range, m.
    times, T
        float64 (M,), s, increasing, and (M, 3, 4): poses of the sensor, blended linearly.
    points, origins, indices
        float64 (N, 3) points, float64 (N, 3) viewpoints, and int64 (N,) row indices; written.
    """
    last, n = len(times) - 1, 0
    for i in range(len(xyz)):
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        square = x * x + y * y + z * z
        if not low * low <= square <= high * high:
            continue
        k, f = 0, 0.0
        if last > 0 and len(since_ns):
            time = since_ns[i] * 1e-9
            k = min(max(np.searchsorted(times, time, "right") - 1, 0), last - 1)
            f = min(max((time - times[k]) / (times[k + 1] - times[k]), 0.0), 1.0)
        A, B = T[k], T[min(k + 1, last)]
        for j in range(3):
            a = A[j, 0] * x + A[j, 1] * y + A[j, 2] * z + A[j, 3]
            b = B[j, 0] * x + B[j, 1] * y + B[j, 2] * z + B[j, 3]
            points[n, j] = a + f * (b - a)
            origins[n, j] = A[j, 3] + f * (B[j, 3] - A[j, 3])
        indices[n] = i
        n += 1
    return n


@kernel
def first_in_voxels(points: Any, edge: Any) -> Any:
    """Return the indices of the first point in each voxel, int64, in order of the points."""
    size = 16
    while size < 2 * len(points):
        size *= 2
    table = np.full(size, -1, np.int64)
    keys = np.empty(len(points), np.int64)
    kept = np.empty(len(points), np.int64)
    n, mask = 0, size - 1
    for i in range(len(points)):
        ix = np.int64(np.floor(points[i, 0] / edge)) & 0x1FFFFF
        iy = np.int64(np.floor(points[i, 1] / edge)) & 0x1FFFFF
        iz = np.int64(np.floor(points[i, 2] / edge)) & 0x1FFFFF
        keys[i] = (ix << 42) | (iy << 21) | iz
        mixed = np.uint64(keys[i]) * np.uint64(0x9E3779B97F4A7C15)
        slot = np.int64(mixed >> np.uint64(20)) & mask
        while table[slot] >= 0 and keys[table[slot]] != keys[i]:
            slot = (slot + 1) & mask
        if table[slot] < 0:
            table[slot] = i
            kept[n] = i
            n += 1
    return kept[:n]
