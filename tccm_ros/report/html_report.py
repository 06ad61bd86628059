"""Write report.html: the map in three dimensions, pictures and tables in one offline page."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from tccm_ros.atomic import write_output
from tccm_ros.report.array_pack import ArrayPack
from tccm_ros.report.page import MAP_LAYERS, viewer_asset, viewer_page, viewer_script
from tccm_ros.report.pictures import Pictures, draw_pictures
from tccm_ros.report.scene import build_scene
from tccm_ros.report.tables import (
    configuration_table,
    counts_table,
    drops_table,
    headline,
    loops_table,
    racks_table,
    signs_table,
    surfaces_table,
    timing_table,
)
from tccm_ros.results.folder_reader import Results, load_results

TIMING_START = "<!-- timing: measured on the clock, differs between runs -->"
TIMING_END = "<!-- end of timing -->"
"""Marks around the only section in which reports of the same input may differ."""

LAYERS = MAP_LAYERS | {
    "path": ("path, 3D views", True),
    "cuboids": ("cuboids", True),
    "planes": ("planes, horizontal", True),
    "other_planes": ("planes, other", False),
    "cores": ("center cores", False),
}
"""Name on the page and initial visibility, by layer."""


def write_report(folder: Path | str) -> Path:
    """Write report.html into a result folder and return its path.

    Parameters
    ----------
    folder
        Output folder of ``tccm replay --out``.

    Raises
    ------
    MapError
        If a file is missing or damaged.
    OutputError
        If the report cannot be written.
    """
    results = load_results(folder)
    return write_page(results, draw_pictures(results), folder)


def write_page(results: Results, pictures: Pictures, folder: Path | str) -> Path:
    """Write report.html into a folder and return its path.

    Parameters
    ----------
    results
        The map.
    pictures
        Pictures of the same results.
    folder
        Output folder, created if needed.

    Raises
    ------
    OutputError
        If the page cannot be written.
    """
    path = Path(folder) / "report.html"
    write_output(path, report_html(results, pictures))
    return path


def report_html(results: Results, pictures: Pictures) -> str:
    """Return the page; the same results give the same text."""
    pack = ArrayPack()
    scene = build_scene(results, pack)
    return viewer_page(
        "Surface map",
        f"<style>\n{viewer_asset('page.css')}\n</style>",
        headline(results),
        LAYERS,
        cuboids=viewer_asset("cuboids.html"),
        time=viewer_asset("time.html"),
        sections="\n".join(_sections(results, pictures)),
        scripts=Template(viewer_asset("data.html")).substitute(
            scene=_json(scene),
            arrays=pack.text(),
            script=f"{viewer_script()}\n{viewer_asset('start.js')}",
        ),
    )


def _json(tree: Any) -> str:
    """Return JSON without characters that could end the HTML element around it."""
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _sections(results: Results, pictures: Pictures) -> Iterator[str]:
    summary = results.summary
    yield _section("above", "From above", _picture(pictures.above, "the map from above"))
    yield _section("surfaces", "Surfaces", f'<div class="wide">{surfaces_table(results)}</div>')
    yield _section("racks", "Racks", racks_table(results))
    yield '<div class="tables">'
    if summary is not None:
        yield _section("counts", "Counts", counts_table(summary))
        yield _section("drops", "Dropped scans", drops_table(summary))
    yield _section("signs", "Door signs", signs_table(results))
    yield _section("loops", "Loop closures", loops_table(results))
    if results.timing is not None:
        table = f"{TIMING_START}\n{timing_table(results.timing)}\n{TIMING_END}"
        yield _section("timing", "Timing", table)
    yield "</div>"
    perspective = _picture(pictures.perspective, "the map in perspective")
    yield _section("perspective", "In perspective", perspective)
    if summary is not None:
        yield (
            '<section id="configuration"><details><summary>Configuration</summary>'
            '<p class="note">What differs from the defaults is marked.</p>'
            f'<div class="wide">{configuration_table(summary)}</div></details></section>'
        )


def _section(name: str, title: str, content: str) -> str:
    if not content:
        return ""
    return f'<section id="{name}">\n<h2>{escape(title)}</h2>\n{content}\n</section>'


def _picture(content: bytes, text: str) -> str:
    data = base64.b64encode(content).decode("ascii")
    return f'<img alt="{escape(text)}" width="900" src="data:image/png;base64,{data}">'
