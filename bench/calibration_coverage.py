"""Errors of calibrations of simulated rigs, against their covariances and the Cramer-Rao bound.

python bench/calibration_coverage.py [--seeds 20] [--case NAME ...]

Each case is simulated and calibrated with many seeds of noise. Printed are the mean and the rms of
the errors, the stated standard deviation, and the Cramer-Rao bound: the min standard deviation
of any unbiased estimator that knows that the base is horizontal, walls vertical, the
ceiling horizontal and ranges unbiased, and that uses every hit on the planes with its independent
noise. The stated covariance also covers what a simulation does not vary (a tilted base, a floor
that is not flat), and is larger.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tccm_ros.calibrate.calibration import Calibration, calibrate
from tccm_ros.calibrate.model import RIG_PARAMETERS
from tccm_ros.calibrate.observability import UNITS
from tccm_ros.calibrate.problem import Problem
from tccm_ros.calibrate.quality import all_beams
from tccm_sim.options import Options
from tccm_sim.recording import simulate

Float64 = NDArray[np.float64]

SIGMA = 0.006
"""Range noise, m."""

ERRORS = {
    "tilt_offset": 0.14, "tilt_scale": 0.965, "laser_roll": 0.02, "laser_height": 0.03,
    "joint_time_offset": 0.012,
}  # fmt: skip
IN_THE_WAY = {"clutter": 40, "ramp": True, "people": True}

CASES = {
    "all errors": ERRORS,
    "clutter, ramp, person": ERRORS | IN_THE_WAY,
    "base tilted by 0.07 deg": ERRORS | {"base_tilt": 1.0},
    "floor from 2 m": ERRORS | IN_THE_WAY | {"tilt_limits": (-0.9, 0.3)},
    "floor from 3 m, clutter, ramp, person": ERRORS | IN_THE_WAY | {"tilt_limits": (-0.9, 0.2)},
    "floor from 3 m": ERRORS | {"tilt_limits": (-0.9, 0.2)},
}

#: The option of the simulator that is the truth of a quantity.
TRUTH = {"roll": "laser_roll", "height": "laser_height"}

#: Known to the bound: standard deviations of what it is told, rad and m.
EXACT = 1e-6

#: A hit this near a plane is on it, m; beams that graze a plane count as if they met it at this
#: cosine at least.
NEAR, GRAZING = 0.03, 0.02


def run(options: dict[str, object], seed: int, folder: Path) -> Calibration:
    """Simulate and calibrate."""
    usual = {
        "tilt_beams": 181,
        "sigma": SIGMA,
        "cycle_period": 2.0,
        "base_tilt": 0.0,
        "people": False,
    }
    settings = usual | options
    simulate("room", folder, seed=seed, options=Options.model_validate(settings), overwrite=True)
    return calibrate(folder, floor_z=0.0)


def bound(found: Calibration) -> Float64:
    """Return the least standard deviations of the rig's parameters, float64 (5,); nan if fixed."""
    estimate = found.observability.estimate
    problem, x, free = estimate.problem, estimate.solution.x, estimate.free.copy()
    layout = problem.layout
    told = [layout.bias, layout.floor]
    told += [
        i for place in range(layout.places) for i in range(layout.size)[layout.roll_pitch(place)]
    ]
    told += [layout.wall(number).stop - 1 for number in range(layout.walls)]
    free[told] = False
    lin = problem.linearise(x)
    mine = lin.cluster >= 0  # the others are of the level laser
    J = (lin.jacobian * lin.sigma[:, None])[mine]
    cosine = np.maximum(np.abs(J[:, layout.bias]), GRAZING)
    weights = _all_of_used(found, problem, x)[problem.plane] / (SIGMA * cosine) ** 2
    sigmas = np.full(layout.size, np.inf)
    sigmas[[*_slopes(problem)]] = EXACT
    kept = J[:, free]
    H = kept.T @ (weights[:, None] * kept) + np.diag(1.0 / sigmas[free] ** 2)
    size = np.sqrt(np.maximum(np.diag(H), 1e-30))
    variances = np.diag(np.linalg.pinv(H / np.outer(size, size), hermitian=True)) / size**2
    result = np.full(layout.size, np.nan)
    result[free] = np.sqrt(variances)
    return result[layout.rig]


def _slopes(problem: Problem) -> list[int]:
    """Return the columns of the ceilings' slopes."""
    layout = problem.layout
    return [i for bag in range(layout.bags) for i in range(layout.size)[layout.ceiling(bag)][1:]]


def _all_of_used(found: Calibration, problem: Problem, x: Float64) -> Float64:
    """Return how many hits lie on each plane for one that was used, float64 (Q,)."""
    beams = all_beams(found.recording.cycles)
    points = problem.model.transform_points(beams, found.observability.estimate.values)
    place = found.recording.places[beams.cycle]
    planes = problem.planes(x)
    ratios = np.ones(int(planes.number.max()) + 1)
    for number in range(len(ratios)):
        used = int((problem.plane == number).sum())
        near = 0
        for row in np.flatnonzero(planes.number == number):
            here = (planes.place[row] == place) | (planes.place[row] == -1)
            off = points[here] @ planes.normals[row] - planes.offsets[row]
            near += int((np.abs(off) < NEAR).sum())
        ratios[number] = max(near / used, 1.0) if used else 1.0
    return ratios


def report(name: str, found: list[Calibration], options: dict[str, object]) -> None:
    """Print one line for each quantity of the tilting laser."""
    bounds = np.array([bound(one) for one in found])
    usual = {"tilt_scale": 1.0}
    for i, quantity in enumerate(RIG_PARAMETERS):
        truth = float(options.get(TRUTH.get(quantity, quantity), usual.get(quantity, 0.0)))  # type: ignore[arg-type]
        seen = [one.observability.quantities[i] for one in found]
        errors = np.array([q.value - truth for q in seen if q.sigma is not None])
        sigmas = np.array([q.sigma for q in seen if q.sigma is not None])
        if len(errors) == 0:
            print(f"| {name} | {quantity} | 0 of {len(seen)} | - | - | - | - | - | - |", flush=True)
            continue
        unit, factor = UNITS[quantity]
        rms, stated = np.sqrt(np.mean(errors**2)), np.sqrt(np.mean(sigmas**2))
        bound_sigma = float(np.nanmean(bounds[:, i]))
        cells = [np.mean(errors), rms, np.abs(errors).max(), stated, bound_sigma]
        shown = " | ".join(f"{value * factor:.4f}" for value in cells)
        print(
            f"| {name} | {quantity}{', ' + unit if unit else ''} | {len(errors)} of {len(seen)} | "
            f"{shown} | {np.sqrt(np.mean((errors / sigmas) ** 2)):.2f} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--case", action="append", choices=CASES)
    arguments = parser.parse_args()
    print("| case | quantity | determined | mean error | rms error | largest | stated | bound | "
          "rms of error / stated |\n|---|---|---|---|---|---|---|---|---|")  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.case or CASES:
            options = CASES[name]
            found = [run(options, seed, Path(folder) / "bag") for seed in range(arguments.seeds)]
            report(name, found, options)


if __name__ == "__main__":
    main()
