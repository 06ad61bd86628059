"""Tables of the report as HTML; text from files is escaped."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from html import escape
from typing import Any

import numpy as np

from tccm_ros.config import parameters
from tccm_ros.report import palette
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import SummaryFile, TimingFile
from tccm_ros.results.surface_counts import count_surfaces


def table(
    head: Sequence[str],
    rows: Iterable[Sequence[Any]],
    numbers: Sequence[int] = (),
    changed: Collection[int] = (),
) -> str:
    """Return an HTML table.

    Parameters
    ----------
    head
        Column titles, escaped here.
    rows
        Cells: text is escaped, `Markup` is not.
    numbers
        Indices of right-aligned columns.
    changed
        Indices of highlighted rows.
    """
    kind = [' class="number"' if i in numbers else "" for i in range(len(head))]
    titles = "".join(f"<th{k}>{escape(title)}</th>" for k, title in zip(kind, head, strict=True))
    lines = [f"<table><thead><tr>{titles}</tr></thead><tbody>"]
    for i, row in enumerate(rows):
        cells = "".join(f"<td{k}>{_cell(cell)}</td>" for k, cell in zip(kind, row, strict=True))
        lines.append(f'<tr class="changed">{cells}</tr>' if i in changed else f"<tr>{cells}</tr>")
    return "\n".join([*lines, "</tbody></table>"])


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table for a terminal, with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = ("  ".join(c.ljust(w) for c, w in zip(row, widths)).rstrip() for row in rows)
    return "\n".join(lines)


class Markup(str):
    """HTML that `table` does not escape."""


def _cell(value: Any) -> str:
    if isinstance(value, Markup):
        return value
    return escape("" if value is None else str(value))


def headline(results: Results) -> str:
    """Return the counts of a map in one line of plain text."""
    standing = results.above_floor
    parts = [
        count_surfaces(standing).text(),
        _count(len(results.walls), "wall"),
        _count(len(results.view_stamps()), "3D view"),
        _count(len(results.planes), "cycle"),
        f"{results.trajectory.length:.1f} m driven",
    ]
    area = sum(s.area for s in standing)
    return ", ".join(parts) + f"; {area:.2f} m² to put objects on"


def _count(number: int, name: str) -> str:
    return f"{number} {name}{'' if number == 1 else 's'}"


def surfaces_table(results: Results) -> str:
    """Return the surfaces with their colours, by id."""
    colors = palette.surface_colors(results.surfaces)
    rows = []
    for surface in sorted(results.surfaces, key=lambda s: s.id):
        swatch = Markup(f'<span class="swatch" style="background:{colors[surface.id]}"></span>')
        name = Markup(f"{swatch}{escape(surface.label)}")
        spread = "" if surface.height_std is None else f"{surface.height_std * 1000:.1f}"
        seen = "" if surface.last_seen is None else f"{surface.last_seen - results.start:.1f}"
        height = f"{surface.height - results.ground:z.3f}"
        rows.append(
            (surface.id, name, height, f"{surface.area:.2f}", spread, len(surface.views), seen)
        )
    head = (
        "id",
        "label",
        "height over floor, m",
        "area, m²",
        "spread, mm",
        "views",
        "last seen, s",
    )
    return table(head, rows, numbers=(0, 2, 3, 4, 5, 6))


def racks_table(results: Results) -> str:
    """Return the compartments of racks; empty if there are none."""
    if not results.compartments:
        return ""
    rows = []
    for space in results.compartments:
        above = "" if space.above is None else space.above
        bottom = f"{space.front[:, 2].mean() - results.ground:z.3f}"
        lengths = [f"{length:.3f}" for length in (space.height, space.width, space.depth)]
        faces = [f.value for f in (space.left, space.right, space.back, space.ceiling)]
        front = f"{space.front_seen:.0%}"
        parts = len(space.open_parts)
        rows.append((space.rack, space.board, above, bottom, *lengths, *faces, front, parts))
    head = (
        "rack",
        "board",
        "below",
        "height over floor, m",
        "clear height, m",
        "width, m",
        "depth, m",
        "left",
        "right",
        "back",
        "ceiling",
        "front seen",
        "standing open",
    )
    return table(head, rows, numbers=(0, 1, 2, 3, 4, 5, 6, 11, 12))


def signs_table(results: Results) -> str:
    """Return the door signs with their positions; empty if there are none."""
    if not results.signs:
        return ""
    rows = []
    for sign in results.signs:
        sigma = 1000.0 * float(np.sqrt(np.trace(sign.covariance)))
        position = " ".join(f"{value:.2f}" for value in sign.position)
        wall = "" if sign.wall is None else sign.wall
        rows.append(
            (sign.id, sign.number, sign.text, f"{sign.confidence:.2f}", position, f"{sigma:.0f}",
             wall, len(sign.views))
        )  # fmt: skip
    head = ("id", "number", "text", "confidence", "x y z, m", "sigma, mm", "wall", "views")
    return table(head, rows, numbers=(0, 3, 5, 6, 7))


def loops_table(results: Results) -> str:
    """Return the proposed loop closures; empty if there are none."""
    if not results.graph.loops:
        return ""
    rows = [
        (loop.from_, loop.to, "accepted" if loop.accepted else "refused", loop.reason)
        for loop in results.graph.loops
    ]
    return table(("from keyframe", "to keyframe", "", "why"), rows, numbers=(0, 1))


def counts_table(summary: SummaryFile) -> str:
    """Return the content of summary.json except configuration and dropped scans."""
    tree = asdict(summary)
    counts = tree.pop("counts")
    del tree["config"], counts["dropped"]
    rows = [(key, _value(v)) for key, v in flatten(tree | counts)]
    return table(("count", "value"), rows, numbers=(1,))


def drops_table(summary: SummaryFile) -> str:
    """Return the numbers of dropped scans by reason."""
    dropped = summary.counts.dropped
    if not dropped:
        return '<p class="note">no scan was dropped</p>'
    return table(("reason", "scans"), [(k, _value(v)) for k, v in dropped.items()], numbers=(1,))


def timing_table(timing: TimingFile) -> str:
    """Return the content of timing.json."""
    rows = [(key, _value(v)) for key, v in flatten(asdict(timing))]
    return table(("stage", "value"), rows, numbers=(1,))


def configuration_table(summary: SummaryFile) -> str:
    """Return the configuration, with values marked that differ from the defaults."""
    known = {p.name: p for p in parameters()}
    rows: list[tuple[str, ...]] = []
    changed: set[int] = set()
    for name, value in flatten(summary.config, joiner="."):
        parameter = known.get(name)
        if parameter and _plain(value) != _plain(parameter.default):
            changed.add(len(rows))
        unit, meaning = (parameter.unit, parameter.meaning) if parameter else ("", "")
        rows.append((name, _value(value), unit, meaning))
    return table(("parameter", "value", "unit", "meaning"), rows, changed=changed)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, (tuple, list)) else value


SEPARATOR = ": "


def flatten(tree: Any, prefix: str = "", joiner: str = SEPARATOR) -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested mappings with their joined keys, in order.

    Parameters
    ----------
    tree
        Mappings and leaves.
    prefix
        Joined keys of the outer mappings.
    joiner
        Text between the keys.
    """
    if not isinstance(tree, Mapping):
        yield prefix, tree
        return
    for key, value in tree.items():
        yield from flatten(value, f"{prefix}{joiner}{key}" if prefix else str(key), joiner)


def _value(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_value(v) for v in value)
    return str(value)
