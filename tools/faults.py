"""Put faults into a copy of the package, one at a time, and see the tests named for them fail.

Usage: python tools/faults.py [WORD ...] [--jobs N]

tools/faults.toml lists the faults. Each has a name, the edits that make it (file, text as it is,
text with the fault) and the tests that must fail. Given words, only the faults are run whose names
contain one of them. The last line is ``N killed, M survived``; exit status 0 if none survived.

The tests must pass without any fault; that is tried first. A fault counts as killed where a test
fails, not where the tests cannot be collected.

Compiled kernels are found by what is in them (`tccm_ros/kernel_cache.py`), so that what a fault
does not concern is not compiled again. Where the tests of a fault are quicker in plain Python than
the compiler is, the fault says ``jit = false`` and they run with ``NUMBA_DISABLE_JIT=1``. As many
faults are tried at once as there are processors, or as many as ``--jobs`` says.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "tools" / "faults.toml"
PACKAGE = "tccm_ros"

TIMEOUT = 600
"""Seconds that the tests of one fault may take."""

PASSED, FAILED = 0, 1
"""Exit statuses of pytest; all others mean that tests could not be run."""


class FaultError(Exception):
    """A fault that does not apply, or tests that cannot be run."""


@dataclass(frozen=True)
class Edit:
    """A text in a file of the package, and what stands there with the fault."""

    file: str
    old: str
    new: str

    def apply(self, root: Path) -> None:
        """Make the edit in a copy of the package.

        Raises
        ------
        FaultError
            Where the text is not in the file exactly once.
        """
        path = root / self.file
        source = path.read_text(encoding="utf-8")
        if (count := source.count(self.old)) != 1:
            raise FaultError(f"{self.file}: found {count} times, expected once: {self.old!r}")
        path.write_text(source.replace(self.old, self.new), encoding="utf-8")


@dataclass(frozen=True)
class Fault:
    """A fault, and the tests that fail with it.

    Attributes
    ----------
    name
        What is wrong then.
    edits
        The texts that make it.
    tests
        As pytest takes them, relative to the repository.
    jit
        Whether kernels are compiled for these tests.
    """

    name: str
    edits: tuple[Edit, ...]
    tests: tuple[str, ...]
    jit: bool = True


def read_faults(path: Path = LIST) -> list[Fault]:
    """Return the faults of the list, in its order."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return [
        Fault(
            entry["name"],
            tuple(Edit(*edit) for edit in entry["edits"]),
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
        for entry in ROOT.iterdir():
            if entry.name != PACKAGE:
                (copy / entry.name).symlink_to(entry)
        shutil.copytree(ROOT / PACKAGE, copy / PACKAGE)
        change(copy)
        yield copy


def run_tests(
    tests: Sequence[str], edits: Sequence[Edit] = (), *, jit: bool = True, timeout: int = TIMEOUT
) -> bool:
    """Run tests on a copy with edits, for `timeout` s at most; return whether they pass.

    Raises
    ------
    FaultError
        Where they cannot be run.
    """

    def change(root: Path) -> None:
        for edit in edits:
            edit.apply(root)

    with changed_copy(change) as copy:
        environment = {
            **os.environ,
            "PYTHONPATH": str(copy),
            "NUMBA_DISABLE_JIT": str(int(not jit)),
        }
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
        done = subprocess.run(
            command, cwd=copy, env=environment, timeout=timeout, capture_output=True, text=True
        )
    if done.returncode not in {PASSED, FAILED}:
        raise FaultError(f"tests cannot be run: {' '.join(tests)}\n{done.stdout[-2000:]}")
    return done.returncode == PASSED


def survives(fault: Fault) -> bool:
    """Run the tests of a fault on a copy that has it; return whether they pass, and say so."""
    has_survived = run_tests(fault.tests, fault.edits, jit=fault.jit)
    print(f"{'SURVIVED' if has_survived else 'killed  '}  {fault.name}", flush=True)
    return has_survived


def main() -> int:
    """Run the faults; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("words", nargs="*", help="run faults whose names contain one of these")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="faults tried at once")
    options = parser.parse_args()
    words = options.words
    faults = [f for f in read_faults() if not words or any(word in f.name for word in words)]
    for jit in (True, False):
        tests = sorted({test for fault in faults for test in fault.tests if fault.jit is jit})
        if tests and not run_tests(tests, jit=jit, timeout=TIMEOUT * len(tests)):
            raise FaultError(f"tests fail without any fault: {' '.join(tests)}")
    with ThreadPoolExecutor(options.jobs) as pool:
        survived = sum(pool.map(survives, faults))
    print(f"{len(faults) - survived} killed, {survived} survived")
    return int(survived > 0)


if __name__ == "__main__":
    sys.exit(main())
