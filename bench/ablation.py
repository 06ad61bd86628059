"""Trials of constants and rules of the package, each in a process of its own."""

from __future__ import annotations

import ast
import importlib
import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import tccm_ros

Change = tuple[str, str, str]
"""Module, name, and factor of a constant; ``off`` for a rule."""


def constants(folders: Sequence[str]) -> Iterator[tuple[str, str, Any]]:
    """Yield module, name and value of each numeric constant of some subpackages."""
    root = Path(tccm_ros.__file__).parent
    for folder in folders:
        for path in sorted((root / folder).rglob("*.py")):
            module = ".".join(("tccm_ros", *path.relative_to(root).with_suffix("").parts))
            for node in ast.parse(path.read_text()).body:
                if isinstance(node, ast.Assign):
                    for name in ast.walk(node.targets[0]):
                        if isinstance(name, ast.Name) and name.id.isupper():
                            value = getattr(importlib.import_module(module), name.id)
                            if isinstance(value, int | float | tuple) and not isinstance(
                                value, bool
                            ):
                                yield module, name.id, value


def set_everywhere(name: str, old: Any, new: Any) -> None:
    """Give a function of the package another value in all modules that have it."""
    for key, module in list(sys.modules.items()):
        if key.startswith("tccm_ros") and getattr(module, name, None) is old:
            setattr(module, name, new)


def set_constant(module: str, name: str, new: Any) -> None:
    """Give a constant another value, in its module and in those that import it from there."""
    for key, other in list(sys.modules.items()):
        if key == module or (key.startswith("tccm_ros") and _imports(other, module, name)):
            setattr(other, name, new)


def _imports(other: ModuleType, module: str, name: str) -> bool:
    """Return whether a module imports a name from another one."""
    if other.__file__ is None or not hasattr(other, name):
        return False
    return any(
        isinstance(node, ast.ImportFrom)
        and node.module == module
        and name in {alias.name for alias in node.names}
        for node in ast.parse(Path(other.__file__).read_text()).body
    )


def scaled(value: Any, factor: float) -> Any:
    """Return a constant times a factor; integers stay integers."""
    if isinstance(value, tuple):
        return tuple(scaled(v, factor) for v in value)
    if isinstance(value, int):
        return round(value * factor)
    return value * factor


def in_process(apply: Callable[[], None], score: Callable[[Any], Any], saved: Sequence[Any]) -> Any:
    """Apply a change in a forked process; return the scores of recordings, or names of errors."""
    context = multiprocessing.get_context("fork")
    results = context.Queue()

    def trial() -> None:
        apply()
        for recording in saved:
            try:
                results.put(score(recording))
            except Exception as error:  # a trial may break what it tries
                results.put(type(error).__name__)
        results.put(None)

    process = context.Process(target=trial)
    process.start()
    rows = list(iter(results.get, None))
    process.join()
    return rows


def row_of(change: Change, cells: Sequence[str]) -> str:
    """Return a row of the table."""
    return " | ".join(("| " + change[0].removeprefix("tccm_ros."), *change[1:], *cells)) + " |"


def is_done(change: Change, table: Path) -> bool:
    """Return whether a table has the row of a change."""
    start = row_of(change, ()).removesuffix(" |")
    return any(line.startswith(start + " | ") for line in table.read_text().splitlines())


def add_row(change: Change, cells: Sequence[str], table: Path) -> None:
    """Print a row, and append it to a table."""
    row = row_of(change, cells)
    with table.open("a") as file:
        file.write(row + "\n")
    print(row, flush=True)
