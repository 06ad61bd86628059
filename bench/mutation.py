"""Change one place in the mission's core at random, and see its tests fail: mutation testing.

Usage: python bench/mutation.py [--size N] [--seed N] [--jobs N] [--minutes N] [--out FILE]
       python bench/mutation.py --check | --list [--out FILE]

Needs cosmic-ray (MIT): pip install -r requirements-bench.txt. It makes all mutants of the modules
of `CORE`; a random sample of them is tried, stratified by module in proportion to the mutants of
each, in random order. What cannot fail is left out before the sample is drawn: annotations (never
executed), and the decorators of kernels (which then run in plain Python, with the same results).

Each mutant is tried in a copy of the package, first against the tests of its module (those that
import it, or have its name), then against those of its room, those first that import what imports
it, until one fails. Kernels are compiled where the mutant is in them, as on a robot: those of the
cuboids use pointers and the processor's own instructions and do not run with NUMBA_DISABLE_JIT=1,
and searches in plain Python take minutes. Modules of `PLAIN` are the exception.

Outcomes are appended to FILE (default out/mutation.jsonl), one line each; a run that was broken off
goes on where it ended. Tests are given `LIMITS_S`: a mutant that none has killed by then has
survived. Only one that keeps the tests of its module from ending, which take less than a tenth of
the limit without it, counts as killed; how many is said. As the sample is tried in random order,
the first outcomes are a sample as well: 95 % of such intervals (Wilson) hold the fraction that is
killed of all. The table and the survivors are printed; `--list` prints them alone. `--check` tries
each module unchanged: all must survive.
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
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

from faults import PACKAGE, changed_copy  # noqa: E402

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

LIMITS_S = (120.0, 40.0)
"""For the tests of a mutant's module, and for those of its room, s of a processor. Chosen: the
first takes compiling into account, the second is what most rooms need."""

ENDLESS = 10.0
"""Tests that take this many times as long as without a mutant would not end."""

Z_95 = 1.96
"""Quantile of the normal distribution for an interval of 95 %."""

SLOW = ("test_buildings.py", "test_changes_over_time.py")
"""Tests of rooms that take longer than all others together: only for the modules they name."""

EXCLUDED = re.compile(r"@kernel|^\s*@(property|staticmethod|classmethod)")
"""Decorators that are left alone; without those of Python a module cannot be imported or used."""

UNCHANGED = "unchanged"
"""The operator that does nothing."""

KILLED, SURVIVED, TIME = "killed", "survived", "time"


class Mutant(NamedTuple):
    """A change of one place: which operator of cosmic-ray, and its how manieth place."""

    module: str
    operator: str
    occurrence: int
    line: int

    @property
    def name(self) -> str:
        """What it is called in the file of outcomes."""
        return f"{self.module}:{self.operator}:{self.occurrence}"


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
        if kind.arguments():  # operators that have to be told what to look for
            continue
        operator = kind()
        places = (at for node in nodes for at in operator.mutation_positions(node))
        for n, ((line, column), _) in enumerate(places):
            if not any(start <= (line, column) < end for start, end in skipped):
                found.append(Mutant(module, operator_name, n, line))
    return found


def never_executed(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return from where to where, line and column, annotations and excluded decorators are."""
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


def mutate(mutant: Mutant, source: str) -> str:
    """Return the source of a module with the mutant in it."""
    from cosmic_ray import plugins
    from cosmic_ray.mutating import mutate_code

    if mutant.operator == UNCHANGED:
        return source
    operator = plugins.get_operator(mutant.operator)()
    changed = mutate_code(source, operator, mutant.occurrence)
    if changed is None:
        raise ValueError(f"{mutant.name}: no such place")
    return str(changed)


def _tested(test: Path) -> str:
    """Return the module that bears the name of a test, both relative to their folders."""
    return str(test.with_name(test.name.removeprefix("test_")))


def stages(module: str) -> list[list[str]]:
    """Return the tests of a module, then those of its room: nearest first, of these the smallest.

    Tests of a module name it. Next come those that name a module which imports it, and so on.
    """
    room = module.split("/")[0]
    tests = ROOT / "test"
    files = sorted((tests / room).rglob("test_*.py"), key=lambda f: f.stat().st_size)
    names = {file: _imported(file) | {_tested(file.relative_to(tests))} for file in files}
    importers = {m: _imported(ROOT / PACKAGE / m) for m in modules() if m.startswith(f"{room}/")}
    known, order, left = {module}, [], [f for f in files if f.name not in SLOW]
    near = [file for file in files if module in names[file]]
    while left:
        found = [file for file in left if names[file] & known]
        wider = known | {m for m, imported in importers.items() if imported & known}
        if not found and wider == known:
            found = left
        order += found
        known, left = wider, [file for file in left if file not in found]
    rest = [file for file in order if file not in near]
    return [[str(file.relative_to(ROOT)) for file in part] for part in (near, rest) if part]


@cache
def _imported(path: Path) -> set[str]:
    """Return the modules of the package that a file imports, relative to the package."""
    found = re.findall(rf"^\s*from {PACKAGE}\.([\w.]+) import (.*)", path.read_text(), re.MULTILINE)
    dotted = {name for name, _ in found}
    dotted |= {f"{name}.{part.strip()}" for name, parts in found for part in parts.split(",")}
    return {f"{name.replace('.', '/')}.py" for name in dotted}


