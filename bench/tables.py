"""The tables that a benchmark prints, as numbers: what `run.py` saves and `compare.py` reads.

A table is Markdown: a row of columns, a row of dashes, rows of cells. A row is known by its cells
before the first number, a table by the heading above it. A cell's value is its first
number; the others in it are spreads or counts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile

NUMBER = re.compile(
    r"(?<![\w.])[-+]?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE
)
SEPARATOR = re.compile(r"^\|[\s:|-]+\|$")


@dataclass(frozen=True, slots=True)
class Value:
    """One number of a table.

    Attributes
    ----------
    table, row, column
        Where it stands.
    value
        In the unit that the column names.
    """

    table: str
    row: str
    column: str
    value: float


def values_of(text: str) -> list[Value]:
    """Return the numbers of all tables in the output of a benchmark, in their order."""
    return [value for heading, lines in _tables(text) for value in _values(heading, lines)]


def _tables(text: str) -> Iterator[tuple[str, list[str]]]:
    """Yield each table's lines with the heading above it."""
    heading, lines = "", list[str]()
    for line in [*text.splitlines(), ""]:
        line = line.strip()
        if line.startswith("|"):
            lines.append(line)
            continue
        if len(lines) > 2 and SEPARATOR.match(lines[1]):
            yield heading, lines
        lines = []
        if line.startswith("#"):
            heading = line.lstrip("# ")


def _values(heading: str, lines: list[str]) -> Iterator[Value]:
    columns = _cells(lines[0])
    seen: dict[str, int] = {}
    for line in lines[2:]:
        cells = dict(zip(columns, _cells(line), strict=False))
        numbers = {c: m for c, cell in cells.items() if c and (m := NUMBER.match(cell))}
        first = next(iter(numbers), "")
        name = ", ".join(cell for cell in takewhile(_is_text, cells.values()) if cell)
        if not name and first:  # the first number is what the row is for
            name = f"{first} {cells[first]}"
            del numbers[first]
        seen[name] = seen.get(name, 0) + 1
        row = name if seen[name] == 1 else f"{name} ({seen[name]})"
        for column, number in numbers.items():
            yield Value(heading, row, column, float(number.group().replace(",", "")))


def _is_text(cell: str) -> bool:
    return NUMBER.match(cell) is None


def _cells(line: str) -> list[str]:
    return [cell.strip().replace("**", "") for cell in line.strip().strip("|").split("|")]
