"""Draw the pictures of the README and the documentation from a result folder.

Usage: python tools/draw_figures.py RESULTS [OUT] (`make figures`)
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from tccm_ros.atomic import output_file
from tccm_ros.errors import MapError
from tccm_ros.geometry import transform
from tccm_ros.report import palette
from tccm_ros.report.drawing import canvas, png
from tccm_ros.report.map3d_picture import map3d_png
from tccm_ros.report.map_picture import extent, map_png
from tccm_ros.results.cycles_file import CycleParts
from tccm_ros.results.folder_reader import Results, load_results

PANELS = 4
"""Tilt cycles that are drawn."""

WIDTH_IN, TITLE_IN = 9.0, 0.3
"""Width of the picture and height of its titles, inches."""

HEIGHTS_IN = (1.2, 4.0)
"""Limits of the height of a panel, inches."""

HEIGHTS_M = (0.12, 1.6)
"""Cuboids that begin between these heights over the floor are drawn, m: the furniture."""

OLD_COLOR, NEW_COLOR = np.array(to_rgb("#dfe4ea")), np.array(to_rgb("#0b3c6f"))


def write_figures(folder: Path | str, out: Path | str) -> list[Path]:
    """Draw map.png, map3d.png and, where there are cycles, forgetting.png into a folder.

    Parameters
    ----------
    folder
        What ``tccm replay --out`` wrote.
    out
        Folder of the pictures; created if needed.

    Raises
    ------
    MapError
        If a file is missing or damaged.
    OutputError
        If a picture cannot be written.
    """
    results, out = load_results(folder), Path(out)
    drawn = {"map.png": map_png(results), "map3d.png": map3d_png(results)}
    if results.cycles is not None and len(results.cycles):
        drawn["forgetting.png"] = forgetting_png(results)
    for name, content in drawn.items():
        with output_file(out / name) as made:
            made.write_bytes(content)
    return [out / name for name in drawn]


def forgetting_png(results: Results) -> bytes:
    """Draw the integration map from above after some tilt cycles: dark is new, pale is old.

    Raises
    ------
    MapError
        If the folder has no cycles.
    """
    cycles = results.cycles
    if cycles is None or len(cycles) == 0:
        raise MapError(f"{results.folder}: no cycles.npz; replay the bag again")
    low, high = extent(results)
    shown = np.unique(np.linspace(min(2, len(cycles) - 1), len(cycles) - 1, PANELS).astype(int))
    width = WIDTH_IN / PANELS
    tall = float(np.clip(width * (high[1] - low[1]) / (high[0] - low[0]), *HEIGHTS_IN))
    with canvas(WIDTH_IN, tall + TITLE_IN) as (figure, _):
        for index, at in enumerate(shown.tolist()):
            axes = figure.add_axes((index / PANELS, 0.0, 0.98 / PANELS, tall / (tall + TITLE_IN)))
            axes.set_axis_off()
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[1], high[1])
            axes.set_aspect("equal")
            _draw_cycle(axes, results, cycles, at)
            axes.set_title(f"after cycle {cycles.cycles[at]}", fontsize=9)
        return png(figure)


def _draw_cycle(axes: Axes, results: Results, cycles: CycleParts, at: int) -> None:
    first = max(at + 1 - cycles.window, 0)
    begin, end = cycles.offsets[first], cycles.offsets[at + 1]
    rows = slice(begin, end)
    cell = np.stack([cycles.ix[rows], cycles.iy[rows]], axis=1) + 0.5
    points = np.column_stack([cell * cycles.cell_size, cycles.top[rows] * 0.01])
    bottom = cycles.bottom[rows] * 0.01 - results.ground
    x, y, z = transform(cycles.T_map_odom[at], points).T
    age = at - np.repeat(np.arange(first, at + 1), np.diff(cycles.offsets[first : at + 2]))
    kept = (z - results.ground > HEIGHTS_M[0]) & (bottom < HEIGHTS_M[1])
    fraction = np.clip(age[kept] / max(cycles.window - 1, 1), 0.0, 1.0)[:, None]
    colors = NEW_COLOR + fraction * (OLD_COLOR - NEW_COLOR)
    axes.scatter(x[kept], y[kept], c=colors, s=0.8, marker="s", linewidths=0.0, zorder=2)
    for wall in results.walls:
        axes.plot(*wall.endpoints.T, color=palette.WALL, lw=0.6, alpha=0.5, zorder=1)
    path = results.trajectory
    if len(path.stamps):
        here = int(path.nearest(np.array([cycles.stamps_ns[at] * 1e-9]))[0])
        axes.plot(*path.positions[: here + 1, :2].T, color=palette.PALETTE[5], lw=0.8, zorder=3)
        axes.plot(*path.positions[here, :2], "o", ms=3.5, color=palette.PALETTE[5], zorder=4)


if __name__ == "__main__":
    write_figures(*sys.argv[1:], *(["docs/images"] if len(sys.argv) == 2 else []))
