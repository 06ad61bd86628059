"""Change one place in the mission's core at random, and see its tests fail: mutation testing.

    python bench/mutation.py [--size N] [--seed N] [--jobs N] [--minutes N] [--out FILE] [--list]

Needs cosmic-ray (MIT): pip install -r requirements-bench.txt. It makes all mutants of the modules
of `CORE`; a random sample of them is tried, stratified by module in proportion to the mutants of
each, in random order. Code that cannot fail is left out before the sample is drawn: annotations
(never executed), and the decorators of kernels (which then run in plain Python, with the same
results).

Each mutant is tried in a copy of the package as a fault of `tools/faults.py` is: first against the
tests of its module (those that import it, or have its name), then against those of its subpackage,
the smallest first, until one fails. Outcomes are appended to FILE (default out/mutation.jsonl), one
line each; a run that was interrupted continues. A mutant whose tests pass or do not end within
`LIMITS_S` has survived, except that endless tests of its own module count as killed "by time". The
sample is tried in random order, so the first outcomes are a sample as well: 95 % of such intervals
(Wilson) hold the fraction that is killed of all. `--list` prints the table and the survivors alone.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import json
import math
import os
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

from faults import PACKAGE, FaultError, run_tests  # noqa: E402

CORE = (
    "cuboids/*.py",
    "planes/*.py",
    "baselines/*.py",
    "slam/wall*.py",
    "slam/walls/*.py",
    "slam/factors/*.py",
    "surfaces/**/*.py",
)
"""Modules of the mission's core."""

PLAIN = ("baselines/", "slam/walls/line_fit.py", "slam/walls/line_split.py")
"""Modules whose own tests run in plain Python, which is quicker than to compile."""

LIMITS_S = (600.0, 240.0)
"""For the tests of a mutant's module, and for those of its subpackage, s. Chosen: the first takes
compiling into account; without a mutant, tests take less than a tenth of both."""

Z_95 = 1.96
"""Quantile of the normal distribution for an interval of 95 %."""

SLOW = ("test_buildings.py", "test_changes_over_time.py")
"""Tests that take longer than all others of a subpackage: only for the modules they name."""

EXCLUDED = re.compile(r"@kernel|^\s*@(property|staticmethod|classmethod)")
"""Decorators that are left alone; without those of Python a module cannot be imported or used."""

KILLED, SURVIVED, TIME = "killed", "survived", "time"


class Mutant(NamedTuple):
    """A change of one place: an operator of cosmic-ray, and the number of its place."""

    module: str
    operator: str
    occurrence: int
    line: int

    @property
    def name(self) -> str:
        """Name in the file of outcomes."""
        return f"{self.module}:{self.operator}:{self.occurrence}"

    def apply(self, root: Path) -> None:
        """Change the module in a copy of the package."""
        path = root / PACKAGE / self.module
        path.write_text(self.changed(path.read_text(encoding="utf-8")), encoding="utf-8")

    def changed(self, source: str) -> str:
        """Return the source of the module with the mutant in it."""
        from cosmic_ray import plugins
        from cosmic_ray.mutating import mutate_code

        changed = mutate_code(source, plugins.get_operator(self.operator)(), self.occurrence)
        if changed is None:
            raise ValueError(f"{self.name}: no such place")
        return str(changed)

    def difference(self) -> list[str]:
        """Return the lines that differ, with + and -."""
        source = (ROOT / PACKAGE / self.module).read_text(encoding="utf-8")
        pair = source.splitlines(), self.changed(source).splitlines()
        lines = difflib.unified_diff(*pair, n=0, lineterm="")
        return [x.strip() for x in lines if x[0] in "+-" and x[:3] not in {"+++", "---"}]

    def outcome(self) -> str:
        """Run the tests of the module, then of its subpackage; return the outcome."""
        is_compiled = not self.module.startswith(PLAIN)
        for number, (tests, limit_s) in enumerate(zip(stages(self.module), LIMITS_S)):
            try:
                if not run_tests(tests, [self], jit=is_compiled, timeout_s=limit_s):
                    return KILLED
            except FaultError as error:
                if not isinstance(error.__cause__, TimeoutExpired):
                    return KILLED
                return TIME if number == 0 else SURVIVED
        return SURVIVED


def modules() -> list[str]:
    """Return the modules of the core, relative to the package."""
    package = ROOT / PACKAGE
    found = {path for pattern in CORE for path in package.glob(pattern)}
    return sorted(str(path.relative_to(package)) for path in found if path.name != "__init__.py")


def mutants_of(module: str) -> list[Mutant]:
    """Return all mutants of a module that can make a difference."""
    from cosmic_ray import plugins
    from cosmic_ray.ast import ast_nodes, get_ast

    source = (ROOT / PACKAGE / module).read_text(encoding="utf-8")
    nodes, skipped = list(ast_nodes(get_ast(source))), never_executed(source)
    found = []
    for operator_name in sorted(plugins.operator_names()):
        kind = plugins.get_operator(operator_name)
        if kind.arguments():  # operators that need arguments
            continue
        operator = kind()
        places = (at for node in nodes for at in operator.mutation_positions(node))
        for n, ((line, column), _) in enumerate(places):
            if not any(start <= (line, column) < end for start, end in skipped):
                found.append(Mutant(module, operator_name, n, line))
    return found