class Trial:
    """A mutant in its copy, and the process that runs its tests."""

    def __init__(self, mutant: Mutant):
        self.mutant = mutant
        self._stages = stages(mutant.module)
        self._limits_s = list(LIMITS_S)
        self._stack = ExitStack()
        self._copy = self._stack.enter_context(changed_copy(self._change))
        self.diff = self._difference()
        self._start_s = time.monotonic()
        self._next()

    def _change(self, root: Path) -> None:
        path = root / PACKAGE / self.mutant.module
        path.write_text(mutate(self.mutant, path.read_text(encoding="utf-8")), encoding="utf-8")

    def _difference(self) -> list[str]:
        old, new = (
            (root / PACKAGE / self.mutant.module).read_text(encoding="utf-8").splitlines()
            for root in (ROOT, self._copy)
        )
        lines = difflib.unified_diff(old, new, n=0, lineterm="")
        return [x.strip() for x in lines if x[0] in "+-" and x[:3] not in {"+++", "---"}]

    def _next(self) -> None:
        tests = self._stages.pop(0)
        self._limit_s = self._limits_s.pop(0)
        is_plain = self.mutant.module.startswith(PLAIN)
        self._pid = os.fork()
        if self._pid == 0:
            run_tests(self._copy, tests, jit=not is_plain)

    def outcome(self) -> str | None:
        """Return what became of the mutant, or None while its tests run."""
        pid, status = os.waitpid(self._pid, os.WNOHANG)
        if pid == 0:
            if _cpu_seconds(self._pid) <= self._limit_s:
                return None
            self.stop()
            return self._late()
        if os.waitstatus_to_exitcode(status) == 0:
            if self._stages:
                self._next()
                return None
            return SURVIVED
        return KILLED

    def _late(self) -> str:
        """Return what became of a mutant whose tests have not ended in time."""
        is_of_the_module = len(self._limits_s) == len(LIMITS_S) - 1
        if is_of_the_module and ENDLESS * seconds_unchanged(self.mutant.module) < self._limit_s:
            return TIME
        return SURVIVED

    def stop(self) -> None:
        """End the tests."""
        os.killpg(self._pid, signal.SIGKILL)
        os.waitpid(self._pid, 0)

    def close(self) -> float:
        """Remove the copy; return how long it took, s."""
        self._stack.close()
        return time.monotonic() - self._start_s


@cache
def seconds_unchanged(module: str) -> float:
    """Return what the tests of a module take without a mutant, s of a processor."""
    with changed_copy(lambda root: None) as copy:
        pid = os.fork()
        if pid == 0:
            run_tests(copy, stages(module)[0], jit=not module.startswith(PLAIN))
        usage = os.wait4(pid, 0)[2]
    return float(usage.ru_utime + usage.ru_stime)


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def preload() -> None:
    """Import what all tests import, so that a process that is forked has it already."""
    import gtsam  # noqa: F401
    import hypothesis  # noqa: F401
    import matplotlib.pyplot  # noqa: F401
    import numba.core.caching  # noqa: F401
    import numpy.testing  # noqa: F401
    import pydantic  # noqa: F401
    import pytest  # noqa: F401
    import scipy.ndimage
    import scipy.optimize
    import scipy.spatial  # noqa: F401
    import shapely.ops  # noqa: F401


def run_tests(copy: Path, tests: Sequence[str], *, jit: bool) -> None:
    """Run tests in this process, which ends with the status of pytest."""
    import numba
    import pytest

    os.setpgrp()  # not a session of its own, which would have a priority of its own
    os.chdir(copy)
    with open(os.devnull, "w") as nothing:
        for stream in (1, 2):
            os.dup2(nothing.fileno(), stream)
    os.environ["PYTHONPATH"] = str(copy)
    sys.path[:] = [str(copy), *(p for p in sys.path if Path(p or ".").resolve() != ROOT)]
    numba.config.DISABLE_JIT = int(not jit)
    os._exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *tests])))


def run(todo: Sequence[Mutant], out: Path, jobs: int, end_s: float) -> None:
    """Try mutants, some at a time, until `end_s`; append what became of each to a file."""
    waiting, running = list(todo), []
    with out.open("a", encoding="utf-8") as file:
        while running or (waiting and time.monotonic() < end_s):
            while waiting and len(running) < jobs and time.monotonic() < end_s:
                running.append(Trial(waiting.pop(0)))
            for trial in list(running):
                if (outcome := trial.outcome()) is None:
                    continue
                running.remove(trial)
                entry = {
                    "mutant": trial.mutant.name,
                    "module": trial.mutant.module,
                    "line": trial.mutant.line,
                    "outcome": outcome,
                    "diff": trial.diff,
                    "seconds": round(trial.close(), 1),
                }
                print(f"{outcome:8}  {trial.mutant.name}", flush=True)
                file.write(json.dumps(entry) + "\n")
                file.flush()
            time.sleep(0.2)


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
    parser.add_argument("--check", action="store_true", help="try each module unchanged")
    parser.add_argument("--list", action="store_true", help="print what is known, try nothing")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.touch()
    if not options.list:
        if options.check:
            chosen = [Mutant(module, UNCHANGED, 0, 0) for module in modules()]
        else:
            chosen = sample(options.size, options.seed)
        known = {json.loads(line)["mutant"] for line in options.out.read_text().splitlines()}
        preload()
        todo = [mutant for mutant in chosen if mutant.name not in known]
        run(todo, options.out, options.jobs, time.monotonic() + 60.0 * options.minutes)
    entries = [json.loads(line) for line in options.out.read_text().splitlines()]
    entries = [e for e in entries if (UNCHANGED in e["mutant"]) == options.check]
    print("\n".join(table(entries, options.size)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
