"""A first guess of zero, scale and roll: buildings are level and upright.

A flat patch of a building is level or upright, so its normal should be. Which scale, zero and roll
make most patches so is found by trying: nothing need be known of where floor and walls are. Patches
are cut anew for each scale, because a wrong scale skews them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Int64
from tccm_ros.pipeline.calibrate.model import RigModel, RigValues
from tccm_ros.pipeline.calibrate.patches import Patches, cut_patches
from tccm_ros.pipeline.calibrate.sweeps import TiltSweep

__all__ = ["first_guess"]

#: Scales that are tried, as factors of the configured one, then of the best so far.
SCALES = (
    np.exp(np.arange(-0.48, 0.481, 0.08)),
    np.exp(np.arange(-0.06, 0.061, 0.03)),
    np.exp(np.arange(-0.015, 0.016, 0.0075)),
)

#: Zeros and rolls that are tried with each scale, about the configured ones, rad.
OFFSETS = np.deg2rad(np.arange(-20.0, 20.5, 1.0))
NEAR_OFFSETS = np.deg2rad(np.arange(-0.75, 0.8, 0.25))
ROLLS = np.deg2rad(np.arange(-5.0, 5.1, 0.5))

#: A normal this far from upright or level counts e^-1/2, rad.
TOLERANCE = np.deg2rad(2.0)

#: Patches and sweeps that are looked at.
MOST, SWEEPS = 1000, 3


class _Tried(NamedTuple):
    share: float
    values: RigValues


def first_guess(sweeps: Sequence[TiltSweep], model: RigModel, start: RigValues) -> RigValues:
    """Return values under which most patches are level or upright.

    Parameters
    ----------
    sweeps
        Of which a few are looked at.
    model
        Places them.
    start
        The configured values; what is tried is around them.
    """
    numbers = np.unique(np.linspace(0, len(sweeps) - 1, min(len(sweeps), SWEEPS)).astype(int))
    few = {number: sweeps[number] for number in numbers.tolist()}
    best = _Tried(-1.0, start)
    for factors in SCALES:
        scale = best.values.tilt_scale
        tried = [_best_at(replace(start, tilt_scale=scale * f), few, model) for f in factors]
        best = max([best, *tried], key=lambda t: t.share)
    return best.values


def _best_at(values: RigValues, sweeps: dict[int, TiltSweep], model: RigModel) -> _Tried:
    """Return the best zero and roll at a scale."""
    patches = cut_patches(sweeps, model, values)
    if len(patches) == 0:
        return _Tried(0.0, values)
    rows = np.unique(np.linspace(0, len(patches) - 1, min(len(patches), MOST)).astype(np.int64))
    some = _Normals(patches, rows, model)
    best = some.best(replace(values, tilt_offset=values.tilt_offset + o) for o in OFFSETS)
    best = some.best(replace(best.values, roll=values.roll + roll) for roll in ROLLS)
    near = best.values.tilt_offset
    return some.best(replace(best.values, tilt_offset=near + o) for o in NEAR_OFFSETS)


class _Normals:
    """Normals of some patches, and the share of them that is level or upright."""

    def __init__(self, patches: Patches, rows: Int64, model: RigModel) -> None:
        self._centers, self._normals = patches.centers.take(rows), patches.normals[rows]
        self._width = np.hypot(TOLERANCE, patches.spread[rows])
        self._model = model

    def best(self, candidates: Iterable[RigValues]) -> _Tried:
        """Return the values with the largest share."""
        return max((_Tried(self._share(v), v) for v in candidates), key=lambda t: t.share)

    def _share(self, values: RigValues) -> float:
        up = self._model.turn(self._centers, values, self._normals)[:, 2]
        level = np.arcsin(np.clip(np.abs(up), 0.0, 1.0))
        off = np.minimum(level, np.pi / 2.0 - level)
        return float(np.exp(-0.5 * (off / self._width) ** 2).mean())
