"""Messages that the package publishes but never reads: map clouds, poses, paths and grids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64
from tccm_ros.ros.pointcloud import MAP_ROW, POINT_ROW, SURFACE_MAP_ROW, cloud_message
from tccm_ros.ros.types import MessageTypes, header_message, pose_message, stamp_message
from tccm_ros.slam.occupancy import OccupancyGrid

OBSTACLE_STEP_M = 0.05
"""Spacing of the points in a cuboid, m. Chosen: the cell of an ordinary costmap."""

MAX_OBSTACLES = 40_000
"""Maximum number of points in ~/obstacles. Chosen: at 12 bytes each, below 0.5 MB."""


def map_cloud_message(
    types: MessageTypes,
    stamp_ns: int,
    frame_id: str,
    tops: ArrayLike,
    depth: ArrayLike,
    count: ArrayLike,
    cycle: ArrayLike,
) -> Any:
    """Return ~/map_cloud, a sensor_msgs/PointCloud2 with a row per cuboid.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    tops
        (N, 3), m: centre of the cell, and top of the cuboid.
    depth
        (N,), m.
    count
        (N,), numbers of points, rounded to integers.
    cycle
        (N,), newest cycle of each cuboid.
    """
    xyz = np.asarray(tops, np.float32).reshape(-1, 3)
    rows = np.zeros(len(xyz), MAP_ROW)
    for k, name in enumerate("xyz"):
        rows[name] = xyz[:, k]
    rows["depth"] = depth
    rows["count"] = np.rint(np.asarray(count, float))
    rows["cycle"] = cycle
    return cloud_message(types, stamp_ns, frame_id, rows)


def obstacle_cloud_message(
    types: MessageTypes, stamp_ns: int, frame_id: str, tops: ArrayLike, depth: ArrayLike
) -> Any:
    """Return ~/obstacles, a sensor_msgs/PointCloud2 that fills each cuboid with points.

    A costmap marks the cells of points within a height range, so a cuboid from the floor to above
    the robot needs points over its whole height.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    tops
        (N, 3), m: centre of the cell, and top of the cuboid.
    depth
        (N,), m. There is a point at the top and one every `OBSTACLE_STEP_M` below it. One point is
        kept per cube of that size; the cubes grow until there are at most `MAX_OBSTACLES` points.
    """
    xyz = _filled(tops, depth)
    size = OBSTACLE_STEP_M
    kept = _one_per_voxel(xyz, size)
    while len(kept) > MAX_OBSTACLES:
        size *= 1.25
        kept = _one_per_voxel(xyz, size)
    rows = np.ascontiguousarray(kept, np.float32).view(POINT_ROW).reshape(-1)
    return cloud_message(types, stamp_ns, frame_id, rows)


def _filled(tops: ArrayLike, depth: ArrayLike) -> Float64:
    """Return points (M, 3) that fill cuboids: one at the top, and one per step below it."""
    steps = np.floor(np.asarray(depth, np.float64) / OBSTACLE_STEP_M + 1e-9).astype(np.int64)
    ends = np.cumsum(steps + 1)
    below = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - steps - 1, steps + 1)
    xyz = np.repeat(np.asarray(tops, np.float64).reshape(-1, 3), steps + 1, axis=0)
    xyz[:, 2] -= OBSTACLE_STEP_M * below
    return xyz


def _one_per_voxel(xyz: Float64, size: float) -> Float64:
    """Return the first of the points (N, 3) in each cube of a size, m, in order."""
    cubes = np.floor(xyz / size + 1e-9).astype(np.int64)
    keys = (cubes[:, 0] << 42) + (cubes[:, 1] << 21) + cubes[:, 2]
    first: Float64 = xyz[np.sort(np.unique(keys, return_index=True)[1])]
    return first


def surface_map_message(
    types: MessageTypes,
    stamp_ns: int,
    frame_id: str,
    points: ArrayLike,
    ids: ArrayLike,
    colors: ArrayLike,
) -> Any:
    """Return ~/surface_cloud, a sensor_msgs/PointCloud2 of points with surface id and colour.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    points
        (N, 3), m.
    ids
        (N,), surface ids.
    colors
        (N, 3), red green blue, 0 to 255.
    """
    xyz = np.asarray(points, np.float32).reshape(-1, 3)
    rows = np.zeros(len(xyz), SURFACE_MAP_ROW)
    for k, name in enumerate("xyz"):
        rows[name] = xyz[:, k]
    rows["id"] = ids
    rgb = np.asarray(colors, np.uint32).reshape(-1, 3)
    rows["rgb"] = rgb[:, 0] << 16 | rgb[:, 1] << 8 | rgb[:, 2]
    return cloud_message(types, stamp_ns, frame_id, rows)


def pose_covariance_message(
    types: MessageTypes, stamp_ns: int, frame_id: str, T_a_b: Float64, cov: ArrayLike
) -> Any:
    """Return a geometry_msgs/PoseWithCovarianceStamped.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    T_a_b
        float64 (4, 4), pose of b in the frame `frame_id`.
    cov
        (6, 6) of (x, y, z, roll, pitch, yaw), or planar (3, 3) of (x, y, yaw); m and rad.
    """
    full = np.asarray(cov, np.float64)
    if full.shape == (3, 3):
        planar, full = full, np.zeros((6, 6))
        full[np.ix_((0, 1, 5), (0, 1, 5))] = planar
    return types.make(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        header=header_message(types, stamp_ns, frame_id),
        pose=types.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=pose_message(types, T_a_b),
            covariance=np.ascontiguousarray(full).ravel(),
        ),
    )


def path_message(
    types: MessageTypes,
    stamp_ns: int,
    frame_id: str,
    stamps_ns: Sequence[int],
    T_a_b: Float64,
) -> Any:
    """Return a nav_msgs/Path.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    stamps_ns
        (N,), stamps of the poses, ns.
    T_a_b
        float64 (N, 4, 4), poses in the frame `frame_id`.
    """
    poses = [
        types.make(
            "geometry_msgs/msg/PoseStamped",
            header=header_message(types, int(stamp), frame_id),
            pose=pose_message(types, T),
        )
        for stamp, T in zip(stamps_ns, T_a_b)
    ]
    header = header_message(types, stamp_ns, frame_id)
    return types.make("nav_msgs/msg/Path", header=header, poses=poses)


def grid_message(types: MessageTypes, stamp_ns: int, frame_id: str, grid: OccupancyGrid) -> Any:
    """Return a nav_msgs/OccupancyGrid of a grid in the frame `frame_id`."""
    T_map_corner = np.eye(4)
    T_map_corner[:2, 3] = grid.origin
    info = types.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=stamp_message(types, stamp_ns),
        resolution=float(grid.resolution),
        width=int(grid.cells.shape[1]),
        height=int(grid.cells.shape[0]),
        origin=pose_message(types, T_map_corner),
    )
    return types.make(
        "nav_msgs/msg/OccupancyGrid",
        header=header_message(types, stamp_ns, frame_id),
        info=info,
        data=types.array("i1", grid.cells.ravel()),
    )