def never_executed(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return the first and last positions (line, column) of annotations and excluded decorators."""
    lines, places = source.splitlines(), []
    for node in ast.walk(ast.parse(source)):
        for part in ("annotation", "returns"):
            if (found := getattr(node, part, None)) is not None:
                places.append(
                    ((found.lineno, found.col_offset), (found.end_lineno, found.end_col_offset))
                )
        for found in getattr(node, "decorator_list", []):
            if EXCLUDED.search(lines[found.lineno - 1]):
                places.append(((found.lineno, 0), (found.end_lineno + 1, 0)))
    return places


def sample(size: int, seed: int) -> list[Mutant]:
    """Return a random sample of all mutants, in proportion by module and at least one of each."""
    strata = [found for module in modules() if (found := mutants_of(module))]
    total = sum(len(found) for found in strata)
    fractions = [max(1.0, size * len(found) / total) for found in strata]
    counts = [int(fraction) for fraction in fractions]
    by_rest = sorted(range(len(strata)), key=lambda i: counts[i] - fractions[i])
    for i in by_rest[: max(0, size - sum(counts))]:
        counts[i] += 1
    draw = random.Random(seed)
    chosen = [m for n, found in zip(counts, strata, strict=True) for m in draw.sample(found, n)]
    draw.shuffle(chosen)
    return chosen


def stages(module: str) -> list[list[str]]:
    """Return the tests of a module, then the others of its subpackage, the smallest first."""
    subpackage, tests = module.split("/")[0], ROOT / "test"
    files = sorted((tests / subpackage).rglob("test_*.py"), key=lambda f: f.stat().st_size)
    near = [
        file
        for file in files
        if module in imported(file)
        or module == str(file.relative_to(tests).with_name(file.name.removeprefix("test_")))
    ]
    rest = [file for file in files if file not in near and file.name not in SLOW]
    return [[str(file.relative_to(ROOT)) for file in part] for part in (near, rest) if part]


@cache
def imported(path: Path) -> set[str]:
    """Return the modules of the package that a file imports, relative to the package."""
    found = re.findall(rf"^\s*from {PACKAGE}\.([\w.]+) import (.*)", path.read_text(), re.MULTILINE)
    dotted = {name for name, _ in found}
    dotted |= {f"{name}.{part.strip()}" for name, parts in found for part in parts.split(",")}
    return {f"{name.replace('.', '/')}.py" for name in dotted}


def run(todo: Sequence[Mutant], out: Path, jobs: int, minutes: float) -> None:
    """Try mutants for so many minutes; append the outcome of each to a file."""
    end_s = time.monotonic() + 60.0 * minutes

    def outcome(mutant: Mutant) -> tuple[Mutant, str]:
        return mutant, mutant.outcome() if time.monotonic() < end_s else ""

    with ThreadPoolExecutor(jobs) as pool, out.open("a", encoding="utf-8") as file:
        for mutant, found in pool.map(outcome, todo):
            if found:
                entry = {"mutant": mutant.name, "module": mutant.module, "line": mutant.line}
                entry |= {"outcome": found, "diff": mutant.difference()}
                print(f"{found:8}  {mutant.name}", flush=True)
                print(json.dumps(entry), file=file, flush=True)


def wilson_interval(hits: int, tried: int) -> tuple[float, float]:
    """Return the interval of 95 % for the fraction of which `hits` of `tried` are a sample."""
    if tried == 0:
        return 0.0, 1.0
    fraction, z2 = hits / tried, Z_95**2 / tried
    middle = (fraction + 0.5 * z2) / (1.0 + z2)
    half = Z_95 * math.sqrt(fraction * (1.0 - fraction) / tried + 0.25 * z2 / tried) / (1.0 + z2)
    return middle - half, middle + half


def table(entries: Sequence[dict[str, Any]], size: int) -> Iterator[str]:
    """Yield the lines of the table, and then each survivor."""
    yield "| module | tried | killed | survived |"
    yield "|---|---|---|---|"
    count = Counter((entry["module"], entry["outcome"] == SURVIVED) for entry in entries)
    for module in sorted({entry["module"] for entry in entries}):
        dead, alive = count[module, False], count[module, True]
        yield f"| {module} | {dead + alive} | {dead} | {alive} |"
    alive = [entry for entry in entries if entry["outcome"] == SURVIVED]
    slow, n = sum(entry["outcome"] == TIME for entry in entries), len(entries)
    killed = n - len(alive)
    low, high = wilson_interval(killed, n)
    yield (
        f"\n{n} of {size} tried, {killed} killed ({100.0 * killed / max(n, 1):.0f} %, of all "
        f"{100.0 * low:.0f} to {100.0 * high:.0f} %), {slow} by time"
    )
    for entry in alive:
        yield f"\n{entry['module']}:{entry['line']}  {entry['mutant'].split(':')[1]}"
        yield from (f"    {line}" for line in entry["diff"])


def main() -> int:
    """Run the sample, or as much of it as there is time for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--size", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutation.jsonl")
    parser.add_argument("--list", action="store_true", help="print known outcomes, try nothing")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.touch()
    if not options.list:
        known = {json.loads(line)["mutant"] for line in options.out.read_text().splitlines()}
        todo = [m for m in sample(options.size, options.seed) if m.name not in known]
        run(todo, options.out, options.jobs, options.minutes)
    entries = [json.loads(line) for line in options.out.read_text().splitlines()]
    print("\n".join(table(entries, options.size)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
