"""Draw map.png: the map from above, as Fig. 7 of the surface mapping paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke

from tccm_ros.arrays import Float64
from tccm_ros.records import SIGN, Room
from tccm_ros.report import palette
from tccm_ros.report.drawing import (
    canvas,
    draw_labels,
    png,
    polygon,
    sample_ring,
    show_extent,
)
from tccm_ros.report.label_layout import label_point
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import CompartmentEntry, ObjectEntry, SurfaceEntry

WIDTH_IN = 9.0
"""Width of the picture, inches; the height follows the map."""

HEIGHTS_IN = (3.6, 12.0)
"""Limits of the height of the map, inches."""

LEGEND_IN = 0.42
"""Height of the legend, inches."""

MARGIN_M = 0.35
"""Margin around the map, m."""

SCALE_BARS_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""Lengths of the scale bar, m."""

YAW_ARROW_M = 0.16
"""Length of the arrow of a view's yaw, and of that into a compartment, m."""


def map_png(results: Results) -> bytes:
    """Draw the map from above as a PNG file, byte-identical for the same results."""
    low, high = extent(results)
    scale = WIDTH_IN / (high[0] - low[0])
    height = float(np.clip((high[1] - low[1]) * scale, *HEIGHTS_IN)) + LEGEND_IN
    with canvas(WIDTH_IN, height) as (figure, axes):
        axes.set_position((0.0, LEGEND_IN / height, 1.0, 1.0 - LEGEND_IN / height))
        figure.patch.set_facecolor("white")
        draw_map(axes, results, low, high)
        handles = _legend(results)
        if handles:
            figure.legend(
                handles=handles, loc="lower center", ncols=len(handles), frameon=False,
                handlelength=1.6, columnspacing=1.4, borderpad=0.2,
            )  # fmt: skip
        return png(figure)


def extent(results: Results) -> tuple[Float64, Float64]:
    """Return the corners of surfaces, walls, landmarks and path with a margin, float64 (2,), m."""
    shown = [s.boundary[:, :2] for s in results.surfaces]
    shown += [s.boundary[:, :2] for s in results.truth]
    shown += [wall.endpoints for wall in results.walls]
    shown += [landmark.position[None, :2] for landmark in results.graph.landmarks]
    shown.append(results.trajectory.positions[:, :2])
    points = np.concatenate(shown)
    if len(points) == 0:
        points = np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.maximum(1.0 - 0.5 * (high - low), 0.0)
    margin = MARGIN_M + 0.02 * float(np.max(high - low))
    return low - room - margin, high + room + margin


def draw_map(axes: Axes, results: Results, low: Float64, high: Float64) -> None:
    """Draw the map into frameless axes.

    Parameters
    ----------
    axes
        Axes with their final size.
    results
        The map.
    low, high
        float64 (2,), corners of the drawn rectangle in map, m.
    """
    show_extent(axes, low, high)
    colors = palette.surface_colors(results.surfaces)
    for room in results.rooms:
        if room.name:
            _draw_room(axes, room)
    for surface in sorted(results.surfaces, key=lambda s: (s.height, s.id)):
        _draw_surface(axes, surface, colors[surface.id])
    for true in results.truth:
        axes.add_patch(polygon([true.boundary[:, :2]], fill=False, ec=palette.TRUTH,
                               lw=0.9, ls=(0, (4, 3)), zorder=6))  # fmt: skip
    for box in results.tabletop:
        _draw_object(axes, box)
    for space in results.compartments:
        _draw_front(axes, space)
    for wall in results.walls:
        axes.plot(*wall.endpoints.T, color=palette.WALL, lw=4.0, solid_capstyle="round", zorder=8)
    _draw_path(axes, results)
    for landmark in results.graph.landmarks:
        if landmark.kind != SIGN:
            _draw_landmark(axes, landmark.position, f"{landmark.kind} {landmark.id}")
    for sign in results.signs:
        _draw_landmark(axes, sign.position, sign.number)
    _draw_scale_bar(axes)
    standing = sorted(results.above_floor, key=lambda s: (-s.area, s.id))
    draw_labels(
        axes,
        [f"{s.label}\n{s.height - results.ground:.2f} m" for s in standing],
        np.array([label_point(s)[:2] for s in standing]).reshape(-1, 2),
        [colors[s.id] for s in standing],
        _obstacles(axes, results),
    )


def _draw_front(axes: Axes, space: CompartmentEntry) -> None:
    """Draw the front edge of a compartment, with an arrow inward from before it."""
    axes.plot(*space.front[:, :2].T, color=palette.OBJECT, lw=1.2, zorder=7)
    end = space.front[:, :2].mean(axis=0)
    start = end - YAW_ARROW_M * space.insertion[:2]
    arrow = {"arrowstyle": "-|>", "color": palette.OBJECT, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=arrow, zorder=7)


def box_corners(box: ObjectEntry) -> Float64:
    """Return the corners of an object's box from above, float64 (4, 2), m."""
    half = 0.5 * box.size[:2]
    c, s = np.cos(box.yaw), np.sin(box.yaw)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return corners @ np.array([[c, s], [-s, c]]) + box.center[:2]


def _draw_room(axes: Axes, room: Room) -> None:
    """Draw a named room: a faint outline, and the name large and pale in the middle."""
    axes.add_patch(polygon([room.boundary], fill=False, ec=palette.ROOM, lw=1.0, zorder=2))
    middle = shapely.maximum_inscribed_circle(shapely.Polygon(room.boundary), tolerance=0.05)
    x, y = middle.coords[0]
    axes.text(x, y, room.name, ha="center", va="center", size=20, color=palette.ROOM, zorder=2)


