"""Kernels are compiled in a child process while a node already serves, and loaded when it is done.

Compiling for the first time takes minutes and hundreds of megabytes, and holds the interpreter
nearly all the time. A child does it, leaves the kernels on disk and ends; its memory ends with it.
Then the node loads them in a thread of its own.
"""

from __future__ import annotations

import gc
import hashlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numba

import tccm_ros
from tccm_ros.config import Config
from tccm_ros.errors import TccmError, one_line
from tccm_ros.kernel_cache import cache_folder

PROGRESS_S = 5.0
"""Between two lines that say how long it has taken, s."""


class Warming:
    """Compiles and loads the kernels of a node in the background.

    Parameters
    ----------
    processor_name
        The processor that the node runs (`Stream.processor`).
    config
        Of the node.
    report
        Called with a sentence every `PROGRESS_S` while kernels are compiled.
    on_done
        Called in the thread when all kernels are loaded.
    """

    def __init__(
        self,
        processor_name: str,
        config: Config,
        report: Callable[[str], object],
        on_done: Callable[[], None],
    ):
        self._processor_name, self._config = processor_name, config
        self._report, self._on_done = report, on_done
        self._child: subprocess.Popen[str] | None = None
        self._is_ended = False
        self._loaded, self._done = threading.Event(), threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"{processor_name} warming", daemon=True
        )

    @property
    def is_loaded(self) -> bool:
        """Whether all kernels are loaded."""
        return self._loaded.is_set()

    @property
    def is_done(self) -> bool:
        """Whether what came meanwhile is worked on as well."""
        return self._done.is_set()

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def load(self) -> None:
        """Begin, and return when all kernels are loaded.

        Raises
        ------
        TccmError
            Where they could not be.
        """
        self.start()
        self._thread.join()
        if not self.is_done:
            raise TccmError("the kernels could not be compiled; the lines above say why")

    def wait_until_loaded(self) -> None:
        """Return when all kernels are loaded, or will not be."""
        self._over.wait()

    def stop(self) -> None:
        """End the child: the node is told to stop."""
        self._is_ended = True
        self._over.set()
        if self._child is not None:
            with suppress(ProcessLookupError):
                self._child.kill()

    def _run(self) -> None:
        try:
            self._load()
        finally:
            self._over.set()

    def _load(self) -> None:
        if not is_compiled(self._processor_name):
            self._compile()
        if self._is_ended:
            return
        warm_up(self._processor_name, self._config)
        # What modules and kernels are made of lives until the end; going through it takes 0.1 s.
        gc.collect()
        gc.freeze()
        self._loaded.set()
        self._over.set()
        self._on_done()
        self._done.set()

    def _compile(self) -> None:
        """Have a child compile all kernels; where it fails, the node compiles itself."""
        start_s = time.monotonic()
        command = [
            sys.executable,
            "-m",
            "tccm_ros.nodes.warming",
            self._processor_name,
            str(os.getpid()),
        ]
        try:
            self._child = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        except OSError as error:
            self._report(f"no process to compile in ({one_line(error)}): the node compiles itself")
            return
        text: str | None = self._config.model_dump_json()
        while True:
            try:
                _, errors = self._child.communicate(text, timeout=PROGRESS_S)
            except subprocess.TimeoutExpired:
                text = None
                self._report(f"kernels are compiled, once: {time.monotonic() - start_s:.0f} s")
            else:
                break
        if self._child.returncode != 0 and not self._is_ended:
            last = errors.strip().splitlines()[-1:] or ["no message"]
            self._report(f"compiling in a process failed ({last[0]}): the node compiles itself")


def warm_up(processor_name: str, config: Config) -> None:
    """Compile or load the kernels of a node; what the other one needs is not even imported."""
    if processor_name == "tccm":
        from tccm_ros.nodes.warm_up import warm_up_tccm

        warm_up_tccm(config)
    else:
        from tccm_ros.nodes.warm_up_slam import warm_up_slam

        warm_up_slam(config)


def is_compiled(processor_name: str) -> bool:
    """Return whether the kernels of a node are on disk, as the code is now."""
    try:
        return _marker(processor_name).read_text() == _fingerprint()
    except OSError:
        return False


def _marker(processor_name: str) -> Path:
    """Return the file beside the kernels that says for which code they were compiled."""
    return cache_folder() / f"compiled_for_{processor_name}.txt"


def _fingerprint() -> str:
    """Return what tells one state of the kernels, of numba and of the interpreter from another."""
    root = Path(tccm_ros.__file__).parent
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for path in sorted(root.rglob("*.py")):
        text = path.read_bytes()
        if b"@kernel" in text:
            digest.update(text)
    return digest.hexdigest()


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, however that was."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def main() -> None:
    """Compile the kernels of a node; its configuration is read from the standard input."""
    processor_name = sys.argv[1]
    threading.Thread(target=_end_with, args=(int(sys.argv[2]),), daemon=True).start()
    warm_up(processor_name, Config.model_validate_json(sys.stdin.read()))
    with suppress(OSError):
        _marker(processor_name).write_text(_fingerprint())


if __name__ == "__main__":
    main()
