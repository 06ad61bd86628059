"""Put faults into a copy of the package, one at a time, and see the tests named for them fail.

Usage: python tools/faults.py [WORD ...] [--jobs N]

tools/faults.toml lists the faults. Each has a name, the edits that make it (a function by name, an
expression or statement in it, and its form with the fault) and the tests that must fail. Given
words, only the faults are run whose names contain one of them. The last line is ``N killed, M
survived``, and exit status 0 says that all were killed.

A fault is killed where a test ran and failed. Where that cannot be said it is an ERROR, which is
neither: its piece is not in the code, the code with it cannot be compiled or imported, no test was
found or could be set up, or they did not end in time. The last line then counts those as ``not
tried``, and the exit status is 2. The tests must pass without any fault; that is tried first.

Compiled kernels are found by what is in them (`tccm_ros/kernel_cache.py`), so that what a fault
does not concern is not compiled again. Where the tests of a fault are quicker in plain Python than
the compiler is, the fault says ``jit = false`` and they run with ``NUMBA_DISABLE_JIT=1``. As many
faults are tried at once as there are processors, or as many as ``--jobs`` says.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import xml.etree.ElementTree as xml
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "tools" / "faults.toml"
PACKAGE = "tccm_ros"

TIMEOUT_S = 600
"""What the tests of one fault may take, s."""

PASSED, FAILED = 0, 1
"""Exit statuses of pytest; all others mean that tests could not be run."""

NOT_CODE = re.compile(
    r"(\w+\.)*(ImportError|ModuleNotFoundError|NameError|SyntaxError|IndentationError|TypingError)\b"
)
"""How the failure of a test begins that says of a fault only that its text is no code; the last
is numba's."""

KILLED, SURVIVED, ERROR = "killed", "SURVIVED", "ERROR"
"""What may become of a fault."""

NOT_TRIED = 2
"""Exit status where a fault could not be tried."""


class FaultError(Exception):
    """A fault that cannot be tried."""


@dataclass(frozen=True)
class Edit:
    """A piece of a function, and what it is with the fault.

    Attributes
    ----------
    place
        Qualified name of a function, method, class or constant of the package; after ``module:``
        where several have that name.
    old
        An expression or statements in it, compared as syntax trees: formatting does not count.
    new
        What stands there with the fault.
    needs
        Imports that `new` needs.
    """

    place: str
    old: str
    new: str
    needs: tuple[str, ...] = ()

    def apply(self, root: Path) -> Path:
        """Make the edit in a copy of the package and return the file that it changed.

        Raises
        ------
        FaultError
            Where place or piece is not there exactly once, or the file is no Python after that.
        """
        path, place = self._find_place(root / PACKAGE)
        first, last = self._find_piece(place)
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        begin = _position(lines, first.lineno, first.col_offset)
        end = _position(lines, last.end_lineno, last.end_col_offset)
        source = "".join(lines)
        indent = "\n" + " " * first.col_offset
        new = self.new.replace("\n", indent) if isinstance(first, ast.stmt) else f"({self.new})"
        changed = source[:begin] + new + source[end:]
        head = "from __future__ import annotations\n"
        changed = changed.replace(head, head + "".join(f"{line}\n" for line in self.needs), 1)
        try:
            compile(changed, path.name, "exec")
        except SyntaxError as error:
            raise FaultError(f"{self.place}: no Python with the fault: {error}") from error
        path.write_text(changed, encoding="utf-8")
        return path

    def _find_place(self, package: Path) -> tuple[Path, ast.AST]:
        module, _, name = self.place.rpartition(":")
        files = package.rglob(f"{module or '*'}.py")
        # A file without the last name has no definition of it: most need not be parsed.
        last = name.rpartition(".")[2]
        sources = ((f, f.read_text(encoding="utf-8")) for f in sorted(files))
        found = [
            (file, node)
            for file, source in sources
            if last in source
            for known, node in definitions(_tree(source))
            if known == name
        ]
        if len(found) != 1:
            raise FaultError(f"{self.place}: found {len(found)} times, expected once")
        return found[0]

    def _find_piece(self, place: ast.AST) -> tuple[Any, Any]:
        try:
            sought = ast.parse(self.old).body
        except SyntaxError as error:
            raise FaultError(f"{self.place}: no Python: {self.old!r}") from error
        found: list[tuple[Any, Any]] = []
        if len(sought) == 1 and isinstance(sought[0], ast.Expr) and _is_expression(self.new):
            tree = ast.dump(sought[0].value)
            found += [(n, n) for n in _expressions(place) if ast.dump(n) == tree]
        if not found:
            trees = [ast.dump(node) for node in sought]
            for body in _bodies(place):
                for k in range(len(body) - len(trees) + 1):
                    piece = body[k : k + len(trees)]
                    if [ast.dump(node) for node in piece] == trees:
                        found.append((piece[0], piece[-1]))
        if len(found) != 1:
            raise FaultError(f"{self.place}: found {len(found)} times, expected once: {self.old!r}")
        return found[0]


