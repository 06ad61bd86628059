"""Draw docs/images/architecture.svg: the layers of the package and what each imports.

Usage: python tools/draw_architecture.py [OUT.svg] (`make figures`)

The layers and their order are those of `test/test_structure.py`, the arrows are the imports of the
code. What every layer may use is at the bottom, without arrows; imports that follow from
others are left out.
"""

from __future__ import annotations

import ast
import re
import runpy
import sys
from pathlib import Path
from textwrap import wrap

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).resolve().parents[1]
STRUCTURE = runpy.run_path(str(ROOT / "test" / "test_structure.py"))

COLUMNS = {
    "from records to poses": ["robot", "sensors"],
    "the TCCM": ["cuboids", "outlines", "planes", "tabletop", "baselines"],
    "walls and surfaces": [
        "signs",
        "slam",
        "rooms",
        "racks",
        "surfaces",
        "mapping",
        "scene",
        "approach",
    ],
    "messages and files": ["ros", "bags", "results"],
    "what is started": [
        "report",
        "evaluate",
        "calibrate",
        "warm_up",
        "replay",
        "view",
        "agents",
        "nodes",
        "fleet",
        "client",
        "cli",
    ],
}
"""How the picture is read, from left to right; `ground` stands below."""

BOX_WIDTH, BOX_HEIGHT, COLUMN, ROW = 2.6, 0.86, 3.3, 1.25
"""In the unit of the drawing."""

CENTRED = {"ha": "center", "va": "center", "zorder": 3}

Edges = dict[str, set[str]]


def direct_imports() -> Edges:
    """Return the layers that each layer imports."""
    layers = STRUCTURE["LAYERS"]
    found: Edges = {layer: set() for layer in layers}
    for path in STRUCTURE["modules"]():
        names = [n.split(".")[1] for n in STRUCTURE["imports"](path) if n.startswith("tccm_ros.")]
        layer = STRUCTURE["layer_of"](path)
        found[layer] |= {name for name in names if name in found} - {layer}
    return found


def ground(layers: list[str]) -> list[str]:
    """Return the layers above the first that knows the robot: every layer may use them."""
    return layers[: layers.index("robot")]


def reduced(edges: Edges) -> Edges:
    """Leave out what follows from other imports."""
    above: Edges = {}
    for layer in edges:
        above[layer] = edges[layer].union(*(above[other] for other in edges[layer]))
    return {
        layer: {a for a in others if not any(a in above[b] for b in others - {a})}
        for layer, others in edges.items()
    }


def caption(layer: str) -> str:
    """Return the beginning of a layer's docstring, in two lines at most."""
    folder = ROOT / "tccm_ros" / layer / "__init__.py"
    source = folder if folder.exists() else ROOT / "tccm_ros" / f"{layer}.py"
    sentence = (ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or "").split("\n")[
        0
    ]
    return "\n".join(wrap(re.split(r"[:,.]", sentence)[0].replace("`", ""), 27)[:2])


def draw(out: Path) -> None:
    """Draw the picture; the same code gives the same bytes."""
    imports = direct_imports()
    below = ground(list(imports))
    places = {
        layer: (COLUMN * k, -ROW * (i + (6 - len(layers)) / 2))
        for k, layers in enumerate(COLUMNS.values())
        for i, layer in enumerate(layers)
    }
    missing = imports.keys() - places.keys() - set(below)
    if missing:
        raise SystemExit(f"{', '.join(sorted(missing))}: no column of the picture; see COLUMNS")
    figure, axes = plt.subplots(figsize=(13.0, 6.6))
    edges = reduced({r: o - set(below) for r, o in imports.items() if r not in below})
    for layer, others in edges.items():
        for other in sorted(others):
            _arrow(axes, places[other], places[layer])
    for layer, place in places.items():
        _box(axes, place, (BOX_WIDTH, BOX_HEIGHT), "#d9e6f2")
        axes.text(place[0], place[1] + 0.24, layer, weight="bold", **CENTRED)
        axes.text(place[0], place[1] - 0.16, caption(layer), fontsize=8, **CENTRED)
    for k, title in enumerate(COLUMNS):
        axes.text(COLUMN * k, 0.85, title, style="italic", color="#4a5560", **CENTRED)
    middle = COLUMN * (len(COLUMNS) - 1) / 2
    place = middle, -6.15 * ROW
    _box(axes, place, (2 * middle + BOX_WIDTH, 0.7), "#ececec")
    axes.text(*place, "every layer may use:   " + ",  ".join(below), **CENTRED)
    axes.set_xlim(-1.5, 2 * middle + 1.5)
    axes.set_ylim(-6.6 * ROW, 1.2)
    axes.axis("off")
    figure.savefig(out, metadata={"Date": None, "Creator": None}, bbox_inches="tight")
    plt.close(figure)


def _arrow(axes: plt.Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw an arrow between neighbours, or around what stands between them."""
    (x0, y0), (x1, y1) = start, end
    bend = "arc3"
    if x0 != x1:
        start, end = (x0 + BOX_WIDTH / 2, y0), (x1 - BOX_WIDTH / 2, y1)
    elif y0 - y1 < 1.5 * ROW:
        start, end = (x0, y0 - BOX_HEIGHT / 2), (x1, y1 + BOX_HEIGHT / 2)
    else:
        start, end = (x0 - BOX_WIDTH / 2, y0), (x1 - BOX_WIDTH / 2, y1)
        bend = "arc3,rad=0.25"
    style = {"arrowstyle": "-|>", "color": "#7a8794", "connectionstyle": bend}
    axes.annotate("", xy=end, xytext=start, arrowprops=style, zorder=1)


def _box(axes: plt.Axes, place: tuple[float, float], size: tuple[float, float], color: str) -> None:
    corner = place[0] - size[0] / 2, place[1] - size[1] / 2
    look = {"boxstyle": "round,pad=0,rounding_size=0.1", "edgecolor": "#4a5560", "zorder": 2}
    axes.add_patch(FancyBboxPatch(corner, *size, facecolor=color, **look))


if __name__ == "__main__":
    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "tccm_ros", "svg.fonttype": "none"})
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images" / "architecture.svg")
