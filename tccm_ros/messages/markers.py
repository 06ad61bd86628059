"""Pictures of records for RViz and Foxglove: visualization_msgs/Marker lists.

A builder returns the markers of one message; `MarkerSet` makes of them a complete MarkerArray that
also deletes what the message before had. Clouds of boxes and lines are one marker per class.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Iterable, Sequence
from copy import copy
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry import Polygon

from tccm_ros.geometry import pose
from tccm_ros.messages.triangles import clip_ears
from tccm_ros.messages.types import MessageTypes, header_message, pose_message
from tccm_ros.records import PlaneRecord, Surface, TabletopObject, Wall

__all__ = [
    "MarkerSet",
    "Place",
    "core_markers",
    "cuboid_markers",
    "identity_color",
    "object_markers",
    "plane_markers",
    "scale_color",
    "surface_markers",
    "triangulate",
    "wall_markers",
]

CUBE, LINE_STRIP, LINE_LIST, CUBE_LIST, TEXT, TRIANGLE_LIST, ARROW = 1, 4, 5, 6, 9, 11, 0
ADD, DELETE = 0, 2

NORMAL_LENGTH = 0.2
TEXT_HEIGHT = 0.06
WALL_HEIGHT = 0.5
MIN_SCALE = 1e-3
"""Smallest edge of a marker, m: viewers refuse zero."""

COLOR_STEPS = 64
"""Colours along a scale, so that equal ones can share one message."""

GOLDEN_RATIO = 0.618033988749895

Color = tuple[float, float, float]


class Place(NamedTuple):
    """Where and when a list of markers is."""

    types: MessageTypes
    stamp_ns: int
    frame_id: str


class MarkerSet:
    """Makes each message complete: ADD for all markers, DELETE for those of the message before."""

    def __init__(self, types: MessageTypes) -> None:
        self._types = types
        self._shown: dict[tuple[str, int], str] = {}

    def message(self, markers: Sequence[Any], stamp_ns: int) -> Any:
        """Return a visualization_msgs/MarkerArray with `markers` and the needed deletions."""
        shown = {(marker.ns, int(marker.id)): marker.header.frame_id for marker in markers}
        gone = sorted(self._shown.keys() - shown.keys())
        deletions = [
            self._types.make(
                "visualization_msgs/msg/Marker",
                header=header_message(self._types, stamp_ns, self._shown[key]),
                ns=key[0],
                id=key[1],
                action=DELETE,
            )
            for key in gone
        ]
        self._shown = shown
        return self._types.make(
            "visualization_msgs/msg/MarkerArray", markers=[*deletions, *markers]
        )


# --- colours and shapes -------------------------------------------------------------------------


def identity_color(identity: int) -> Color:
    """Return the colour of an id, 0 to 1; neighbouring ids differ strongly (golden ratio)."""
    return colorsys.hsv_to_rgb(identity * GOLDEN_RATIO % 1.0, 0.65, 0.95)


def scale_color(fraction: float) -> Color:
    """Return the colour at 0 (blue) to 1 (red) of a scale."""
    return colorsys.hsv_to_rgb(0.67 * (1.0 - min(max(fraction, 0.0), 1.0)), 0.85, 0.95)


def triangulate(
    boundary: NDArray[np.float64],
    holes: Sequence[NDArray[np.float64]],
    normal: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Fill a planar polygon with triangles.

    Parameters
    ----------
    boundary
        float64 (N, 3), open ring, m.
    holes
        Rings as `boundary`; they stay empty.
    normal
        Unit normal float64 (3,).

    Returns
    -------
    float64 (M, 3, 3)
        Corners of M triangles, counter-clockwise seen against the normal; M = 0 where the ring
        encloses nothing.
    """
    corners, triangles = _fill(boundary, holes, normal)
    return corners[triangles]


