"""Reject temporary outliers of a track: zeros of a second publisher, invalid positions.

A step that is too fast is held until the next samples decide. If they return to the track, the held
samples are refused as outliers; if not, the step is real. Samples on the way to the next one are no
outliers: only their stamps are too close, as of messages that a computer stamps when it is busy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

LASTING_NS = 100_000_000
"""Samples that stay off the track for this time, ns, are no outliers: robots publish joints at 10
Hz or more."""

FASTER = 3.0
"""A sample whose speed exceeds the previous maximum by this factor is held: joints accelerate over
several samples."""

FORGET = 0.97
"""Decay of the maximum speed per sample: a memory of one second at 30 Hz."""

KNOWN = 8
"""Minimum number of steps to know the speed of a track."""

T = TypeVar("T")


class Steps(NamedTuple, Generic[T]):
    """Decision on a sample and on those that were held before it.

    Attributes
    ----------
    admitted
        Stamps, ns, and samples to use now.
    refused
        Number of outliers.
    has_jumped
        Whether the first admitted sample is the start of the track after a jump.
    """

    admitted: list[tuple[int, T]]
    refused: int = 0
    has_jumped: bool = False


class StepGuard(Generic[T]):
    """Admits the samples of one track by the size of their steps.

    Parameters
    ----------
    distance
        Function that returns the distance of two samples.
    slack
        Steps up to this are plausible at any speed.
    speed
        Maximum speed, 1/s. None for `FASTER` times the maximum so far, once that is known.
    """

    def __init__(self, distance: Callable[[T, T], float], slack: float, speed: float | None = None):
        self._distance, self._slack, self._max_speed = distance, slack, speed
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._last: tuple[int, T] | None = None
        self._held: list[tuple[int, T]] = []
        self._speed = self._last_speed = 0.0
        self._steps = 0
        self._before: tuple[int, T] | None = None

    def add(self, stamp_ns: int, sample: T) -> Steps[T]:
        """Add a sample; return the samples to use now."""
        item = stamp_ns, sample
        if self._last is None or stamp_ns <= self._last[0]:
            self._last = self._last or item
            return Steps([item])
        seconds = (stamp_ns - self._last[0]) * 1e-9
        step = self._distance(self._last[1], sample)
        if self._is_possible(step, seconds):
            on_way = self._on_way(sample)
            refused, self._held = len(self._held) - len(on_way), []
            if self._max_speed is None:
                self._learn(item, step / (stamp_ns - self._last[0]) * 1e9)
            self._last = item
            return Steps([*on_way, item], refused)
        self._held.append(item)
        if stamp_ns - self._held[0][0] < LASTING_NS:
            return Steps([])
        admitted, self._held = self._held, []
        seconds = (stamp_ns - admitted[0][0]) * 1e-9
        self._speed = self._distance(admitted[0][1], sample) / seconds
        self._last, self._before = item, None
        return Steps(admitted, has_jumped=True)

    def _learn(self, item: tuple[int, T], speed: float) -> None:
        """Update the speed with the slowest step of three samples; an outlier returns.

        Parameters
        ----------
        item
            The newest of the three.
        speed
            Speed of the step to it, 1/s.
        """
        if self._before is not None:
            stamp_ns, sample = self._before
            over_two = self._distance(sample, item[1]) / (item[0] - stamp_ns) * 1e9
            slowest = min(self._last_speed, speed, over_two)
            self._speed = max(FORGET * self._speed, slowest)
        self._steps += 1
        self._before, self._last_speed = self._last, speed

    def _on_way(self, sample: T) -> list[tuple[int, T]]:
        """Return the held samples that hardly lengthen the track to a sample."""
        assert self._last is not None
        previous, found = self._last[1], []
        for item in self._held:
            over = self._distance(previous, item[1]) + self._distance(item[1], sample)
            if over <= self._distance(previous, sample) + self._slack:
                previous = item[1]
                found.append(item)
        return found

    def _is_possible(self, step: float, seconds: float) -> bool:
        speed = self._max_speed
        if speed is None:
            if self._steps < KNOWN:
                return True
            speed = FASTER * self._speed
        return step <= max(self._slack, seconds * speed)
