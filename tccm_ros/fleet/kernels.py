"""Kernels are compiled once on each machine, before the first recording is replayed on it."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import gettempdir

from tccm_ros.config import Config
from tccm_ros.nodes.warming import is_compiled

PROCESSORS = ("tccm", "slam")


@cache
def _ready() -> set[str]:
    """Return the processors whose kernels this process has seen compiled."""
    return set()


def compile_kernels(config: Config) -> None:
    """Fill numba's cache, unless it is filled; other processes of the machine wait meanwhile.

    Where it fails, each process compiles what it needs.

    Parameters
    ----------
    config
        Of the recordings.
    """
    if _ready() >= set(PROCESSORS):
        return
    with _machine_lock():
        for name in PROCESSORS:
            if not is_compiled(name):
                _compile(name, config)
            _ready().add(name)


def _compile(processor: str, config: Config) -> None:
    """Have a process of its own compile: its memory ends with it."""
    command = [sys.executable, "-m", "tccm_ros.nodes.warming", processor, str(os.getpid())]
    text = config.model_dump_json()
    subprocess.run(command, input=text, text=True, capture_output=True, check=False)


@contextmanager
def _machine_lock() -> Iterator[None]:
    """Hold a lock of this user on this machine; the end of a process releases it."""
    path = Path(gettempdir()) / f"tccm-kernels-{os.getuid()}.lock"
    with path.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
