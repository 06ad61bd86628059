"""Records as lists of visualization_msgs/Marker, for RViz and Foxglove.

Each function returns the markers of one message. `MarkerSet` builds a MarkerArray from them that
also deletes markers of the previous message. Many boxes or lines are one marker (CUBE_LIST,
LINE_LIST).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int64
from tccm_ros.geometry import pose
from tccm_ros.outlines.triangulation import fill_outline
from tccm_ros.racks.compartment import Compartment
from tccm_ros.racks.outline import box_edges, part_edges
from tccm_ros.records import PlaneRecord, Sign, Surface, TabletopObject, Wall
from tccm_ros.ros.marker_parts import (
    ARROW,
    CUBE,
    CUBE_LIST,
    CYLINDER,
    LINE_LIST,
    TRIANGLE_LIST,
    Color,
    MessageContext,
    identity_color,
    make_marker,
    marker_points,
    scale_color,
    text_marker,
)
from tccm_ros.ros.types import pose_message
from tccm_ros.surfaces.objects.scene_objects import SceneObject

NORMAL_LENGTH_M = 0.2
"""Length of the arrow along a plane's normal, m. Chosen."""

WALL_HEIGHT_M = 0.5
"""Drawn height of walls, m. Chosen: low enough to see over."""

LABEL_LIFT_M = 0.05
"""Height of an object's label above its top, m. Chosen."""

PLATE_SIZE_M = (0.01, 0.3, 0.15)
"""Depth, width and height of the plate drawn for a door sign, m. Chosen."""

MIN_EDGE_M = 1e-3
"""Minimum edge length of a marker, m; viewers reject zero."""

COLOR_STEPS = 64
"""Number of colours on a scale. Chosen; markers of equal colour use one message object."""


def _area_markers(
    context: MessageContext,
    identity: int,
    boundary: Float64,
    holes: Sequence[Float64],
    normal: Float64,
    color: Color,
) -> list[Any]:
    """Return the filled area and the outline, holes included."""
    mesh = fill_outline(boundary, holes, normal)
    if not len(mesh.points):
        return []
    # One message object per corner, for all triangles and edges with that corner.
    corners = np.concatenate([mesh.triangles.ravel(), _edges(mesh.rings)])
    points = marker_points(context.types, mesh.points, corners)
    markers = []
    filled, lines = points[: mesh.triangles.size], points[mesh.triangles.size :]
    if len(filled):
        unit = (1.0, 1.0, 1.0)
        fill = make_marker(
            context, "fill", identity, TRIANGLE_LIST, unit, color, 0.5, points=filled
        )
        markers.append(fill)
    width = (0.01, 0.0, 0.0)
    markers.append(make_marker(context, "outline", identity, LINE_LIST, width, color, points=lines))
    return markers


def _edges(lengths: Sequence[int]) -> Int64:
    """Return the corner indices of each edge of closed rings with the given numbers of corners."""
    ends = np.cumsum(lengths)
    edges = np.empty((ends[-1], 2), np.int64)
    edges[:, 0] = np.arange(ends[-1])
    edges[:, 1] = edges[:, 0] + 1
    edges[ends - 1, 1] = ends - lengths
    return edges.ravel()


def plane_markers(context: MessageContext, planes: Iterable[PlaneRecord]) -> list[Any]:
    """Return filled boundary, outline, normal and text of tracked planes."""
    markers = []
    for plane in planes:
        color = identity_color(plane.id)
        markers += _area_markers(
            context, plane.id, plane.boundary, plane.holes, plane.normal, color
        )
        ends = [plane.centroid, plane.centroid + NORMAL_LENGTH_M * plane.normal]
        arrow = marker_points(context.types, ends)
        thin = (0.01, 0.02, 0.0)
        markers.append(make_marker(context, "normal", plane.id, ARROW, thin, color, points=arrow))
        text = f"{plane.id}: {plane.centroid[2]:.2f} m, {plane.area:.2f} m2"
        at = plane.centroid + 0.5 * NORMAL_LENGTH_M * plane.normal
        markers.append(text_marker(context, "text", plane.id, at, text))
    return markers


def surface_markers(context: MessageContext, surfaces: Iterable[Surface]) -> list[Any]:
    """Return filled boundary, outline and text (id, label, height, area) of surfaces."""
    markers = []
    for surface in surfaces:
        color = identity_color(surface.id)
        markers += _area_markers(
            context, surface.id, surface.boundary, surface.holes, surface.normal, color
        )
        text = f"{surface.id} {surface.label}: {surface.height:.2f} m, {surface.area:.2f} m2"
        at = surface.centroid + np.array([0.0, 0.0, 0.1])
        markers.append(text_marker(context, "text", surface.id, at, text))
    return markers


def compartment_markers(context: MessageContext, compartments: Iterable[Compartment]) -> list[Any]:
    """Return the edges of compartments and of parts that stand open, with arrows inwards."""
    markers = []
    for index, space in enumerate(compartments):
        edges = box_edges(space.front, space.T_map_front[:3, 0], space.depth, space.height)
        edges = np.concatenate([edges, part_edges(space.open_parts)])
        points = marker_points(context.types, edges.reshape(-1, 3))
        width, color = (0.006, 0.0, 0.0), identity_color(space.board)
        markers.append(
            make_marker(context, "compartment", index, LINE_LIST, width, color, points=points)
        )
    return markers