@dataclass(frozen=True)
class Setting:
    """A parameter of a configuration file, and its value with the fault."""

    file: str
    name: str
    value: Any

    def apply(self, root: Path) -> Path:
        """Change the file in a copy of the repository and return it; `FaultError` if not there."""
        path = root / self.file
        tree = yaml.safe_load(path.read_text(encoding="utf-8"))
        group, _, name = self.name.rpartition(".")
        parameters = tree["/**"]["ros__parameters"].get(group, {})
        if name not in parameters:
            raise FaultError(f"{self.file}: no {self.name}")
        parameters[name] = self.value
        path.write_text(yaml.safe_dump(tree), encoding="utf-8")
        return path


@cache
def _tree(source: str) -> ast.Module:
    return ast.parse(source)


def definitions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Yield the functions, classes and constants of a module with their qualified names."""
    for node in getattr(tree, "body", ()):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield prefix + node.name, node
            yield from definitions(node, f"{prefix}{node.name}.")
        elif isinstance(node, ast.Assign) and not isinstance(tree, ast.FunctionDef):
            yield from ((prefix + t.id, node) for t in node.targets if isinstance(t, ast.Name))


def _is_expression(source: str) -> bool:
    try:
        ast.parse(source, mode="eval")
    except SyntaxError:
        return False
    return True


def _expressions(place: ast.AST) -> Iterator[ast.expr]:
    return (node for node in ast.walk(place) if isinstance(node, ast.expr))


def _bodies(place: ast.AST) -> Iterator[list[ast.stmt]]:
    for node in ast.walk(place):
        for name in ("body", "orelse", "finalbody"):
            if isinstance(body := getattr(node, name, None), list):
                yield body


def _position(lines: Sequence[str], line: int, column: int) -> int:
    """Return where a position of the syntax tree (its columns are bytes) is in the text."""
    before = sum(map(len, lines[: line - 1]))
    return before + len(lines[line - 1].encode()[:column].decode())


@dataclass(frozen=True)
class Fault:
    """A fault, and the tests that fail with it.

    Attributes
    ----------
    name
        What is wrong then.
    edits
        The changes that make it.
    tests
        As pytest takes them, relative to the repository.
    jit
        Whether kernels are compiled for these tests.
    """

    name: str
    edits: tuple[Edit | Setting, ...]
    tests: tuple[str, ...]
    jit: bool = True


def read_faults(path: Path = LIST) -> list[Fault]:
    """Return the faults of the list, in its order."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return [
        Fault(
            entry["name"],
            tuple(
                Edit(edit["in"], edit["old"], edit["new"], tuple(edit.get("needs", ())))
                for edit in entry.get("edit", ())
            )
            + tuple(Setting(**setting) for setting in entry.get("setting", ())),
            tuple(entry["tests"]),
            entry.get("jit", True),
        )
        for entry in table["fault"]
    ]


