"""Observability: which of the rig's parameters a recording determines, and why not others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.calibrate.estimate import Estimate
from tccm_ros.calibrate.layout import LEVEL_PARAMETERS, Layout
from tccm_ros.calibrate.model import RIG_PARAMETERS
from tccm_ros.calibrate.surroundings import FLOOR

LIMITS: Mapping[str, float] = {
    "joint_time_offset": 0.005,
    "tilt_scale": 0.02,
    "roll": float(np.deg2rad(0.5)),
    "height": 0.02,
    "tilt_offset": float(np.deg2rad(0.5)),
    "pan_offset": float(np.deg2rad(0.5)),
    "level_x": 0.03,
    "level_y": 0.03,
    "level_yaw": float(np.deg2rad(0.5)),
}
"""Maximum standard deviation of a determined parameter: s, 1, rad, m (chosen). Parameters are fixed
in this order, which begins with those that are rarely wrong."""

ADVICE: Mapping[str, str] = {
    "tilt_offset": "record a horizontal floor from 1 to 4 m, at several places",
    "tilt_scale": "tilt from the floor near the robot up to the ceiling or high up the walls",
    "roll": "record a floor or ceiling that reaches far to both sides",
    "joint_time_offset": "record tilt cycles up and down, fast ones too, while the base stands",
    "pan_offset": "record walls that both the camera and the level laser see",
    "level": "record two walls that are not parallel and that both lasers see",
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """One parameter of the rig.

    Attributes
    ----------
    name
        Name as in `UNITS`.
    value
        Value, rad, 1, m or s.
    sigma
        Standard deviation in the same unit; None if it was not estimated.
    reason
        Reason why it was not estimated.
    """

    name: str
    value: float
    sigma: float | None
    reason: str = ""

    @property
    def is_determined(self) -> bool:
        """Whether the parameter was estimated."""
        return self.sigma is not None


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """The final estimate, its determined parameters and their covariance.

    Attributes
    ----------
    estimate
        The solution in which only determined parameters are free.
    quantities
        All parameters of the rig, in the order of `RIG_PARAMETERS` and `LEVEL_PARAMETERS`.
    covariance
        float64 (D, D) of the determined parameters, in the order of `determined`.
    """

    estimate: Estimate
    quantities: tuple[Quantity, ...]
    covariance: Float64

    @property
    def determined(self) -> tuple[str, ...]:
        """Names of the determined parameters, in the order of the covariance."""
        return tuple(q.name for q in self.quantities if q.is_determined)


def assess_observability(estimate: Estimate) -> Observability:
    """Fix undetermined parameters one by one, and solve again without them."""
    layout, reasons = estimate.problem.layout, _never_free(estimate)
    column = columns(layout)
    while True:
        sigmas = estimate.standard_deviations
        weak = [n for n in LIMITS if estimate.free[column[n]] and sigmas[column[n]] > LIMITS[n]]
        if not weak:
            break
        name = weak[0]
        reasons[name] = _too_weak(name, sigmas[column[name]])
        estimate = _without(estimate, column[name])
    quantities = tuple(
        _quantity(name, estimate, column[name], float(sigmas[column[name]]), reasons)
        for name in _estimated(estimate)
    )
    kept = [column[q.name] for q in quantities if q.is_determined]
    place = np.cumsum(estimate.free) - 1
    return Observability(
        estimate, quantities, estimate.covariance[np.ix_(place[kept], place[kept])]
    )


def _estimated(estimate: Estimate) -> tuple[str, ...]:
    """Return the quantities of a rig: a head has a pan zero, relative to the level laser."""
    if estimate.problem.model.pans:
        return RIG_PARAMETERS
    return (*(name for name in RIG_PARAMETERS if name != "pan_offset"), *LEVEL_PARAMETERS)


def columns(layout: Layout) -> dict[str, int]:
    """Return the index of each quantity in the parameter vector."""
    rig = {name: layout.rig.start + i for i, name in enumerate(RIG_PARAMETERS)}
    return rig | {name: layout.level.start + i for i, name in enumerate(LEVEL_PARAMETERS)}


def _quantity(
    name: str, estimate: Estimate, column: int, sigma: float, reasons: Mapping[str, str]
) -> Quantity:
    value = float(estimate.solution.x[column])
    if estimate.free[column]:
        return Quantity(name, value, sigma)
    return Quantity(name, value, None, reasons.get(name, "the recording does not determine it"))


def _without(estimate: Estimate, column: int) -> Estimate:
    free, x = estimate.free.copy(), estimate.solution.x.copy()
    free[column] = False
    rig = estimate.problem.layout.rig
    x[column] = estimate.configured.vector()[column] if column in range(rig.stop) else 0.0
    return estimate.again(free, x)


def _never_free(estimate: Estimate) -> dict[str, str]:
    """Return the reasons why parameters were not estimated at all."""
    unseen = f"no level scans on walls that the tilting laser saw: {ADVICE['level']}"
    return {
        "joint_time_offset": "all tilt cycles go one way at an even speed, where a delay looks "
        f"like a zero: {ADVICE['joint_time_offset']}",
        "height": "the height of the floor in the base frame is not known: give --floor-z"
        if (estimate.problem.plane == FLOOR).any()
        else "no floor was seen",
        "pan_offset": f"no level scans on walls that the camera saw: {ADVICE['pan_offset']}",
        **dict.fromkeys(LEVEL_PARAMETERS, unseen),
    }


def _too_weak(name: str, sigma: float) -> str:
    advice = ADVICE.get("level" if name.startswith("level") else name, "")
    unit, factor = UNITS[name]
    text = f"only known to {sigma * factor:.3g} {unit}".rstrip()
    return f"{text}: {advice}" if advice else text


UNITS: Mapping[str, tuple[str, float]] = {
    "tilt_offset": ("deg", float(np.rad2deg(1.0))),
    "tilt_scale": ("", 1.0),
    "roll": ("deg", float(np.rad2deg(1.0))),
    "pan_offset": ("deg", float(np.rad2deg(1.0))),
    "height": ("mm", 1000.0),
    "joint_time_offset": ("ms", 1000.0),
    "level_x": ("mm", 1000.0),
    "level_y": ("mm", 1000.0),
    "level_yaw": ("deg", float(np.rad2deg(1.0))),
}
"""Display unit of each quantity, and the factor to it."""
