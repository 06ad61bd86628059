"""Draw with matplotlib: canvases, polygons, labels and PNG files, byte-identical between runs."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from PIL import Image

from tccm_ros.arrays import Float64
from tccm_ros.report.label_layout import LabelRequest, place_labels

DPI = 200
"""Resolution, twice the displayed width in a README, for sharp text."""

FONT_PT = 9.0
"""Font size, points; 12 pixels at README size."""

LABEL_ZORDER = 20.0
"""Drawing order of labels: above everything else."""

OBSTACLE_STEP_PX = 6.0
"""Spacing of the points that represent a line as an obstacle for labels, pixels; chosen."""


@contextmanager
def canvas(width: float, height: float) -> Iterator[tuple[Figure, Axes]]:
    """Yield an empty figure of width x height inches with one frameless axes over all of it.

    The user's matplotlib settings have no effect; the font is the one installed with matplotlib.
    """
    settings: dict[Any, Any] = {"font.family": ["DejaVu Sans"], "font.size": FONT_PT}
    with matplotlib.style.context("default"), matplotlib.rc_context(settings):
        figure = Figure(figsize=(width, height), dpi=DPI)
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        yield figure, axes


def show_extent(axes: Axes, low: Float64, high: Float64) -> None:
    """Set the limits of axes so that a rectangle fills them, with one scale in x and y.

    Parameters
    ----------
    axes
        Axes with their final size.
    low, high
        float64 (2,), corners of the rectangle, data units.
    """
    size = np.array(axes.get_window_extent().size, np.float64)
    scale = float(np.max((high - low) / size))
    middle, half = 0.5 * (low + high), 0.5 * scale * size
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG file of at most 256 colours, without metadata."""
    drawn = FigureCanvasAgg(figure)
    drawn.draw()
    pixels = np.ascontiguousarray(np.asarray(drawn.buffer_rgba())[..., :3])
    # Flat colours and their edges: a palette looks the same and takes a quarter of the size.
    image = Image.fromarray(pixels).quantize(
        256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    content = io.BytesIO()
    image.save(content, format="PNG", optimize=True)
    return content.getvalue()


def polygon(rings: Sequence[Float64], **style: Any) -> PathPatch:
    """Return a patch of one outline and its holes; rings are open, float64 (N, 2)."""
    vertices: list[Float64] = []
    codes: list[int] = []
    for index, ring in enumerate(rings):
        vertices.append(np.concatenate([_oriented(ring, ccw=index == 0), ring[:1]]))
        codes += [int(Outline.MOVETO)] + [int(Outline.LINETO)] * (len(ring) - 1)
        codes.append(int(Outline.CLOSEPOLY))
    return PathPatch(Outline(np.concatenate(vertices), codes), **style)


def _oriented(ring: Float64, *, ccw: bool) -> Float64:
    """Return the ring counter-clockwise or clockwise; a hole has the opposite direction."""
    x, y = ring[:, 0], ring[:, 1]
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return ring if (area > 0.0) == ccw else ring[::-1]


def sample_ring(points: Float64, *, closed: bool = True) -> Float64:
    """Return points every few pixels along a line in pixels, float64 (M, 2)."""
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    starts = points if closed else points[:-1]
    pieces = [np.zeros((0, 2))]
    for start, end in zip(starts, ends, strict=True):
        count = max(int(np.hypot(*(end - start)) / OBSTACLE_STEP_PX), 1)
        fraction = np.arange(count)[:, None] / count
        pieces.append(start + fraction * (end - start))
    return np.concatenate(pieces)


def draw_labels(
    axes: Axes,
    texts: Sequence[str],
    anchors: Float64,
    colors: Sequence[str],
    obstacles: Float64,
    *,
    size: float = FONT_PT,
) -> None:
    """Draw labels near their anchors without overlaps, with leader lines for moved labels.

    Parameters
    ----------
    axes
        Axes with their final limits.
    texts, anchors, colors
        One each per label, the most important first; anchors float64 (N, 2) in data units.
    obstacles
        float64 (M, 2), pixels; see `place_labels`.
    size
        Font size, points.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    to_pixels = axes.transData
    halo = [withStroke(linewidth=2.6, foreground="white", alpha=0.92)]
    written = [
        axes.text(x, y, text, ha="center", va="center", fontsize=size, linespacing=1.05,
                  color="#15181c", zorder=LABEL_ZORDER, path_effects=halo)
        for text, (x, y) in zip(texts, anchors, strict=True)
    ]  # fmt: skip
    requests = []
    for item, anchor in zip(written, anchors, strict=True):
        box = item.get_window_extent(renderer)
        requests.append(
            LabelRequest(to_pixels.transform(anchor), np.array([box.width, box.height]))
        )
    area = axes.get_window_extent(renderer)
    limits = np.array([[area.x0, area.y0], [area.x1, area.y1]])
    centers = place_labels(requests, limits, obstacles)
    for item, request, center, color in zip(written, requests, centers, colors, strict=True):
        item.set_position(tuple(to_pixels.inverted().transform(center)))
        if np.any(np.abs(center - request.anchor) > 0.5 * request.size):
            _leader(axes, request, center, color, LABEL_ZORDER - 1.0)


def _leader(axes: Axes, request: LabelRequest, center: Float64, color: str, zorder: float) -> None:
    """Draw a line from the label's edge to its anchor."""
    offset = request.anchor - center
    to_edge = np.min((0.5 * request.size + 2.0) / np.maximum(np.abs(offset), 1e-9))
    ends = np.stack([center + offset * min(to_edge, 1.0), request.anchor])
    x, y = axes.transData.inverted().transform(ends).T
    halo = [withStroke(linewidth=2.2, foreground="white")]
    axes.plot(x, y, color=color, lw=1.1, zorder=LABEL_ZORDER, path_effects=halo)
    axes.plot(x[1:], y[1:], "o", color=color, ms=3.0, mec="white", mew=0.6, zorder=zorder)
