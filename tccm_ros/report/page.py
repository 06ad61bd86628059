"""The page around the three-dimensional view, common to the report and the live page."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from importlib.resources import files
from string import Template

SCRIPTS = ("math", "shaders", "draw", "camera", "scene", "hover", "main")
"""Modules of the view's script, in order of dependency."""

MAP_LAYERS = {
    "surfaces": ("surfaces", True),
    "boundaries": ("boundaries", True),
    "labels": ("labels", True),
    "objects": ("objects on surfaces", True),
    "free": ("free places", False),
    "racks": ("compartments of racks", False),
    "floor_objects": ("objects on the floor", False),
    "walls": ("walls", True),
    "signs": ("door signs", True),
    "path": ("path", True),
    "floor": ("floor", True),
}
"""Name on the page and initial visibility, by layer of main.js, of a map without its cuboids."""


def viewer_page(
    title: str,
    head: str,
    headline: str,
    layers: Mapping[str, tuple[str, bool]],
    *,
    controls: str = "",
    cuboids: str = "",
    time: str = "",
    sections: str,
    scripts: str,
) -> str:
    """Return the HTML of a page with the view.

    Parameters
    ----------
    title, headline
        Plain text.
    head
        Elements that bring the style.
    layers
        Name on the page and initial visibility, by layer of main.js.
    controls, cuboids, time
        Elements of the panel before and after the layers, and below the view.
    sections, scripts
        Elements below the view, and at the end.
    """
    return Template(viewer_asset("page.html")).substitute(
        title=escape(title.lower()),
        heading=escape(title),
        head=head,
        headline=escape(headline),
        layers="\n".join(_layer(*item) for item in layers.items()),
        controls=controls,
        cuboids=cuboids,
        time=time,
        sections=sections,
        scripts=scripts,
    )


def viewer_asset(name: str) -> str:
    """Return the text of a file of the view."""
    return files("tccm_ros.report").joinpath("viewer", name).read_text(encoding="utf-8")


def viewer_script() -> str:
    """Return the script that defines the view."""
    return "\n".join(viewer_asset(f"{name}.js") for name in SCRIPTS)


def _layer(name: str, shown: tuple[str, bool]) -> str:
    title, at_first = shown
    checked = " checked" if at_first else ""
    return f'<label><input type="checkbox" id="layer-{name}"{checked}> {escape(title)}</label>'
