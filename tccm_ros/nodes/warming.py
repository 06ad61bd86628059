"""Kernels are compiled in child processes while a node already serves, and loaded when it is done.

Then the node loads them in a thread of its own.
"""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable

from tccm_ros.config import Config
from tccm_ros.errors import TccmError
from tccm_ros.warm_up.compilation import Compilation
from tccm_ros.warm_up.parts import warm_up

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
        self._compilation = Compilation([processor_name], config)
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
        """End the children: the node is told to stop."""
        self._is_ended = True
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
        """Have children compile all kernels; where they fail, the node compiles itself."""
        start_s = time.monotonic()
        self._compilation.start()
        while not self._compilation.wait(PROGRESS_S):
            self._report(f"kernels are compiled, once: {time.monotonic() - start_s:.0f} s")
        for problem in self._compilation.problems:
            self._report(f"{problem}: the node compiles itself")
