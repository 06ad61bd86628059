"""Order of the estimated parameters in a vector, and standard deviations of their priors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

LEVEL_PARAMETERS = ("level_x", "level_y", "level_yaw")
"""Corrections of the level laser's configured pose, in the base frame, m and rad."""


@dataclass(frozen=True, slots=True)
class Trust:
    """Standard deviations of what is assumed of buildings, bases and lasers (defaults: chosen).

    Attributes
    ----------
    base_tilt
        Of the base's roll and pitch at a place, rad.
    vertical, ceiling
        Of the angle of walls to the vertical and of the ceiling to the floor, rad.
    range_noise, angle_noise, flatness
        Of ranges (m), of beam directions (rad), and of the error that
        neighbouring hits on a plane have in common (m).
    range_bias
        Of the common error of all ranges of the tilting laser (positive: too short), m.
    floor
        Of the floor's height in the base frame where it is given, m.
    """

    base_tilt: float = float(np.deg2rad(0.1))
    vertical: float = float(np.deg2rad(0.2))
    ceiling: float = float(np.deg2rad(0.1))
    range_noise: float = 0.008
    angle_noise: float = 3e-4
    flatness: float = 0.003
    range_bias: float = 0.01
    floor: float = 0.0005


WIDE_SIGMAS = np.array([0.1, 0.04, 0.1, 0.5, 0.08, 0.3])
WIDE_LEVEL_SIGMAS = np.array([0.5, 0.5, 0.3])
"""Standard deviations of the rig's parameters about the first guess, in the order of
`RIG_PARAMETERS` and of `LEVEL_PARAMETERS`, m, rad, s (chosen: wide; they only bound what is not
determined)."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Indices of the parameters in the vector.

    In order: rig, level laser, the tilting laser's range bias, floor, the ceiling of each bag,
    walls, roll and pitch of each place.

    Attributes
    ----------
    bags, walls, places
        Number of bags, of walls, and of places.
    rig, level, bias, floor, first_ceiling
        Where the parameters that every vector has are.
    """

    rig: ClassVar[slice] = slice(0, 6)
    level: ClassVar[slice] = slice(6, 9)
    bias: ClassVar[int] = 9
    floor: ClassVar[int] = 10
    first_ceiling: ClassVar[int] = 11

    bags: int
    walls: int
    places: int

    def ceiling(self, bag: int) -> slice:
        """Return where a ceiling's height at the bag's first place and slopes along x and y are."""
        first = self.first_ceiling + 3 * bag
        return slice(first, first + 3)

    @property
    def first_wall(self) -> int:
        """Index of the first wall's first parameter."""
        return self.first_ceiling + 3 * self.bags

    def wall(self, number: int) -> slice:
        """Return where phi, rho and the angle to the vertical of a wall are."""
        first = self.first_wall + 3 * number
        return slice(first, first + 3)

    def roll_pitch(self, place: int) -> slice:
        """Return where roll and pitch of the base at a place are."""
        first = self.first_wall + 3 * self.walls + 2 * place
        return slice(first, first + 2)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.first_wall + 3 * self.walls + 2 * self.places
