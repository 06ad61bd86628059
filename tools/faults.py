"""Put faults into a copy of the package, one at a time, and see the tests named for them fail.

Usage: python tools/faults.py [WORD ...]

tools/faults.toml lists the faults. Each has a name, the edits that make it (file, text as it is,
text with the fault) and the tests that must fail. Given words, only the faults are run whose names
contain one of them. The last line is ``N killed, M survived``; exit status 0 if none survived.

The tests must pass without any fault; that is tried first. A fault counts as killed where a test
fails, not where the tests cannot be collected.

Compiled kernels are found by what is in them, so that what is not touched is not compiled again.
Where the tests of a fault are
quicker in plain Python than the compiler is, the fault says ``jit = false`` and they run with
``NUMBA_DISABLE_JIT=1``.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
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
def faulty_copy(edits: Sequence[Edit]) -> Iterator[Path]:
    """Yield a folder like the repository, with a copy of the package that has the edits in it."""
    with tempfile.TemporaryDirectory(prefix="tccm-fault-") as name:
        copy = Path(name)
        for entry in ROOT.iterdir():
            if entry.name != PACKAGE:
                (copy / entry.name).symlink_to(entry)
        shutil.copytree(ROOT / PACKAGE, copy / PACKAGE)
        for edit in edits:
            edit.apply(copy)
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
    with faulty_copy(edits) as copy:
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


def main() -> int:
    """Run the faults; return the exit status."""
    words = sys.argv[1:]
    faults = [f for f in read_faults() if not words or any(word in f.name for word in words)]
    for jit in (True, False):
        tests = sorted({test for fault in faults for test in fault.tests if fault.jit is jit})
        if tests and not run_tests(tests, jit=jit, timeout=TIMEOUT * len(tests)):
            raise FaultError(f"tests fail without any fault: {' '.join(tests)}")
    survived = 0
    for fault in faults:
        has_survived = run_tests(fault.tests, fault.edits, jit=fault.jit)
        survived += has_survived
        print(f"{'SURVIVED' if has_survived else 'killed  '}  {fault.name}", flush=True)
    print(f"{len(faults) - survived} killed, {survived} survived")
    return int(survived > 0)


if __name__ == "__main__":
    sys.exit(main())