def label_markers(context: MessageContext, objects: Iterable[SceneObject]) -> list[Any]:
    """Return the class and score of each classified object, above its box."""
    markers = []
    for item in objects:
        if item.label is not None:
            at = item.center + np.array([0.0, 0.0, 0.5 * item.size[2] + LABEL_LIFT_M])
            text = f"{item.label.class_id} {item.label.score:.2f}"
            markers.append(text_marker(context, "object label", item.id, at, text))
    return markers


def object_markers(context: MessageContext, objects: Iterable[TabletopObject]) -> list[Any]:
    """Return a box or a cylinder for each object on a surface."""
    markers = []
    for item in objects:
        c, s = np.cos(item.yaw), np.sin(item.yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        where = pose_message(context.types, pose(R, item.center))
        size = np.maximum(item.size, MIN_EDGE_M).tolist()
        color = identity_color(item.id)
        kind = CYLINDER if item.is_round else CUBE
        markers.append(make_marker(context, "object", item.id, kind, size, color, 0.8, pose=where))
    return markers


def wall_markers(context: MessageContext, walls: Iterable[Wall]) -> list[Any]:
    """Return each wall as a vertical rectangle over its observed extent, with its outline."""
    markers = []
    for wall in walls:
        (x0, y0), (x1, y1) = wall.endpoints
        h = WALL_HEIGHT_M
        ring = np.array([[x0, y0, 0.0], [x1, y1, 0.0], [x1, y1, h], [x0, y0, h]])
        normal = np.array([np.cos(wall.phi), np.sin(wall.phi), 0.0])
        markers += _area_markers(context, wall.id, ring, (), normal, identity_color(wall.id))
    return markers


def sign_markers(context: MessageContext, signs: Iterable[Sign]) -> list[Any]:
    """Return each door sign as a thin box on its wall, with its text above."""
    markers = []
    for sign in signs:
        x, y, _ = sign.normal
        R = np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
        where = pose_message(context.types, pose(R, sign.position))
        color = identity_color(sign.id)
        markers.append(
            make_marker(context, "sign", sign.id, CUBE, PLATE_SIZE_M, color, 0.9, pose=where)
        )
        at = sign.position + np.array([0.0, 0.0, 0.15])
        markers.append(text_marker(context, "text", sign.id, at, sign.text))
    return markers


def core_markers(context: MessageContext, starts: ArrayLike, ends: ArrayLike) -> list[Any]:
    """Return center cores as one LINE_LIST; no marker if there are none.

    Parameters
    ----------
    context
        Message classes and header.
    starts, ends
        (N, 3), m.
    """
    lines = np.stack([np.asarray(starts, float), np.asarray(ends, float)], axis=-2)
    if lines.size == 0:
        return []
    points = marker_points(context.types, lines)
    width = (0.004, 0.0, 0.0)
    return [make_marker(context, "cores", 0, LINE_LIST, width, (0.2, 0.9, 0.3), points=points)]


def cuboid_markers(
    context: MessageContext,
    tops: ArrayLike,
    depth: ArrayLike,
    cell_size: float,
    cuboid_depth: float,
    fraction: ArrayLike,
) -> list[Any]:
    """Return one CUBE_LIST per depth class, which keeps the number of markers small.

    Parameters
    ----------
    context
        Message classes and header.
    tops
        (N, 3), m: centre of the cell, and top of the cuboid.
    depth
        (N,), m; drawn as the nearest power of two times `cuboid_depth`, downwards from the top.
    cell_size, cuboid_depth
        Edge length of a cell, and d0, m.
    fraction
        (N,), value on the colour scale, 0 to 1.
    """
    xyz = np.asarray(tops, np.float64).reshape(-1, 3)
    ratio = np.maximum(np.asarray(depth, np.float64) / cuboid_depth, 1e-6)
    classes = np.rint(np.log2(ratio)).astype(int)
    fractions = np.clip(np.nan_to_num(np.asarray(fraction, np.float64)), 0.0, 1.0)
    steps = np.rint(fractions * (COLOR_STEPS - 1)).astype(int)
    palette = [(*scale_color(k / (COLOR_STEPS - 1)), 1.0) for k in range(COLOR_STEPS)]
    markers = []
    for index in np.unique(classes):
        members = np.flatnonzero(classes == index)
        height = cuboid_depth * 2.0**index
        centers = xyz[members] - [0.0, 0.0, 0.5 * height]
        marker = make_marker(
            context,
            "cuboids",
            int(index),
            CUBE_LIST,
            (cell_size, cell_size, height),
            (1.0, 1.0, 1.0),
            points=marker_points(context.types, centers),
            colors=context.types.rows("std_msgs/msg/ColorRGBA", palette, steps[members]),
        )
        markers.append(marker)
    return markers
