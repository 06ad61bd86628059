"""report.html: one file that opens anywhere, offline, and shows what was mapped."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from tccm_ros.errors import OutputError, one_line
from tccm_ros.pipeline.report.map3d_picture import write_map3d
from tccm_ros.pipeline.report.map_picture import write_map
from tccm_ros.pipeline.report.scene import build_scene
from tccm_ros.pipeline.report.tables import (
    configuration,
    configuration_table,
    counts_table,
    drops_table,
    headline,
    loops_table,
    surfaces_table,
    timing_table,
)
from tccm_ros.results.folder_reader import Results, load_results

__all__ = ["TIMING_END", "TIMING_START", "report_html", "write_report"]

SCRIPTS = ("math", "shaders", "draw", "camera", "scene", "hover", "main")
"""The page's script, in the order in which its parts use each other."""

TIMING_START = "<!-- timing: measured on the clock, differs between runs -->"
TIMING_END = "<!-- end of timing -->"
"""Between these, and nowhere else, two reports of the same input may differ."""

LAYERS = {
    "surfaces": ("surfaces", True),
    "boundaries": ("boundaries", True),
    "labels": ("labels", True),
    "objects": ("objects on surfaces", True),
    "free": ("free places", False),
    "things": ("things on the floor", False),
    "walls": ("walls", True),
    "path": ("path, 3D views", True),
    "cuboids": ("cuboids", True),
    "planes": ("planes, level", True),
    "upright": ("planes, other", False),
    "cores": ("center cores", False),
    "floor": ("floor", True),
}
"""Layer -> its name on the page, and whether it shows at first."""


def write_report(folder: Path | str, truth: Path | str | None = None) -> Path:
    """Write report.html into a result folder and return its path.

    Parameters
    ----------
    folder
        What ``tccm replay --out`` wrote.
    truth
        As in `write_pictures`.

    Raises
    ------
    MapError
        If a file is missing or damaged.
    OutputError
        If the report cannot be written.
    """
    text = report_html(load_results(folder, truth))
    path = Path(folder) / "report.html"
    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)})") from None
    return path


def report_html(results: Results) -> str:
    """Return the whole page; the same results give the same text."""
    scene, pack = build_scene(results)
    return Template(_asset("page.html")).substitute(
        style=_asset("page.css"),
        headline=escape(headline(results)),
        layers="\n".join(_layer(*item) for item in LAYERS.items()),
        sections="\n".join(_sections(results)),
        scene=_json(scene),
        arrays=pack.text(),
        script="\n".join(_asset(f"{name}.js") for name in SCRIPTS),
    )


def _asset(name: str) -> str:
    return files("tccm_ros.pipeline.report").joinpath("viewer", name).read_text(encoding="utf-8")


def _layer(name: str, shown: tuple[str, bool]) -> str:
    title, at_first = shown
    checked = " checked" if at_first else ""
    return f'<label><input type="checkbox" id="layer-{name}"{checked}> {escape(title)}</label>'


def _json(tree: Any) -> str:
    """Return JSON that cannot end the element around it."""
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _sections(results: Results) -> Iterator[str]:
    yield _section("above", "From above", _picture(results, write_map, "the map from above"))
    yield _section("surfaces", "Surfaces", f'<div class="wide">{surfaces_table(results)}</div>')
    yield '<div class="tables">'
    yield _section("counts", "Counts", counts_table(results.summary))
    yield _section("drops", "Dropped scans", drops_table(results.summary))
    yield _section("loops", "Loop closures", loops_table(results))
    if results.timing:
        table = f"{TIMING_START}\n{timing_table(results.timing)}\n{TIMING_END}"
        yield _section("timing", "Timing", table)
    yield "</div>"
    yield _section(
        "perspective", "In perspective", _picture(results, write_map3d, "the map in perspective")
    )
    if configuration(results.summary):
        yield (
            '<section id="configuration"><details><summary>Configuration</summary>'
            '<p class="note">What differs from the defaults is marked.</p>'
            f'<div class="wide">{configuration_table(results.summary)}</div></details></section>'
        )


def _section(name: str, title: str, content: str) -> str:
    if not content:
        return ""
    return f'<section id="{name}">\n<h2>{escape(title)}</h2>\n{content}\n</section>'


def _picture(results: Results, draw: Any, text: str) -> str:
    buffer = io.BytesIO()
    draw(results, buffer)
    content = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<img alt="{escape(text)}" width="900" src="data:image/png;base64,{content}">'