def _fill(
    boundary: NDArray[np.float64],
    holes: Sequence[NDArray[np.float64]],
    normal: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return corners (V, 3), those of the rings first, and triangles (M, 3) of them."""
    rings = [ring for ring in (boundary, *holes) if len(ring) >= 3]
    if len(boundary) < 3:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    corners = np.concatenate(rings)
    origin, axes = boundary.mean(axis=0), _tangents(normal)
    xy, ends = (corners - origin) @ axes.T, np.cumsum([len(ring) for ring in rings])
    triangles = clip_ears(xy, ends)
    if len(triangles):
        return corners, triangles
    # Rings that cross: what they enclose is worked out by a polygon library.
    polygon = shapely.make_valid(Polygon(xy[: ends[0]], np.split(xy, ends[:-1])[1:]))
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    parts = shapely.orient_polygons(parts[shapely.area(parts) > 0.0])
    found = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    triangles = np.arange(len(found), dtype=np.int32).reshape(-1, 3) + len(corners)
    return np.concatenate([corners, found @ axes + origin]), triangles


def _tangents(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two rows u, v (2, 3) with u x v = normal."""
    nx, ny, nz = normal.tolist()
    # The axis that is least along the normal, times the normal.
    least = min(abs(nx), abs(ny), abs(nz))
    if abs(nx) == least:
        ux, uy, uz = 0.0, -nz, ny
    elif abs(ny) == least:
        ux, uy, uz = nz, 0.0, -nx
    else:
        ux, uy, uz = -ny, nx, 0.0
    length = math.hypot(ux, uy, uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    v = (ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux)
    return np.array([(ux, uy, uz), v])


def _points(types: MessageTypes, xyz: ArrayLike, chosen: ArrayLike | None = None) -> Any:
    rows = np.asarray(xyz, np.float64).reshape(-1, 3)
    return types.rows("geometry_msgs/msg/Point", rows, chosen)


def _color(types: MessageTypes, color: Color, alpha: float = 1.0) -> Any:
    r, g, b = color
    return types.make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=alpha)


def _marker(
    place: Place,
    ns: str,
    identity: int,
    kind: int,
    scale: Sequence[float],
    color: Color,
    alpha: float = 1.0,
    **fields: Any,
) -> Any:
    x, y, z = (max(float(value), 0.0) for value in scale)
    marker = copy(_blank(place))
    marker.ns, marker.id, marker.type = ns, int(identity), kind
    marker.scale = place.types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
    marker.color = _color(place.types, color, alpha)
    for name, value in fields.items():
        setattr(marker, name, value)
    return marker


@lru_cache(maxsize=2)
def _blank(place: Place) -> Any:
    """Return a marker to copy: most of its many parts are the same in all markers of a message."""
    header = header_message(place.types, place.stamp_ns, place.frame_id)
    return place.types.make("visualization_msgs/msg/Marker", header=header, action=ADD)


def _text(place: Place, ns: str, identity: int, at: NDArray[np.float64], text: str) -> Any:
    x, y, z = at.tolist()
    scale = (0.0, 0.0, TEXT_HEIGHT)
    point = place.types.make("geometry_msgs/msg/Point", x=x, y=y, z=z)
    where = place.types.make("geometry_msgs/msg/Pose", position=point)
    return _marker(place, ns, identity, TEXT, scale, (1.0, 1.0, 1.0), pose=where, text=text)


# --- builders -----------------------------------------------------------------------------------


def _area_markers(
    place: Place,
    identity: int,
    boundary: NDArray[np.float64],
    holes: Sequence[NDArray[np.float64]],
    normal: NDArray[np.float64],
    color: Color,
) -> list[Any]:
    """Return the filled area and the outline, holes included."""
    corners, triangles = _fill(boundary, holes, normal)
    if not len(corners):
        return []
    edges = _edges([len(ring) for ring in (boundary, *holes) if len(ring) >= 3])
    # A corner is one message, however many triangles and edges meet there.
    points = _points(place.types, corners, np.concatenate([triangles.ravel(), edges]))
    markers = []
    if len(triangles):
        filled, unit = points[: triangles.size], (1.0, 1.0, 1.0)
        fill = _marker(place, "fill", identity, TRIANGLE_LIST, unit, color, 0.5, points=filled)
        markers.append(fill)
    lines, width = points[triangles.size :], (0.01, 0.0, 0.0)
    markers.append(_marker(place, "outline", identity, LINE_LIST, width, color, points=lines))
    return markers


def _edges(lengths: Sequence[int]) -> NDArray[np.int64]:
    """Return the corners at the ends of each edge of closed rings that lie one after the other."""
    ends = np.cumsum(lengths)
    edges = np.empty((ends[-1], 2), np.int64)
    edges[:, 0] = np.arange(ends[-1])
    edges[:, 1] = edges[:, 0] + 1
    edges[ends - 1, 1] = ends - lengths
    return edges.ravel()


def plane_markers(place: Place, planes: Iterable[PlaneRecord]) -> list[Any]:
    """Return filled boundary, outline, normal and text of tracked planes."""
    markers = []
    for plane in planes:
        color = identity_color(plane.id)
        markers += _area_markers(place, plane.id, plane.boundary, plane.holes, plane.normal, color)
        ends = [plane.centroid, plane.centroid + NORMAL_LENGTH * plane.normal]
        arrow = _points(place.types, ends)
        thin = (0.01, 0.02, 0.0)
        markers.append(_marker(place, "normal", plane.id, ARROW, thin, color, points=arrow))
        text = f"{plane.id}: {plane.centroid[2]:.2f} m, {plane.area:.2f} m2"
        at = plane.centroid + 0.5 * NORMAL_LENGTH * plane.normal
        markers.append(_text(place, "text", plane.id, at, text))
    return markers


def surface_markers(place: Place, surfaces: Iterable[Surface]) -> list[Any]:
    """Return filled boundary, outline and text (label, height, area) of the surface map."""
    markers = []
    for surface in surfaces:
        color = identity_color(surface.id)
        markers += _area_markers(
            place, surface.id, surface.boundary, surface.holes, surface.normal, color
        )
        text = f"{surface.id} {surface.label}: {surface.height:.2f} m, {surface.area:.2f} m2"
        at = surface.centroid + np.array([0.0, 0.0, 0.1])
        markers.append(_text(place, "text", surface.id, at, text))
    return markers


def object_markers(place: Place, objects: Iterable[TabletopObject]) -> list[Any]:
    """Return a box per object that stands on a surface."""
    markers = []
    for item in objects:
        c, s = np.cos(item.yaw), np.sin(item.yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        where = pose_message(place.types, pose(R, item.center))
        size = np.maximum(item.size, MIN_SCALE).tolist()
        color = identity_color(item.id)
        markers.append(_marker(place, "object", item.id, CUBE, size, color, 0.8, pose=where))
    return markers


def wall_markers(place: Place, walls: Iterable[Wall]) -> list[Any]:
    """Return each wall as an upright rectangle over its observed extent, with its outline."""
    markers = []
    for wall in walls:
        (x0, y0), (x1, y1) = wall.endpoints
        h = WALL_HEIGHT
        ring = np.array([[x0, y0, 0.0], [x1, y1, 0.0], [x1, y1, h], [x0, y0, h]])
        normal = np.array([np.cos(wall.phi), np.sin(wall.phi), 0.0])
        markers += _area_markers(place, wall.id, ring, (), normal, identity_color(wall.id))
    return markers


def core_markers(place: Place, starts: ArrayLike, ends: ArrayLike) -> list[Any]:
    """Return the center cores (N, 3) to (N, 3), m, as one LINE_LIST; none where N = 0."""
    lines = np.stack([np.asarray(starts, float), np.asarray(ends, float)], axis=-2)
    if lines.size == 0:
        return []
    points = _points(place.types, lines)
    width = (0.004, 0.0, 0.0)
    return [_marker(place, "cores", 0, LINE_LIST, width, (0.2, 0.9, 0.3), points=points)]


def cuboid_markers(
    place: Place,
    tops: ArrayLike,
    depth: ArrayLike,
    cell_size: float,
    cuboid_depth: float,
    fraction: ArrayLike,
) -> list[Any]:
    """Return one CUBE_LIST per depth class, so that a map is a handful of markers.

    Parameters
    ----------
    place
        Where and when.
    tops
        (N, 3), m: centre of the cell and upper end of the cuboid.
    depth
        (N,), m; drawn as the nearest power of two times `cuboid_depth`, hanging from the top.
    cell_size, cuboid_depth
        Edge of a cell and d0, m.
    fraction
        (N,), 0 to 1 on the colour scale: height or age.
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
        marker = _marker(
            place,
            "cuboids",
            int(index),
            CUBE_LIST,
            (cell_size, cell_size, height),
            (1.0, 1.0, 1.0),
            points=_points(place.types, centers),
            colors=place.types.rows("std_msgs/msg/ColorRGBA", palette, steps[members]),
        )
        markers.append(marker)
    return markers
