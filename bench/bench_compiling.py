"""Compile all kernels from nothing: the dearest, and processor time by part.

Usage: python bench/bench_compiling.py [PART ...]

Times are processor time of compiling a kernel itself, without the kernels that it calls, by
numba's own events; a kernel that is compiled for several types of arguments counts for each.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from typing import Any

from numba.core import event

from tccm_ros.config import Config
from tccm_ros.warm_up.parts import PARTS, run_part

SHOWN = 10


class Listener(event.Listener):
    """Adds up the processor time of each kernel."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.signatures: dict[str, int] = defaultdict(int)
        self._open: list[list[float]] = []  # began at, and time of the kernels that it calls

    def on_start(self, event: Any) -> None:
        """Note when a kernel's compiling begins."""
        self._open.append([time.process_time(), 0.0])

    def on_end(self, event: Any) -> None:
        """Add what has passed."""
        began, called = self._open.pop()
        passed = time.process_time() - began
        if self._open:
            self._open[-1][1] += passed
        function = event.data["dispatcher"].py_func
        name = f"{function.__module__.removeprefix('tccm_ros.')}.{function.__qualname__}"
        self.seconds[name] += passed - called
        self.signatures[name] += 1


def table_of(part: str) -> None:
    """Compile one part in this process, and print its dearest kernels."""
    listener, before = Listener(), time.process_time()
    with event.install_listener("numba:compile", listener):
        run_part(part, Config())
    total = time.process_time() - before
    ours = sum(listener.seconds.values())
    print(f"{part}: {total:.1f} s of processor time, {ours:.1f} s of it compiling", end=" ")
    print(f"{len(listener.seconds)} kernels for {sum(listener.signatures.values())} signatures")
    print("| kernel | signatures | s |\n|---|---|---|")
    dearest = sorted(listener.seconds.items(), key=lambda item: -item[1])
    for name, seconds in dearest[: int(os.environ.get("SHOWN", SHOWN))]:
        print(f"| {name} | {listener.signatures[name]} | {seconds:.2f} |")


def main() -> None:
    """Compile each part in a process with a cache of its own."""
    if sys.argv[1:2] == ["--here"]:
        table_of(sys.argv[2])
        return
    with tempfile.TemporaryDirectory() as folder:
        for part in sys.argv[1:] or [part for parts in PARTS.values() for part in parts]:
            command = [sys.executable, __file__, "--here", part]
            subprocess.run(command, env=os.environ | {"NUMBA_CACHE_DIR": folder}, check=True)


if __name__ == "__main__":
    main()