@contextmanager
def changed_copy(change: Callable[[Path], None]) -> Iterator[Path]:
    """Yield a folder like the repository, with a copy of the package that has a change in it."""
    with tempfile.TemporaryDirectory(prefix="tccm-fault-") as name:
        copy = Path(name)
        copied = {PACKAGE, "config", "test"}  # tests find files of config/ beside their own folder
        for entry in ROOT.iterdir():
            if entry.name not in copied:
                (copy / entry.name).symlink_to(entry)
            elif entry.is_dir():
                shutil.copytree(entry, copy / entry.name)
        change(copy)
        yield copy


def run_tests(
    tests: Sequence[str],
    edits: Sequence[Edit | Setting] = (),
    *,
    jit: bool = True,
    timeout_s: float = TIMEOUT_S,
) -> bool:
    """Run tests on a copy with edits, for `timeout_s` at most; return whether they pass.

    Raises
    ------
    FaultError
        Where they cannot be run, do not end, or fail by what is no failure of a test.
    """

    def change(root: Path) -> None:
        for edit in edits:
            edit.apply(root)

    with changed_copy(change) as copy:
        report = copy / "report.xml"
        environment = {
            **os.environ,
            "PYTHONPATH": str(copy),
            "NUMBA_DISABLE_JIT": str(int(not jit)),
        }
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
        command += [f"--junit-xml={report}", *tests]
        try:
            done = subprocess.run(
                command,
                cwd=copy,
                env=environment,
                timeout=timeout_s,
                capture_output=True,
                text=True,
            )
        except subprocess.TimeoutExpired as error:
            raise FaultError(f"no end within {timeout_s} s: {' '.join(tests)}") from error
        if done.returncode not in {PASSED, FAILED}:
            raise FaultError(f"tests cannot be run: {' '.join(tests)}\n{done.stdout[-2000:]}")
        if done.returncode == FAILED:
            _check_failure(report)
    return done.returncode == PASSED


def _check_failure(report: Path) -> None:
    """Raise a `FaultError` unless a test of a JUnit report ran and failed."""
    root = xml.parse(report).getroot()
    for error in root.iter("error"):
        raise FaultError(f"a test cannot be set up: {error.get('message', '')}")
    failures = [failure.get("message", "") for failure in root.iter("failure")]
    if not failures:
        raise FaultError("pytest failed, and no test did")
    for message in failures:
        if NOT_CODE.match(message):
            raise FaultError(f"no failure of a test: {message.splitlines()[0]}")


def outcome(fault: Fault) -> str:
    """Run the tests of a fault on a copy that has it; return what became of it, and say so."""
    reason = ""
    try:
        found = SURVIVED if run_tests(fault.tests, fault.edits, jit=fault.jit) else KILLED
    except FaultError as error:
        found, reason = ERROR, f": {error}"
    print(f"{found:8}  {fault.name}{reason}", flush=True)
    return found


def check_without_faults(faults: Sequence[Fault]) -> None:
    """Raise a `FaultError` where tests of the faults do not pass as the package is."""
    for jit in (True, False):
        tests = sorted({test for fault in faults for test in fault.tests if fault.jit is jit})
        if tests and not run_tests(tests, jit=jit, timeout_s=TIMEOUT_S * len(tests)):
            raise FaultError(f"tests fail without any fault: {' '.join(tests)}")


def run(faults: Sequence[Fault], jobs: int) -> int:
    """Try faults, print what became of them, and return the exit status."""
    try:
        if not faults:
            raise FaultError("no fault has such a name")
        check_without_faults(faults)
    except FaultError as error:
        print(f"{ERROR:8}  {error}")
        return NOT_TRIED
    with ThreadPoolExecutor(jobs) as pool:
        count = Counter(pool.map(outcome, faults))
    not_tried = f", {count[ERROR]} not tried" if count[ERROR] else ""
    print(f"{count[KILLED]} killed, {count[SURVIVED]} survived{not_tried}")
    return NOT_TRIED if count[ERROR] else int(count[SURVIVED] > 0)


def main() -> int:
    """Run the faults; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("words", nargs="*", help="run faults whose names contain one of these")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="faults tried at once")
    options = parser.parse_args()
    words = options.words
    faults = [f for f in read_faults() if not words or any(word in f.name for word in words)]
    return run(faults, options.jobs)


if __name__ == "__main__":
    sys.exit(main())
