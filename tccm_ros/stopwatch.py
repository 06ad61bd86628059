"""Stopwatch for the stages of a job."""

from __future__ import annotations

import time
from collections.abc import Callable


class Stopwatch:
    """Seconds spent in each stage, by name, in order of first use.

    Parameters
    ----------
    now
        Returns the time, s; benchmarks on a busy machine use the processor time of the process.
    """

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        self.seconds: dict[str, float] = {}
        self._now = now
        self._stages: dict[str, _Stage] = {}

    def stage(self, name: str) -> _Stage:
        """Return a context that adds its time to a stage; a stage must not be nested in itself."""
        stage = self._stages.get(name)
        if stage is None:
            stage = self._stages[name] = _Stage(name, self.seconds, self._now)
        return stage


class _Stage:
    """A context that adds up its time; a class for speed, as it is entered for every record."""

    __slots__ = ("_name", "_now", "_seconds", "_start")

    def __init__(self, name: str, seconds: dict[str, float], now: Callable[[], float]) -> None:
        self._name, self._seconds, self._now, self._start = name, seconds, now, 0.0
        seconds[name] = 0.0

    def __enter__(self) -> None:
        self._start = self._now()

    def __exit__(self, *_: object) -> None:
        self._seconds[self._name] += self._now() - self._start
