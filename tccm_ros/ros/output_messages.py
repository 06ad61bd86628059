"""What only goes out: clouds of maps, poses, paths, grids and diagnostics as messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tccm_ros.arrays import Float64
from tccm_ros.ros.pointcloud import MAP_ROW, POINT_ROW, SURFACE_MAP_ROW, cloud_message
from tccm_ros.ros.types import MessageTypes, header_message, pose_message, stamp_message

__all__ = [
    "OBSTACLE_STEP",
    "DiagnosticStatus",
    "diagnostics_message",
    "grid_message",
    "map_cloud_message",
    "obstacle_cloud_message",
    "path_message",
    "pose_covariance_message",
    "surface_map_message",
]

OBSTACLE_STEP = 0.05
"""Points of a cuboid are this far apart, m: a cell of an ordinary costmap."""


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
        (N, 3), m: centre of the cell and upper end of the cuboid.
    depth
        (N,), m.
    count
        (N,), points, rounded to whole ones.
    cycle
        (N,), newest cycle.
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

    A costmap marks where points are, and looks at nothing but their heights: a cuboid that reaches
    from the floor to above the robot needs points all along.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    tops
        (N, 3), m: centre of the cell and upper end of the cuboid.
    depth
        (N,), m; a point at the top, and one each `OBSTACLE_STEP` below it.
    """
    steps = np.floor(np.asarray(depth, np.float64) / OBSTACLE_STEP + 1e-9).astype(np.int64)
    ends = np.cumsum(steps + 1)
    below = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - steps - 1, steps + 1)
    xyz = np.repeat(np.asarray(tops, np.float64).reshape(-1, 3), steps + 1, axis=0)
    xyz[:, 2] -= OBSTACLE_STEP * below
    rows = np.ascontiguousarray(xyz, np.float32).view(POINT_ROW).reshape(-1)
    return cloud_message(types, stamp_ns, frame_id, rows)


def surface_map_message(
    types: MessageTypes,
    stamp_ns: int,
    frame_id: str,
    points: ArrayLike,
    ids: ArrayLike,
    colors: ArrayLike,
) -> Any:
    """Return ~/surface_cloud, a sensor_msgs/PointCloud2 of points (N, 3), m, with id and colour.

    `ids` are the surfaces' (N,); `colors` are (N, 3) red green blue, 0 to 255.
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

    `cov` is (6, 6) of (x, y, z, roll, pitch, yaw), or planar (3, 3) of (x, y, yaw); m and rad.
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
    """Return a nav_msgs/Path of poses (N, 4, 4) at stamps (N,)."""
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


def grid_message(
    types: MessageTypes,
    stamp_ns: int,
    frame_id: str,
    cells: NDArray[np.int8],
    resolution: float,
    T_map_origin: Float64,
) -> Any:
    """Return a nav_msgs/OccupancyGrid.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    cells
        int8 (height, width), row 0 at the lowest y: 0 free to 100 occupied, -1 unknown.
    resolution
        Edge of a cell, m.
    T_map_origin
        (4, 4), pose of the outer corner of cell (0, 0).
    """
    info = types.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=stamp_message(types, stamp_ns),
        resolution=float(resolution),
        width=int(cells.shape[1]),
        height=int(cells.shape[0]),
        origin=pose_message(types, T_map_origin),
    )
    return types.make(
        "nav_msgs/msg/OccupancyGrid",
        header=header_message(types, stamp_ns, frame_id),
        info=info,
        data=types.array("i1", cells.ravel()),
    )


class DiagnosticStatus(NamedTuple):
    """One line of /diagnostics; level 0 is ok, 1 warning, 2 error, 3 stale."""

    name: str
    level: int
    message: str
    values: Mapping[str, object]


def diagnostics_message(
    types: MessageTypes, stamp_ns: int, hardware_id: str, statuses: Sequence[DiagnosticStatus]
) -> Any:
    """Return a diagnostic_msgs/DiagnosticArray; values are shown as text, in their order."""
    made = [
        types.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=types.octet(status.level),
            name=status.name,
            message=status.message,
            hardware_id=hardware_id,
            values=[
                types.make("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
                for key, value in status.values.items()
            ],
        )
        for status in statuses
    ]
    header = header_message(types, stamp_ns, "")
    return types.make("diagnostic_msgs/msg/DiagnosticArray", header=header, status=made)
