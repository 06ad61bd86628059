"""Positions of joints over time: rests, and oscillations with smooth turning points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64


@dataclass(frozen=True)
class Profile:
    """The position of a joint over time. It rests before, between and after its moves.

    Attributes
    ----------
    moves
        float64 (M, 4), in order of time: start and end time (s), start and end position (rad or m).
    ramp
        Fraction of a move in which the joint accelerates, and in which it brakes, 0 to 0.5.
    """

    moves: Float64
    ramp: float = 0.1

    def at(self, times: ArrayLike) -> Float64:
        """Return the positions at times (B,) in s, float64 (B,), rad or m."""
        t = np.asarray(times, float)
        i = np.clip(np.searchsorted(self.moves[:, 0], t, side="right") - 1, 0, None)
        start, end, first, last = self.moves[i].T
        fraction = np.clip((t - start) / (end - start), 0.0, 1.0)
        return first + (last - first) * _eased(fraction, self.ramp)

    @staticmethod
    def rest(position: float) -> Profile:
        """Return a joint that does not move."""
        return Profile(np.array([[0.0, 1.0, position, position]]))


def _eased(fraction: Float64, ramp: float) -> Float64:
    """Return the fraction of the distance covered after a fraction of the time."""
    if ramp <= 0.0:
        return fraction
    speed = 1.0 / (1.0 - ramp)
    up = 0.5 * speed / ramp * fraction**2
    down = 1.0 - 0.5 * speed / ramp * (1.0 - fraction) ** 2
    even = speed * (fraction - ramp / 2.0)
    return np.where(fraction < ramp, up, np.where(fraction > 1.0 - ramp, down, even))


def oscillation(
    windows: Sequence[tuple[float, float]] | Float64,
    period: float,
    limits: tuple[float, float],
    ramp: float = 0.1,
) -> Profile:
    """Return a joint that moves back and forth within windows of time and rests between them.

    Parameters
    ----------
    windows
        (start, end) in s; each contains as many whole half periods as fit.
    period
        Time of a move from one limit to the other, s.
    limits
        Positions at both ends, rad or m; the joint starts at the first.
    ramp
        As in `Profile`.
    """
    moves = []
    here, there = limits
    for start, end in windows:
        for n in range(int((end - start) / period + 1e-9)):
            begin = start + n * period
            moves.append((begin, begin + period, here, there))
            here, there = there, here
    return Profile(np.array(moves), ramp) if moves else Profile.rest(here)
