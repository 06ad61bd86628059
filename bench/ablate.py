"""Effect of constants of the package on the maps of recordings: change one, replay, score.

    python bench/ablate.py BAG ... --set NAME[=VALUE] ... [--out TABLE.md]

BAG is a recording with truth.json. NAME is a constant with its module, as
`planes.front_tops.ABOVE`, or a module or subpackage for all its numeric constants. Without VALUE
a constant is halved and doubled. A row has for each recording the mean overlap with the true
surfaces, true surfaces found, false ones and objects, or "same" if the map is the same, byte by
byte. The first row is that of the package as it is.

Each trial is a process of its own, as kernels that use a constant are compiled anew. Values that
are computed from a constant at import, and defaults of arguments, keep their values.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

import tccm_ros
from tccm_ros.config import Config
from tccm_ros.evaluate.surfaces import score_surfaces
from tccm_ros.replay.replay import replay

PACKAGE = Path(tccm_ros.__file__).parent

FILES = ("surfaces.json", "objects.json")
"""Files that are the same where a constant has no effect."""

FACTORS = (0.5, 2.0)
"""Factors on a constant without a value."""


class Change(NamedTuple):
    """A constant and its value in a trial; no module for the package as it is."""

    module: str
    name: str
    value: Any


class Score(NamedTuple):
    """Figures of a map, and its files."""

    text: str
    files: tuple[bytes, ...]


def constants(prefix: str) -> Iterator[tuple[str, str, Any]]:
    """Yield module, name and value of numeric constants whose dotted names begin with `prefix`."""
    for path in sorted(PACKAGE.rglob("*.py")):
        module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        if not (f"{module}.".startswith(f"{prefix}.") or prefix.startswith(f"{module}.")):
            continue
        for node in ast.parse(path.read_text()).body:
            targets = node.targets if isinstance(node, ast.Assign) else []
            names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            for name in filter(str.isupper, names):
                value = getattr(importlib.import_module(f"tccm_ros.{module}"), name)
                is_numeric = isinstance(value, int | float | tuple) and not isinstance(value, bool)
                is_record = hasattr(value, "_fields")
                if is_numeric and not is_record and f"{module}.{name}.".startswith(f"{prefix}."):
                    yield f"tccm_ros.{module}", name, value


def changes_of(word: str) -> list[Change]:
    """Return the trials of an argument NAME[=VALUE]; ValueError if nothing has the name."""
    prefix, _, value = word.partition("=")
    found = list(constants(prefix))
    if not found:
        raise ValueError(f"no constant {prefix}")
    if value:
        return [Change(module, name, ast.literal_eval(value)) for module, name, _ in found]
    return [Change(m, name, scaled(v, f)) for m, name, v in found for f in FACTORS]


def scaled(value: Any, factor: float) -> Any:
    """Return a constant times a factor; integers stay integers."""
    if isinstance(value, tuple):
        return tuple(scaled(v, factor) for v in value)
    if isinstance(value, str):
        return value
    return round(value * factor) if isinstance(value, int) else value * factor


def set_constant(module: str, name: str, value: Any) -> None:
    """Give a constant another value, in its module and in those that import it from there."""
    for key, other in list(sys.modules.items()):
        if key == module or (key.startswith("tccm_ros") and imports(other, module, name)):
            setattr(other, name, value)


def imports(other: ModuleType, module: str, name: str) -> bool:
    """Return whether a module imports a name from another one."""
    if other.__file__ is None or not hasattr(other, name):
        return False
    return any(
        isinstance(node, ast.ImportFrom)
        and node.module == module
        and name in {alias.name for alias in node.names}
        for node in ast.parse(Path(other.__file__).read_text()).body
    )


def score(bag: Path, change: Change) -> Score:
    """Replay a recording with a change, and return the score of its map."""
    if change.module:
        set_constant(*change)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "map"
        replay(bag, out, Config(), pictures=False)
        found = score_surfaces(out / "surfaces.json", bag / "truth.json")
        files = tuple((out / name).read_bytes() for name in FILES)
    overlap = np.mean([match.overlap for match in found.matches])
    objects = len(json.loads(files[1])["objects"])
    return Score(f"{overlap:.4f} {found.found} {len(found.false)} {objects}", files)


def tried(bag: Path, change: Change) -> Score:
    """Score a recording in a new process; an error is the result of a trial as well."""
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(1, context) as pool:
        try:
            return pool.submit(score, bag, change).result()
        except Exception as error:
            return Score(type(error).__name__, ())


def rows(bags: Sequence[Path], changes: Sequence[Change]) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| constant | value | " + " | ".join(bag.name for bag in bags) + " |"
    yield "|---" * (2 + len(bags)) + "|"
    before = [tried(bag, Change("", "", None)) for bag in bags]
    yield "| none | | " + " | ".join(one.text for one in before) + " |"
    for change in changes:
        after = [tried(bag, change) for bag in bags]
        cells = ["same" if a.files == b.files else a.text for a, b in zip(after, before)]
        name = f"{change.module.removeprefix('tccm_ros.')}.{change.name}"
        yield f"| {name} | {change.value} | " + " | ".join(cells) + " |"


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG")
    parser.add_argument("--set", nargs="+", required=True, metavar="NAME[=VALUE]", dest="names")
    parser.add_argument("--out", type=Path, help="file for the table as well")
    arguments = parser.parse_args()
    changes = [change for word in arguments.names for change in changes_of(word)]
    for row in rows(arguments.bags, changes):
        print(row, flush=True)
        if arguments.out:
            with arguments.out.open("a") as file:
                file.write(row + "\n")


if __name__ == "__main__":
    main()
