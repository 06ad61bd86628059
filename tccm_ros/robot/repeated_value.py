"""Find the one value that a second publisher repeats between the samples of a moving joint.

A publisher that does not measure a joint publishes zeros, or its initial position, for it. At the
rate of the driver and above, outliers are as frequent as positions, and steps (`steps`) cannot
distinguish them: the value that does not change is the one that is not measured.
"""

from __future__ import annotations

from collections import deque

MIN_STEP = 0.05
"""A value returns if the sample before differs by this, rad or m: more than any noise of a joint.
"""

WITHIN = 4
"""Samples within which the value returns: a rarer one is an outlier by its step."""

KNOWN = 8
"""Number of returns until the value counts as repeated, and of equal samples in a row until the
joint counts as resting there; as `steps.KNOWN`."""


class RepeatedValue:
    """Judges the positions of one joint.

    Parameters
    ----------
    noise
        Range of positions within which a joint counts as resting, rad or m: while it rests, both
        publishers repeat themselves.
    """

    def __init__(self, noise: float):
        self._noise = noise
        self._recent: deque[float] = deque(maxlen=WITHIN)
        self._run = 0
        self._forget()

    def _forget(self) -> None:
        self._value: float | None = None
        self._returns = self._since = 0
        self._low, self._high = float("inf"), float("-inf")

    @property
    def _is_known(self) -> bool:
        return self._returns >= KNOWN and self._high - self._low > self._noise

    def add(self, position: float) -> bool:
        """Add a position, rad or m; return whether it is the one of a second publisher."""
        recent = self._recent
        last = recent[-1] if recent else position
        returns = abs(position - last) > MIN_STEP and position in recent
        self._run = self._run + 1 if position == last else 1
        recent.append(position)
        if position != self._value:
            self._since += 1
            if self._since > WITHIN and not self._is_known:
                self._forget()
        if self._run >= KNOWN and position == self._value:
            self._forget()
        if returns and self._value is None:
            self._value = position
        if position != self._value:
            return False
        self._since = 0
        if returns:
            self._returns += 1
            self._low, self._high = min(self._low, last), max(self._high, last)
        return self._is_known
