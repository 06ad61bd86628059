"""How joints move: rests, and sweeps between them with rounded turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64

__all__ = ["Profile", "sweeps"]


@dataclass(frozen=True)
class Profile:
    """The position of a joint over time.

    `moves` float64 (M, 4), in order of time: from time, to time (s), from position, to position
    (rad). Before, between and after moves the joint rests. `ramp` is the share of a move that it
    takes to reach its speed, and to brake: 0 turns on the spot, 0.5 never runs evenly.
    """

    moves: Float64
    ramp: float = 0.1

    def at(self, times: ArrayLike) -> Float64:
        """Return the positions at times (B,) in s, float64 (B,), rad."""
        t = np.asarray(times, float)
        i = np.clip(np.searchsorted(self.moves[:, 0], t, side="right") - 1, 0, None)
        start, end, first, last = self.moves[i].T
        share = np.clip((t - start) / (end - start), 0.0, 1.0)
        return first + (last - first) * _eased(share, self.ramp)

    @staticmethod
    def rest(position: float) -> Profile:
        """Return a joint that does not move."""
        return Profile(np.array([[0.0, 1.0, position, position]]))


def _eased(share: Float64, ramp: float) -> Float64:
    """Return the way done after a share of the time, with an even speed between two ramps."""
    if ramp <= 0.0:
        return share
    speed = 1.0 / (1.0 - ramp)
    up = 0.5 * speed / ramp * share**2
    down = 1.0 - 0.5 * speed / ramp * (1.0 - share) ** 2
    even = speed * (share - ramp / 2.0)
    return np.where(share < ramp, up, np.where(share > 1.0 - ramp, down, even))


def sweeps(
    windows: Sequence[tuple[float, float]] | Float64,
    period: float,
    limits: tuple[float, float],
    ramp: float = 0.1,
) -> Profile:
    """Return a joint that sweeps back and forth within windows of time and rests between them.

    Parameters
    ----------
    windows
        (from, to) in s; as many whole sweeps as fit are made, each from where the last ended.
    period
        Of one sweep from one limit to the other, s.
    limits
        (first, last) position, rad.
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
