"""Compilation of kernels in parallel child processes, before the kernels are called.

The first compilation takes minutes of processor time and hundreds of megabytes, and holds the
interpreter nearly all the time. Child processes do it, one per part and as many at once as there
are cores. They leave the kernels on disk and exit, which frees their memory. Live nodes, replays
and fleet workers start the same child processes; only one process compiles a part, and others wait
for it.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from pathlib import Path

from numba import __version__ as numba_version
from numba.core import config as numba_config

import tccm_ros
from tccm_ros.config import Config
from tccm_ros.errors import one_line
from tccm_ros.kernel_cache import cache_folder
from tccm_ros.progress import Bars
from tccm_ros.warm_up.parts import PARTS, run_part

MODULE = "tccm_ros.warm_up.compilation"
"""This module, which the child processes run."""


class Compilation:
    """Child processes that compile the kernels of processors, unless these are on disk.

    Parameters
    ----------
    processors
        Names (`Stream.processor`); those without kernels are ignored.
    config
        Configuration of the processors.
    """

    def __init__(self, processors: Collection[str], config: Config) -> None:
        self.problems: list[str] = []
        """Reasons of failed child processes; their kernels are compiled when they are called."""
        self._config_json = config.model_dump_json()
        is_compiling = not numba_config.DISABLE_JIT  # type: ignore[attr-defined]
        self._parts = missing_parts(processors) if is_compiling else ()
        self._lock = threading.Lock()
        self._is_ended = False
        self._children: list[subprocess.Popen[str]] = []
        self._jobs: list[Future[None]] = []

    @property
    def is_needed(self) -> bool:
        """Whether any kernel must be compiled."""
        return bool(self._parts)

    def start(self) -> None:
        """Start, with as many child processes at once as there are cores."""
        pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)), "compiling")
        self._jobs = [pool.submit(self._compile, part) for part in self._parts]
        pool.shutdown(wait=False)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until all child processes have ended, or a timeout; return whether they have."""
        return not wait(self._jobs, timeout_s).not_done

    def stop(self) -> None:
        """Kill the child processes."""
        with self._lock:
            self._is_ended = True
            for child in self._children:
                with suppress(ProcessLookupError):
                    child.kill()

    def _compile(self, part: str) -> None:
        command = [sys.executable, "-m", MODULE, part, str(os.getpid())]
        try:
            with self._lock:
                if self._is_ended:
                    return
                child = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    text=True,
                )
                self._children.append(child)
            _, errors = child.communicate(self._config_json)
        except OSError as error:
            self.problems.append(f"no process to compile in ({one_line(error)})")
            return
        if child.returncode != 0 and not self._is_ended:
            last = errors.strip().splitlines()[-1:] or ["no message"]
            self.problems.append(f"compiling in a process failed ({last[0]})")


def compile_kernels(processors: Collection[str], config: Config, bars: Bars | None = None) -> None:
    """Compile the kernels of processors, unless they are on disk; return when all are.

    Parameters
    ----------
    processors
        Names (`Stream.processor`).
    config
        Configuration of the processors.
    bars
        Progress bars.
    """
    compilation = Compilation(processors, config)
    if not compilation.is_needed:
        return
    (bars or Bars()).start("compile", 1.0)
    compilation.start()
    try:
        compilation.wait()
    finally:
        compilation.stop()


def missing_parts(processors: Collection[str]) -> tuple[str, ...]:
    """Return the parts of processors whose kernels are not on disk for the current code."""
    fingerprint = _fingerprint()
    parts = (part for name, parts in PARTS.items() if name in processors for part in parts)
    return tuple(part for part in parts if not _is_compiled_for(part, fingerprint))


def _is_compiled_for(part: str, fingerprint: str) -> bool:
    try:
        return _marker(part).read_text() == fingerprint
    except OSError:
        return False


def _marker(part: str) -> Path:
    """Return the file next to the kernels with the fingerprint of a part's compiled code."""
    return cache_folder() / f"compiled_for_{part}.txt"


def _fingerprint() -> str:
    """Return a hash of the kernels' code and of the versions of numba and Python."""
    root = Path(tccm_ros.__file__).parent
    digest = hashlib.sha256(f"{numba_version} {sys.version}".encode())
    for path in sorted(root.rglob("*.py")):
        text = path.read_bytes()
        if b"@kernel" in text:
            digest.update(text)
    return digest.hexdigest()


@contextmanager
def _only_one(part: str) -> Iterator[None]:
    """Hold this user's lock of a part on this machine; it is released when the process ends."""
    with (cache_folder() / f"compiling_{part}.lock").open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _end_with(parent: int) -> None:
    """Exit when the parent process has ended for any reason."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def main() -> None:
    """Compile the kernels of a part, with a configuration from standard input."""
    part, parent = sys.argv[1], int(sys.argv[2])
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    config = Config.model_validate_json(sys.stdin.read())
    fingerprint = _fingerprint()
    with _only_one(part):
        if not _is_compiled_for(part, fingerprint):
            run_part(part, config)
            with suppress(OSError):
                _marker(part).write_text(fingerprint)


if __name__ == "__main__":
    main()
