"""What is estimated, where it is in the vector, and what is taken for granted about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

__all__ = ["LEVEL_PARAMETERS", "WIDE", "WIDE_LEVEL", "Layout", "Trust"]

LEVEL_PARAMETERS = ("level_x", "level_y", "level_yaw")
"""Where the level laser really is against where it is configured, in the base, m and rad."""


@dataclass(frozen=True, slots=True)
class Trust:
    """Standard deviations of what is taken for granted.

    Attributes
    ----------
    lean
        Of the base's roll and pitch at a place against level, rad.
    upright, ceiling
        Of walls against upright and of the ceiling against the floor, rad.
    range_noise, angle_noise, flatness
        Of ranges (m), of beam directions (rad), and of what neighbouring hits on a plane share (m).
    range_bias
        Of what all ranges of the tilting laser are too short by, m.
    floor
        Of the floor's height in the base frame where it is given, m.
    """

    lean: float = float(np.deg2rad(0.1))
    upright: float = float(np.deg2rad(0.2))
    ceiling: float = float(np.deg2rad(0.1))
    range_noise: float = 0.008
    angle_noise: float = 3e-4
    flatness: float = 0.003
    range_bias: float = 0.01
    floor: float = 0.0005


#: Standard deviations of rig parameters about the first guess, only to keep what is not determined
#: from running away: in the order of `RIG_PARAMETERS`, then of `LEVEL_PARAMETERS`.
WIDE = np.array([0.1, 0.04, 0.1, 0.5, 0.08])
WIDE_LEVEL = np.array([0.5, 0.5, 0.3])


@dataclass(frozen=True, slots=True)
class Layout:
    """Where parameters are in the vector.

    Rig, level laser, the tilting laser's range bias, floor, the ceiling of each bag, walls, leans.
    """

    rig: ClassVar[slice] = slice(0, 5)
    level: ClassVar[slice] = slice(5, 8)
    bias: ClassVar[int] = 8
    floor: ClassVar[int] = 9
    first_ceiling: ClassVar[int] = 10

    bags: int
    walls: int
    places: int

    def ceiling(self, bag: int) -> slice:
        """Return the height of a bag's ceiling at its first place, and its slopes along x and y."""
        first = self.first_ceiling + 3 * bag
        return slice(first, first + 3)

    @property
    def first_wall(self) -> int:
        """Where the walls begin."""
        return self.first_ceiling + 3 * self.bags

    def wall(self, number: int) -> slice:
        """Return phi, rho and the angle against upright of a wall."""
        first = self.first_wall + 3 * number
        return slice(first, first + 3)

    def lean(self, place: int) -> slice:
        """Return roll and pitch of the base at a place."""
        first = self.first_wall + 3 * self.walls + 2 * place
        return slice(first, first + 2)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.first_wall + 3 * self.walls + 2 * self.places