def _draw_surface(axes: Axes, surface: SurfaceEntry, color: str) -> None:
    rings = [ring[:, :2] for ring in (surface.boundary, *surface.holes) if len(ring) >= 3]
    if not rings:
        return
    if surface.is_floor:
        axes.add_patch(polygon(rings, fc=color, ec="none", zorder=1))
        return
    # Lower surfaces first and half transparent, so that stacked shelves are all visible.
    axes.add_patch(polygon(rings, fc=color, ec="none", alpha=0.62, zorder=3))
    axes.add_patch(polygon(rings, fill=False, ec=color, lw=1.6, zorder=4))


def _draw_object(axes: Axes, box: ObjectEntry) -> None:
    """Draw an object's box half transparent, so that the surface below stays visible."""
    corners = box_corners(box)
    axes.add_patch(polygon([corners], fc=palette.OBJECT, ec="none", alpha=0.35, zorder=5))
    axes.add_patch(polygon([corners], fill=False, ec=palette.OBJECT, lw=0.9, zorder=7))


def _draw_path(axes: Axes, results: Results) -> None:
    path = results.trajectory
    if len(path.stamps) == 0:
        return
    axes.plot(*path.positions[:, :2].T, color=palette.PATH, lw=1.1, zorder=9)
    axes.plot(*path.positions[0, :2], "s", ms=5, color=palette.PATH, mec="white", zorder=10)
    nearest = path.nearest(results.view_stamps())
    poses = path.T_map_base[np.unique(nearest)]
    if len(poses):
        x, y, dx, dy = poses[:, 0, 3], poses[:, 1, 3], poses[:, 0, 0], poses[:, 1, 0]
        axes.quiver(x, y, dx, dy, color=palette.VIEW, angles="xy", scale_units="xy", width=0.0022,
                    scale=1.0 / YAW_ARROW_M, headwidth=4, headlength=4, zorder=10)  # fmt: skip
        axes.plot(x, y, "o", ms=3.6, color=palette.VIEW, mec="white", mew=0.6, zorder=11)


def _draw_landmark(axes: Axes, position: Float64, name: str) -> None:
    """Draw a landmark as a diamond with its name, for lack of a symbol per kind."""
    x, y = position[:2]
    axes.plot(x, y, "D", ms=5, color=palette.LANDMARK, mec="white", zorder=12)
    axes.annotate(
        name, (x, y), (5, 5), textcoords="offset points",
        color=palette.LANDMARK, zorder=15,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )  # fmt: skip


def _draw_scale_bar(axes: Axes) -> None:
    x0, x1 = axes.get_xlim()
    y0, y1 = axes.get_ylim()
    width, height = x1 - x0, y1 - y0
    length = max((bar for bar in SCALE_BARS_M if bar <= 0.22 * width), default=SCALE_BARS_M[0])
    left, bottom = x0 + 0.02 * width, y0 + 0.012 * width
    thick = 0.006 * width
    for index, color in ((0, palette.VIEW), (1, "white")):
        axes.add_patch(Rectangle((left + index * length / 2, bottom), length / 2, thick,
                                 fc=color, ec=palette.VIEW, lw=0.8, zorder=15))  # fmt: skip
    axes.text(left + length / 2, bottom + thick + 0.004 * max(width, height), f"{length:g} m",
              ha="center", va="bottom", zorder=15, color=palette.VIEW,
              path_effects=[withStroke(linewidth=2.5, foreground="white")])  # fmt: skip


def _obstacles(axes: Axes, results: Results) -> Float64:
    """Return points along walls and outlines that labels should not cover, pixels."""
    to_pixels = axes.transData.transform
    lines = [sample_ring(to_pixels(w.endpoints), closed=False) for w in results.walls]
    lines += [sample_ring(to_pixels(s.boundary[:, :2])) for s in results.above_floor]
    lines += [to_pixels(box_corners(box)) for box in results.tabletop]
    return np.concatenate([np.zeros((0, 2)), *lines])


def _legend(results: Results) -> Sequence[Line2D | Patch]:
    handles: list[Line2D | Patch] = []
    if results.above_floor:
        handles.append(Patch(fc=palette.PALETTE[0], alpha=0.62, label="surface, height over floor"))
    if any(s.is_floor for s in results.surfaces):
        handles.append(Patch(fc=palette.FLOOR, ec="#c9ced4", lw=0.6, label="floor seen"))
    if results.tabletop:
        handles.append(Patch(fc="#c3bbb4", ec=palette.OBJECT, label="object"))
    if results.walls:
        handles.append(Line2D([], [], color=palette.WALL, lw=4, label="wall"))
    if len(results.trajectory.stamps):
        handles.append(Line2D([], [], color=palette.PATH, lw=1.2, label="path of the base"))
    if len(results.view_stamps()):
        handles.append(Line2D([], [], color=palette.VIEW, marker="o", ms=4, lw=0, label="3D view"))
    if results.signs:
        handles.append(Line2D([], [], color=palette.LANDMARK, marker="D", lw=0, label="door sign"))
    elif results.graph.landmarks:
        handles.append(Line2D([], [], color=palette.LANDMARK, marker="D", lw=0, label="landmark"))
    if any(room.name for room in results.rooms):
        handles.append(Patch(fc="none", ec=palette.ROOM, label="room"))
    if results.truth:
        handles.append(Line2D([], [], color=palette.TRUTH, lw=0.9, ls=(0, (4, 3)), label="truth"))
    return handles
