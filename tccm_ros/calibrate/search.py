"""First guess of tilt zero, tilt scale and roll, by a grid search over patch orientations.

Most flat patches of a building are horizontal or vertical. The search selects the scale, zero and
roll for which this holds for most patches; it needs no floor and no walls. Patches are cut again
for each scale, because a wrong scale distorts them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Int64
from tccm_ros.calibrate.model import RigModel, RigValues
from tccm_ros.calibrate.patches import Patches, cut_patches
from tccm_ros.calibrate.recording import CycleScans, evenly

SCALES = (
    np.exp(np.arange(-0.48, 0.481, 0.08)),
    np.exp(np.arange(-0.06, 0.061, 0.03)),
    np.exp(np.arange(-0.015, 0.016, 0.0075)),
)
"""Scales of the grid, as factors of the configured one, then of the best so far (chosen)."""

OFFSETS = np.deg2rad(np.arange(-20.0, 20.5, 1.0))
NEAR_OFFSETS = np.deg2rad(np.arange(-0.75, 0.8, 0.25))
ROLLS = np.deg2rad(np.arange(-5.0, 5.1, 0.5))
"""Zeros and rolls of the grid at each scale, relative to the configured ones, rad (chosen)."""

TOLERANCE = np.deg2rad(2.0)
"""Deviation of a normal from vertical or horizontal with a score of e^-1/2, rad (chosen)."""

MAX_PATCHES, MAX_TRIED_CYCLES = 1000, 3
"""Maximum number of patches and of tilt cycles (chosen: computing time)."""


class _Candidate(NamedTuple):
    score: float
    values: RigValues


def first_guess(cycles: Sequence[CycleScans], model: RigModel, start: RigValues) -> RigValues:
    """Return the values for which most patches are horizontal or vertical.

    Parameters
    ----------
    cycles
        Tilt cycles, of which up to `MAX_TRIED_CYCLES` are used.
    model
        Rig model, which transforms their beams.
    start
        The configured values, at the centre of the grid.
    """
    few = {number: cycles[number] for number in evenly(len(cycles), MAX_TRIED_CYCLES).tolist()}
    best = _Candidate(-1.0, start)
    for factors in SCALES:
        scale = best.values.tilt_scale
        tried = [_best_at(replace(start, tilt_scale=scale * f), few, model) for f in factors]
        best = max([best, *tried], key=lambda t: t.score)
    return best.values


def _best_at(values: RigValues, cycles: dict[int, CycleScans], model: RigModel) -> _Candidate:
    """Return the best zero and roll at a scale."""
    patches = cut_patches(cycles, model, values)
    if len(patches) == 0:
        return _Candidate(0.0, values)
    sample = _Normals(patches, evenly(len(patches), MAX_PATCHES), model)
    best = sample.best(replace(values, tilt_offset=values.tilt_offset + o) for o in OFFSETS)
    best = sample.best(replace(best.values, roll=values.roll + roll) for roll in ROLLS)
    near = best.values.tilt_offset
    return sample.best(replace(best.values, tilt_offset=near + o) for o in NEAR_OFFSETS)


class _Normals:
    """Normals of patches, and a score of their being horizontal or vertical."""

    def __init__(self, patches: Patches, rows: Int64, model: RigModel) -> None:
        self._centers, self._normals = patches.centers.take(rows), patches.normals[rows]
        self._width = np.hypot(TOLERANCE, patches.spread[rows])
        self._model = model

    def best(self, candidates: Iterable[RigValues]) -> _Candidate:
        """Return the values with the highest score."""
        return max((_Candidate(self._score(v), v) for v in candidates), key=lambda t: t.score)

    def _score(self, values: RigValues) -> float:
        up = self._model.transform_directions(self._centers, values, self._normals)[:, 2]
        elevation = np.arcsin(np.clip(np.abs(up), 0.0, 1.0))
        off = np.minimum(elevation, np.pi / 2.0 - elevation)
        return float(np.exp(-0.5 * (off / self._width) ** 2).mean())
