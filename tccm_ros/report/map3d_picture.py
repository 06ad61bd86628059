"""Draw map3d.png: the map in perspective, as Fig. 8 of the surface mapping paper.

The map is divided into flat polygons, which are projected and painted from far to near (painter's
algorithm), so that outlines with holes, text and lines have the quality of the picture from above.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tccm_ros.arrays import Float64
from tccm_ros.records import Wall
from tccm_ros.report import palette
from tccm_ros.report.camera import Camera, look_at
from tccm_ros.report.drawing import (
    canvas,
    draw_labels,
    png,
    polygon,
    sample_ring,
    show_extent,
)
from tccm_ros.report.label_layout import label_point
from tccm_ros.report.map_picture import box_corners, extent
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import ObjectEntry, SurfaceEntry

WIDTH_IN = 9.0
"""Width of the picture, inches."""

HEIGHTS_IN = (3.6, 8.0)
"""Limits of its height, inches."""

WALL_HEIGHT_M = 0.9
"""Drawn height of walls, m. Chosen: rooms are recognisable and not hidden."""

WALL_PIECE_M = 0.5
"""Length of the separately painted pieces of a wall, m. Chosen: it keeps the depth order right."""

ELEVATION_RAD = np.deg2rad(38.0)
"""Elevation of the camera, rad; chosen."""

AZIMUTHS_RAD = np.deg2rad([-66.0, 24.0])
"""Camera azimuths for maps with the longer side in x and in y, rad; chosen."""

PAINT_STEP_M = 1e-3
"""Depth offset by which a body is painted in front of the one below it, m; chosen."""

CAMERA_DISTANCE = 1.9
"""Camera distance in units of the map's longer side; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A flat polygon with holes, or an open line, to be painted.

    Attributes
    ----------
    rings
        float64 (N, 3) each, in map, m: outline and holes, or the line.
    style
        Arguments of matplotlib.
    is_line
        Whether it is an open line.
    body
        Index in `_bodies`; pieces of one body are painted together. None for a piece that is
        painted by its own distance.
    """

    rings: Sequence[Float64]
    style: dict[str, Any] = field(default_factory=dict)
    is_line: bool = False
    body: int | None = None


def map3d_png(results: Results) -> bytes:
    """Draw the map in perspective as a PNG file, byte-identical for the same results."""
    camera = view_camera(results)
    low, high = _picture_limits(results, camera)
    scale = WIDTH_IN / (high[0] - low[0])
    height = float(np.clip((high[1] - low[1]) * scale, *HEIGHTS_IN))
    with canvas(WIDTH_IN, height) as (figure, axes):
        show_extent(axes, low, high)
        for piece in _ground(results):
            _paint(axes, camera, piece, 1.0)
        depths = _body_depths(results, camera)
        pieces = sorted(_pieces(results), key=lambda p: _order(p, camera, depths))
        for order, piece in enumerate(pieces):
            _paint(axes, camera, piece, 3.0 + order / len(pieces))
        _label(axes, camera, results)
        return png(figure)


def view_camera(results: Results) -> Camera:
    """Return a camera that sees the whole map, with its longer side across the picture."""
    low, high = extent(results)
    side = high - low
    azimuth = AZIMUTHS_RAD[0] if side[0] >= side[1] else AZIMUTHS_RAD[1]
    target = np.array([*(0.5 * (low + high)), results.ground + 0.3])
    return look_at(target, azimuth, ELEVATION_RAD, CAMERA_DISTANCE * float(side.max()))


def _picture_limits(results: Results, camera: Camera) -> tuple[Float64, Float64]:
    """Return the corners of the drawn map in picture units, with a margin."""
    rings = [r for piece in (*_ground(results), *_pieces(results)) for r in piece.rings]
    if not rings:
        (x0, y0), (x1, y1) = extent(results)
        rings = [np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])]
    points = camera.project(np.concatenate(rings))
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float(np.max(high - low)) + 1e-6
    return low - margin, high + margin


def _ground(results: Results) -> Iterator[Piece]:
    """Yield the pieces on the floor: the floor, shadows of the surfaces, the path."""
    ground = results.ground
    for surface in results.surfaces:
        if surface.is_floor and len(surface.boundary) > 2:
            style = {"fc": palette.FLOOR, "ec": "#d4d9df", "lw": 0.8}
            yield Piece([_flat(ring, ground) for ring in _rings(surface)], style)
    for surface in results.above_floor:
        if len(surface.boundary) > 2:
            shadow = {"fc": "#000000", "ec": "none", "alpha": 0.10}
            yield Piece([_flat(ring, ground) for ring in _rings(surface)], shadow)
    if len(results.trajectory.stamps) > 1:
        path = _flat(results.trajectory.positions, ground)
        yield Piece([path], {"color": palette.PATH, "lw": 1.2}, is_line=True)
    for position in _view_positions(results):
        style = {"color": palette.VIEW, "marker": "o", "ms": 3.6, "mec": "white", "mew": 0.6}
        yield Piece([_flat(position[None], ground)], style, is_line=True)


def _pieces(results: Results) -> Iterator[Piece]:
    """Yield the pieces above the floor, unordered: walls, surfaces and objects."""
    for wall in results.walls:
        yield from _wall(wall, results.ground)
    colors = palette.surface_colors(results.surfaces)
    surfaces = results.above_floor
    for body, surface in enumerate(surfaces):
        if len(surface.boundary) > 2:
            yield from _surface(surface, colors[surface.id], results.ground, body)
    for body, box in enumerate(results.tabletop, len(surfaces)):
        yield from _box(box, body)


def _bodies(results: Results) -> list[Float64]:
    """Return the outlines of the surfaces, then of the objects, float64 (N, 3) each."""
    outlines = [surface.boundary for surface in results.above_floor]
    return outlines + [_flat(box_corners(box), float(box.center[2])) for box in results.tabletop]


def _body_depths(results: Results, camera: Camera) -> list[float]:
    """Return the depth of each body for the painting order, m.

    A body above another must be painted after it even if its centre is farther away (a mug at the
    far end of a table).
    """
    bodies = _bodies(results)
    depths = [camera.distance(body) if len(body) else 0.0 for body in bodies]
    upwards = sorted((float(b[:, 2].mean()), i) for i, b in enumerate(bodies) if len(b))
    for rank, (_, upper) in enumerate(upwards):
        for _, lower in upwards[:rank]:
            if _overlap(bodies[upper][:, :2], bodies[lower][:, :2]):
                depths[upper] = min(depths[upper], depths[lower] - PAINT_STEP_M)
    return depths


def _overlap(a: Float64, b: Float64) -> bool:
    """Return whether the bounding boxes of two outlines (N, 2) intersect."""
    return bool(np.all((a.min(axis=0) <= b.max(axis=0)) & (b.min(axis=0) <= a.max(axis=0))))


def _order(piece: Piece, camera: Camera, depths: Sequence[float]) -> tuple[float, float]:
    """Return the painting order key: far bodies first, and within a body the far sides first."""
    own = camera.distance(piece.rings[0])
    return -(own if piece.body is None else depths[piece.body]), -own


def _surface(surface: SurfaceEntry, color: str, ground: float, body: int) -> Iterator[Piece]:
    for corner in _corners(surface.boundary):
        foot = np.array([corner[0], corner[1], ground])
        style = {"color": color, "lw": 0.9, "alpha": 0.55}
        yield Piece([np.stack([corner, foot])], style, is_line=True)
    yield Piece(_rings(surface), {"fc": color, "ec": "none", "alpha": 0.82}, body=body)
    yield Piece(_rings(surface), {"fill": False, "ec": color, "lw": 1.5}, body=body)


def _corners(ring: Float64) -> Float64:
    """Return the distinct extreme points of a ring in the diagonal directions, (<= 4, 3)."""
    directions = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return ring[np.unique(np.argmax(ring[:, :2] @ directions.T, axis=0))]


def _wall(wall: Wall, ground: float) -> Iterator[Piece]:
    start, end = wall.endpoints
    count = max(int(np.ceil(np.hypot(*(end - start)) / WALL_PIECE_M)), 1)
    ends = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)
    low, high = (
        np.column_stack([ends, np.full(count + 1, ground + h)]) for h in (0, WALL_HEIGHT_M)
    )
    for i in range(count):
        panel = np.stack([low[i], low[i + 1], high[i + 1], high[i]])
        yield Piece([panel], {"fc": palette.WALL, "ec": "none", "alpha": 0.20})
        style = {"color": palette.WALL, "solid_capstyle": "round"}
        yield Piece([low[i : i + 2]], {**style, "lw": 2.2}, is_line=True)
        yield Piece([high[i : i + 2]], {**style, "lw": 0.8, "alpha": 0.6}, is_line=True)


def _box(box: ObjectEntry, body: int) -> Iterator[Piece]:
    low, high = (_flat(box_corners(box), box.center[2] + s * box.size[2] / 2) for s in (-1, 1))
    style = {"fc": palette.OBJECT, "ec": "white", "lw": 0.4, "alpha": 0.7}
    for i in range(4):
        j = (i + 1) % 4
        yield Piece([np.stack([low[i], low[j], high[j], high[i]])], style, body=body)
    yield Piece([high], {**style, "fc": "#7c6552"}, body=body)


def _rings(surface: SurfaceEntry) -> list[Float64]:
    return [ring for ring in (surface.boundary, *surface.holes) if len(ring) > 2]


def _flat(points: Float64, z: float) -> Float64:
    return np.column_stack([points[:, :2], np.full(len(points), z)])


def _view_positions(results: Results) -> Float64:
    path = results.trajectory
    if len(path.stamps) == 0:
        return np.zeros((0, 3))
    return path.positions[np.unique(path.nearest(results.view_stamps()))]


def _paint(axes: Axes, camera: Camera, piece: Piece, zorder: float) -> None:
    seen = [camera.project(ring) for ring in piece.rings]
    if piece.is_line:
        axes.plot(*seen[0].T, zorder=zorder, **piece.style)
    else:
        axes.add_patch(polygon(seen, zorder=zorder, joinstyle="round", **piece.style))


def _label(axes: Axes, camera: Camera, results: Results) -> None:
    colors = palette.surface_colors(results.surfaces)
    standing = sorted(results.above_floor, key=lambda s: (-s.area, s.id))
    to_pixels = axes.transData.transform
    outlines = [sample_ring(to_pixels(camera.project(s.boundary))) for s in standing]
    draw_labels(
        axes,
        [f"{s.label} {s.height - results.ground:.2f} m" for s in standing],
        np.array([camera.project(label_point(s)) for s in standing]).reshape(-1, 2),
        [colors[s.id] for s in standing],
        np.concatenate([np.zeros((0, 2)), *outlines]),
        size=8.0,
    )
