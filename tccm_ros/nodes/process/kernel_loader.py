"""Compilation of kernels in child processes while the node already serves.

Afterwards the node loads them in a separate thread.
"""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable

from tccm_ros.config import Config
from tccm_ros.errors import TccmError
from tccm_ros.nodes.process.heap import trim_heap
from tccm_ros.warm_up.compilation import Compilation
from tccm_ros.warm_up.parts import warm_up

PROGRESS_S = 5.0
"""Period of the progress message, s."""


class KernelLoader:
    """Compiles and loads the kernels of a node in the background.

    Parameters
    ----------
    processor_name
        The processor that the node runs (`Stream.processor`).
    config
        Configuration of the node.
    report
        Called with a sentence every `PROGRESS_S` while kernels are compiled.
    on_done
        Called in the thread when all kernels are loaded.

    Attributes
    ----------
    is_loaded
        Whether all kernels are loaded.
    is_done
        Whether the records kept during the compilation are processed as well.
    """

    is_loaded = is_done = False

    def __init__(
        self,
        processor_name: str,
        config: Config,
        report: Callable[[str], object],
        on_done: Callable[[], None],
    ):
        self._processor_name, self._config = processor_name, config
        self._report, self._on_done = report, on_done
        self._compilation = Compilation([processor_name], config)
        self._over = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"{processor_name} kernels", daemon=True
        )

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def load(self) -> None:
        """Start, and return when all kernels are loaded.

        Raises
        ------
        TccmError
            If they could not be loaded.
        """
        self.start()
        self._thread.join()
        if not self.is_done:
            raise TccmError("the kernels could not be compiled; the lines above say why")

    def wait_until_loaded(self) -> None:
        """Return when all kernels are loaded, or loading has ended without success."""
        self._over.wait()

    def stop(self) -> None:
        """End the child processes, because the node stops."""
        self._over.set()
        self._compilation.stop()

    def _run(self) -> None:
        try:
            self._load()
        finally:
            self._over.set()

    def _load(self) -> None:
        if self._compilation.is_needed:
            self._compile()
        if self._over.is_set():
            return
        warm_up(self._processor_name, self._config)
        # Modules and kernels live until the end; collecting their objects would take 0.1 s each
        # time.
        gc.collect()
        gc.freeze()
        trim_heap()
        self.is_loaded = True
        self._over.set()
        self._on_done()
        self.is_done = True

    def _compile(self) -> None:
        """Compile all kernels in child processes; the node itself compiles those that fail."""
        start_s = time.monotonic()
        self._compilation.start()
        while not self._compilation.wait(PROGRESS_S):
            self._report(f"kernels are compiled, once: {time.monotonic() - start_s:.0f} s")
        for problem in self._compilation.problems:
            self._report(f"{problem}: the node compiles itself")
