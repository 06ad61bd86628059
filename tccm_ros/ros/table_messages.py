"""Surfaces as object_recognition_msgs/TableArray, an input of tabletop manipulation pipelines."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse, transform
from tccm_ros.records import Surface
from tccm_ros.ros.types import MessageTypes, header_message, pose_message
from tccm_ros.scene.scene import surface_pose
from tccm_ros.tabletop.footprints import convex_hull

TABLES = "object_recognition_msgs/msg/TableArray"
TABLE = "object_recognition_msgs/msg/Table"


def tables_message(
    types: MessageTypes, stamp_ns: int, frame_id: str, surfaces: Iterable[Surface]
) -> Any:
    """Return a TableArray of all surfaces except the floor, by id.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header, of the array and of each table.
    surfaces
        Surfaces in that frame.
    """
    header = header_message(types, stamp_ns, frame_id)
    tables = [_table(types, header, surface) for surface in surfaces if surface.label != "floor"]
    return types.make(TABLES, header=header, tables=tables)


def _table(types: MessageTypes, header: Any, surface: Surface) -> Any:
    """Return a Table: z of its pose is the normal, x along the longer side."""
    T_map_table, _ = surface_pose(surface)
    return types.make(
        TABLE,
        header=header,
        pose=pose_message(types, T_map_table),
        convex_hull=types.rows("geometry_msgs/msg/Point", _hull(surface, T_map_table)),
    )


def _hull(surface: Surface, T_map_table: Float64) -> Float64:
    """Return the convex hull of a surface, float64 (N, 3), counter-clockwise, z = 0."""
    seen = surface.boundary_seen if len(surface.boundary_seen) else surface.boundary
    xy = transform(inverse(T_map_table), seen)[:, :2]
    return np.pad(convex_hull(np.ascontiguousarray(xy)), ((0, 0), (0, 1)))
