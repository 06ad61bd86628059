"""Order of the estimated parameters in a vector, and standard deviations of their priors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

LEVEL_PARAMETERS = ("level_x", "level_y", "level_yaw")
"""Corrections of the level laser's configured pose, in the base frame, m and rad."""


@dataclass(frozen=True, slots=True)
class AssumptionSigmas:
    """Standard deviations of the assumptions on buildings, bases and lasers (defaults: chosen).

    Attributes
    ----------
    base_tilt
        Roll and pitch of the base at a place, rad.
    vertical, ceiling
        Angle of walls to the vertical and of the ceiling to the floor, rad.
    range_noise, angle_noise, flatness
        Ranges (m), beam directions (rad), and the common error of neighbouring hits on a plane (m).
    range_bias
        Common error of all ranges of the tilting laser (positive: too short), m.
    floor
        Height of the floor in the base frame where it is given, m.
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
`RIG_PARAMETERS` and of `LEVEL_PARAMETERS`, m, rad, s (chosen: wide; they only bound undetermined
parameters)."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Indices of the parameters in the vector.

    The order is: rig, level laser, range bias of the tilting laser, floor, ceiling of each bag,
    walls, roll and pitch of each place.

    Attributes
    ----------
    bags, walls, places
        Number of bags, of walls, and of places.
    rig, level, bias, floor, first_ceiling
        Indices of the parameters that every vector has.
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
        """Return the indices of a ceiling: height at the bag's first place, slopes along x, y."""
        first = self.first_ceiling + 3 * bag
        return slice(first, first + 3)

    @property
    def first_wall(self) -> int:
        """Index of the first wall's first parameter."""
        return self.first_ceiling + 3 * self.bags

    def wall(self, number: int) -> slice:
        """Return the indices of a wall: phi, rho and the angle to the vertical."""
        first = self.first_wall + 3 * number
        return slice(first, first + 3)

    def roll_pitch(self, place: int) -> slice:
        """Return the indices of roll and pitch of the base at a place."""
        first = self.first_wall + 3 * self.walls + 2 * place
        return slice(first, first + 2)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.first_wall + 3 * self.walls + 2 * self.places
