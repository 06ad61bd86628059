"""Write docs/reference/interfaces.md: every field of tccm_interfaces with type, unit and meaning.

What the definitions say is read with ROS's own parser: a comment before a field belongs to it, and
what stands in brackets is its unit (``[-]``: it has none).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from rosidl_adapter.parser import (
    parse_action_string,
    parse_message_string,
    parse_service_string,
)

PACKAGE = "tccm_interfaces"
ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference" / "interfaces.md"

HEAD = f"""\
# Messages, services and actions

The messages and services of the package `{PACKAGE}`; `interfaces/README.md` says how it is built.
Units are SI; a unit of `-` says that there is none. A field without a unit has a message type: the
units are those of its fields. Unknown values are nan in a number, -1 in an id, 0 in a stamp, and
empty in a text or a list.

[The page of the nodes](nodes.md) lists who publishes and answers them, where the package is
installed.

This page is made from the definitions by `python tools/document_interfaces.py`.
"""

SECTIONS = {
    "Messages": ("msg", parse_message_string, ()),
    "Services": ("srv", parse_service_string, ("request", "response")),
    "Actions": ("action", parse_action_string, ("goal", "result", "feedback")),
}
"""By heading: the folder, what parses its definitions, and the parts that they have."""


def page() -> str:
    """Return the page."""
    return HEAD + "".join(
        f"\n## {heading}\n" + "".join(chapter(path) for path in definitions(folder))
        for heading, (folder, *_) in SECTIONS.items()
    )


def definitions(folder: str) -> list[Path]:
    """Return the definitions in a folder of the package."""
    return sorted((ROOT / "interfaces" / folder).iterdir())


def parts_of(path: Path) -> dict[str, Any]:
    """Return by name what a definition consists of; a message is one part without a name."""
    parse, names = next((p, names) for f, p, names in SECTIONS.values() if f == path.parent.name)
    whole = parse(PACKAGE, path.stem, path.read_text())
    return {name: getattr(whole, name) for name in names} or {"": whole}


def chapter(path: Path) -> str:
    """Return what the page says of a definition."""
    parts = parts_of(path)
    text = f"\n### {path.stem}\n\n{comment(next(iter(parts.values())))}\n"
    for name, part in parts.items():
        if name:
            text += f"\n{name.capitalize()}:" + ("\n" if part.fields else " nothing.\n")
        if part.fields:
            text += table(part)
    return text


def table(part: Any) -> str:
    """Return the tables of the fields and of the constants of a message or a part of a service."""
    lines = ["| field | type | unit | meaning |", "|---|---|---|---|"]
    for field in part.fields:
        default = "" if field.default_value is None else f" Default {field.default_value}."
        unit = field.annotations.get("unit", "")
        meaning = comment(field) + default
        lines.append(f"| `{field.name}` | {type_name(field)} | {unit} | {meaning} |")
    if part.constants:
        lines += ["", "| constant | value | meaning |", "|---|---|---|"]
        lines += [f"| `{c.name}` | {c.value} | {comment(c)} |" for c in part.constants]
    return "\n" + "\n".join(lines) + "\n"


def type_name(field: Any) -> str:
    """Return the type of a field; one of this package as a link."""
    name = str(field.type)
    if field.type.pkg_name != PACKAGE:
        return name
    own = name.removeprefix(f"{PACKAGE}/")
    return f"[{own.replace('[', chr(92) + '[')}](#{field.type.type.lower()})"


def comment(item: Any) -> str:
    """Return what the definition says of a message, a field or a constant, in one line."""
    unit = f"[{item.annotations.get('unit')}]"  # the parser leaves it where it begins a line
    text = " ".join(item.annotations.get("comment", [])).replace(unit, "")
    return " ".join(text.split())


def main() -> int:
    """Write the page."""
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page())
    return 0


if __name__ == "__main__":
    sys.exit(main())
