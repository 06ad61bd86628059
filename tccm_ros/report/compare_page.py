"""Draw the comparison of two maps as a picture and as a page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tccm_ros.arrays import Float64
from tccm_ros.atomic import write_output
from tccm_ros.records import Wall
from tccm_ros.report import palette
from tccm_ros.report.changes import Kind
from tccm_ros.report.compare import Comparison
from tccm_ros.report.drawing import (
    canvas,
    draw_labels,
    png,
    polygon,
    sample_ring,
    show_extent,
)
from tccm_ros.report.label_layout import label_point
from tccm_ros.report.map_picture import extent
from tccm_ros.report.page import viewer_asset
from tccm_ros.report.tables import table
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import SurfaceEntry

COLORS: dict[Kind, str] = {
    Kind.SAME: "#9aa5b1",
    Kind.MOVED: "#e69f00",
    Kind.CAME: "#009e73",
    Kind.WENT: "#d55e00",
}
"""Colours of changes, distinct for colour-blind readers; surfaces that went are hatched as well."""

WIDTH_IN = 12.0
"""Width of the picture, inches."""

HEIGHTS_IN = (3.0, 10.0)
"""Limits of the height of the maps, inches."""

TITLE_IN, LEGEND_IN = 0.35, 0.42
"""Heights of title and legend, inches."""


def write_comparison(comparison: Comparison, folder: Path | str) -> tuple[Path, Path]:
    """Write compare.png and compare.html into a folder, created if needed; return their paths.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    picture, page = Path(folder) / "compare.png", Path(folder) / "compare.html"
    drawn = comparison_png(comparison)
    write_output(picture, drawn)
    write_output(page, _page(comparison, drawn))
    return picture, page


def comparison_png(comparison: Comparison) -> bytes:
    """Draw both maps with the same limits as a PNG file, byte-identical for the same maps."""
    corners = [extent(comparison.before), extent(comparison.after)]
    low, high = np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)
    scale = WIDTH_IN / 2.0 / (high[0] - low[0])
    maps = float(np.clip((high[1] - low[1]) * scale, *HEIGHTS_IN))
    height = maps + TITLE_IN + LEGEND_IN
    with canvas(WIDTH_IN, height) as (figure, left):
        right = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        sides = ((left, comparison.before, "before"), (right, comparison.after, "after"))
        for index, (axes, results, title) in enumerate(sides):
            axes.set_axis_off()
            axes.set_position((index * 0.5, LEGEND_IN / height, 0.5, maps / height))
            middle = index * 0.5 + 0.25
            figure.text(
                middle, 1.0 - TITLE_IN / height / 2, title, ha="center", va="center", size=11
            )
            _draw_side(axes, comparison, results, (low, high))
        figure.legend(handles=_legend(), loc="lower center", ncols=5, frameon=False)
        return png(figure)


def _draw_side(
    axes: Axes,
    comparison: Comparison,
    results: Results,
    corners: tuple[Float64, Float64],
) -> None:
    show_extent(axes, corners[0], corners[1])
    is_after = results is comparison.after
    shown: list[SurfaceEntry] = []
    for change in comparison.surfaces:
        surface = change.after if is_after else change.before
        if surface is not None and len(surface.boundary) > 2:
            _draw_surface(axes, surface, change.kind)
            shown.append(surface)
        if is_after and change.kind == Kind.MOVED and change.before and change.after:
            _draw_move(axes, change.before, change.after)
    for wall_change in comparison.walls:
        wall = wall_change.after if is_after else wall_change.before
        if wall is not None:
            _draw_wall(axes, wall, wall_change.kind)
    path = results.trajectory.positions
    axes.plot(path[:, 0], path[:, 1], color=palette.PATH, lw=0.9, zorder=6)
    to_pixels = axes.transData.transform
    obstacles = [sample_ring(to_pixels(s.boundary[:, :2])) for s in shown]
    obstacles += [sample_ring(to_pixels(w.endpoints), closed=False) for w in results.walls]
    draw_labels(
        axes,
        [f"{s.label} {s.id}\n{s.height - results.ground:.2f} m" for s in shown],
        np.array([label_point(s)[:2] for s in shown]).reshape(-1, 2),
        [palette.VIEW] * len(shown),
        np.concatenate([np.zeros((0, 2)), *obstacles]),
        size=8.0,
    )


def _draw_surface(axes: Axes, surface: SurfaceEntry, kind: Kind) -> None:
    rings = [ring[:, :2] for ring in (surface.boundary, *surface.holes) if len(ring) > 2]
    color = COLORS[kind]
    axes.add_patch(polygon(rings, fc=color, ec="none", alpha=0.45, zorder=3))
    hatch = "///" if kind == Kind.WENT else None
    axes.add_patch(polygon(rings, fill=False, ec=color, lw=1.5, hatch=hatch, zorder=4))


def _draw_move(axes: Axes, before: SurfaceEntry, after: SurfaceEntry) -> None:
    axes.add_patch(polygon([before.boundary[:, :2]], fill=False, ec=COLORS[Kind.MOVED], lw=1.0,
                           ls=(0, (3, 2)), zorder=4))  # fmt: skip
    arrow = {"arrowstyle": "->", "color": palette.VIEW, "lw": 1.2}
    end, start = ((float(s.centroid[0]), float(s.centroid[1])) for s in (after, before))
    axes.annotate("", end, start, arrowprops=arrow, zorder=5)


def _draw_wall(axes: Axes, wall: Wall, kind: Kind) -> None:
    color = palette.WALL if kind == Kind.SAME else COLORS[kind]
    style = "solid" if kind != Kind.WENT else (0, (2, 1))
    axes.plot(*wall.endpoints.T, color=color, lw=3.0, ls=style, zorder=5)


def _legend() -> Sequence[Patch | Line2D]:
    changes = [
        Patch(fc=color, ec=color, alpha=0.6, label=kind, hatch="///" if kind == Kind.WENT else None)
        for kind, color in COLORS.items()
    ]
    return [*changes, Line2D([], [], color=palette.WALL, lw=3, label="wall")]


def _page(comparison: Comparison, drawn: bytes) -> str:
    content = base64.b64encode(drawn).decode("ascii")
    head = ("change", "label", "id", "height over floor, m", "area, m²", "shift, m")
    notes = "</p>\n<p>".join(map(escape, comparison.notes()))
    rows = table(head, comparison.surface_rows(), numbers=(5,))
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>tccm_ros: two maps</title>
<style>
{viewer_asset("page.css")}</style>
</head>
<body>
<header><h1>Two maps</h1>
<p>{notes}</p></header>
<main>
<section id="maps">
<img alt="both maps" width="1150" src="data:image/png;base64,{content}">
</section>
<section id="surfaces"><h2>Surfaces</h2>
<div class="wide">{rows}</div></section>
</main>
</body>
</html>
"""
