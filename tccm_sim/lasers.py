"""Model of a laser: noise, quantisation, mixed pixels, lost and invalid returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from tccm_ros.arrays import Float32, Float64, Int64

EDGE = 0.05
"""Minimum difference of ranges at the beam's centre and rim on an edge, m. Chosen: lasers return
one echo for less."""


@dataclass(frozen=True)
class Laser:
    """Parameters of a scanning range finder, as in its data sheet.

    Attributes
    ----------
    beams, angle_min, angle_max
        Number of beams, and bearings of the first and the last, rad.
    period
        Time from the first beam of a scan to that of the next, s.
    time_increment
        Time between beams, s.
    range_min, range_max
        Limits of the range, m.
    sigma, quantum
        Standard deviation and quantisation step of a range, m; a step of 0 means no rounding.
    divergence
        Half angle of the beam, rad.
    mixed
        Fraction of beams on an edge that return a range between its two sides.
    lost, invalid
        Fractions of beams with no return (+inf) and with an invalid one (nan or 0).
    """

    beams: int
    angle_min: float
    angle_max: float
    period: float
    time_increment: float
    range_min: float
    range_max: float
    sigma: float
    quantum: float = 0.001
    divergence: float = 0.0
    mixed: float = 0.0
    lost: float = 0.0
    invalid: float = 0.0

    @property
    def angle_increment(self) -> float:
        """Angle between beams, rad."""
        return (self.angle_max - self.angle_min) / (self.beams - 1)

    @property
    def bearings(self) -> Float64:
        """Bearings of all beams, float64 (beams,), rad."""
        return self.angle_min + self.angle_increment * np.arange(self.beams, dtype=np.float64)

    @property
    def offsets(self) -> Float64:
        """Time of each beam relative to the first, float64 (beams,), s."""
        return self.time_increment * np.arange(self.beams, dtype=np.float64)


def rim_directions(bearings: Float64, divergence: float, around: Float64) -> Float64:
    """Return a direction at the rim of each beam; a second ray there detects edges.

    Parameters
    ----------
    bearings
        float64 (B,), rad.
    divergence
        Half angle of the beam, rad.
    around
        float64 (B,), angle around the beam, rad.

    Returns
    -------
    float64 (B, 3)
        Unit vectors in the laser's frame.
    """
    azimuth = bearings + divergence * np.cos(around)
    elevation = divergence * np.sin(around)
    cosine = np.cos(elevation)
    return np.stack(
        [cosine * np.cos(azimuth), cosine * np.sin(azimuth), np.sin(elevation)], axis=-1
    )


def measure(
    laser: Laser, exact: Float64, rim: Callable[[Int64], Float64] | None, random: Generator
) -> Float32:
    """Return the ranges that a laser reports.

    Parameters
    ----------
    laser
        The laser.
    exact
        float64 (B,), distance along the beam's centre, m; +inf without a hit.
    rim
        Returns the distance along a ray at the rim of each of some beams, by their indices, m;
        None without mixed pixels.
    random
        Random generator of noise; the number of draws does not depend on the ranges.

    Returns
    -------
    float32 (B,)
        REP-117: +inf nothing seen, -inf too close, nan (or 0) invalid.
    """
    count = len(exact)
    noise, blend, chance = random.standard_normal(count), random.random(count), random.random(count)
    failure = random.random(count)
    ranges = exact.copy()
    if rim is not None:
        mixed = np.flatnonzero((chance < laser.mixed) & np.isfinite(exact))
        near, beyond = exact[mixed], rim(mixed)
        on_edge = np.isfinite(beyond) & (np.abs(near - beyond) > EDGE)
        mixed, near, beyond = mixed[on_edge], near[on_edge], beyond[on_edge]
        ranges[mixed] = blend[mixed] * near + (1.0 - blend[mixed]) * beyond
    ranges += laser.sigma * noise
    if laser.quantum > 0.0:
        ranges = np.round(ranges / laser.quantum) * laser.quantum
    ranges[ranges > laser.range_max] = np.inf
    ranges[ranges < laser.range_min] = -np.inf
    ranges[failure < laser.lost] = np.inf
    is_invalid = (failure >= laser.lost) & (failure < laser.lost + laser.invalid)
    ranges[is_invalid] = np.where(blend < 0.5, np.nan, 0.0)[is_invalid]
    return ranges.astype(np.float32)
