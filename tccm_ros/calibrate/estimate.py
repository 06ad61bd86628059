"""Estimate the rig from a recording: first guess, plane search, refinement with narrowing gates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.calibrate.assignment import assigned, determinable
from tccm_ros.calibrate.layout import AssumptionSigmas, Layout
from tccm_ros.calibrate.model import RigModel, RigValues
from tccm_ros.calibrate.patches import Patches, cut_patches
from tccm_ros.calibrate.problem import Problem
from tccm_ros.calibrate.recording import CalibrationRecording
from tccm_ros.calibrate.search import first_guess
from tccm_ros.calibrate.solver import SolverResult, covariance, solve
from tccm_ros.calibrate.surroundings import RoomPlanes, find_planes
from tccm_ros.config import Config
from tccm_ros.errors import BagError
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.progress import Bars

GATES = tuple(
    (distance, float(np.deg2rad(angle)))
    for distance, angle in ((0.30, 12.0), (0.15, 8.0), (0.08, 5.0), (0.05, 3.5), (0.03, 2.5),
                            (0.03, 2.5))
)  # fmt: skip
"""Maximum distance (m) and angle (rad) of a patch to its plane in each round (chosen: halved until
the noise of patches limits them)."""

STRICT_FACTOR = 0.05
"""Factor on the standard deviations of vertical walls and horizontal ceilings in the solver
(chosen)."""

ROUGH_GATE = 0.1
"""Gate, m, above which scale, time offset and range bias are fixed (chosen: furniture that is taken
for floor or wall would bias them)."""

SEARCHES = 3
"""Number of first rounds with a new search for planes (chosen)."""

LEVEL_GATES = (0.30, 0.15, 0.10, 0.06, 0.04, 0.04)
"""Maximum distance of a level laser hit to its wall in each round, m (chosen, as `GATES`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The solution of the least-squares problem, with the problem and its priors.

    Attributes
    ----------
    problem, solution
        The least-squares problem and its solution.
    free
        bool (P,), mask of the estimated parameters.
    means, sigmas
        float64 (P,), means and standard deviations of the priors.
    strict
        float64 (P,), standard deviations used in the solver: walls vertical and ceilings
        horizontal, so that tilted walls cannot compensate a wrong scale. The covariance uses their
        real tolerance (`sigmas`).
    configured
        The configured rig.
    """

    problem: Problem
    solution: SolverResult
    free: Bool
    means: Float64
    sigmas: Float64
    strict: Float64
    configured: RigValues

    @property
    def values(self) -> RigValues:
        """The estimated rig."""
        return RigValues.of_vector(self.solution.x[self.problem.layout.rig])

    @property
    def covariance(self) -> Float64:
        """Covariance of the free parameters, float64 (F, F)."""
        return covariance(self.solution, self.free, self.sigmas)

    @property
    def standard_deviations(self) -> Float64:
        """Standard deviations of all parameters, float64 (P,); NaN for those that are not free."""
        found = np.full(len(self.free), np.nan)
        found[self.free] = np.sqrt(np.diag(self.covariance))
        return found

    def again(self, free: Bool, x: Float64) -> Estimate:
        """Return a solution with other free parameters."""
        solution = solve(self.problem, x, free, self.means, self.strict)
        return replace(self, solution=solution, free=free)


def estimate(
    recording: CalibrationRecording,
    config: Config,
    floor_z: float | None,
    assumed: AssumptionSigmas,
    bars: Bars | None = None,
) -> Estimate:
    """Return the estimate of all observable parameters.

    Parameters
    ----------
    recording
        Scans of one or several bags.
    config
        The configured rig.
    floor_z
        Height of the floor in the base frame, m; None if unknown.
    assumed
        Standard deviations of the assumptions.
    bars
        Progress bars.

    Raises
    ------
    BagError
        Where no floor, ceiling or wall was observed.
    """
    bars = bars or Bars()
    bars.start("estimate", len(GATES) + 1.0)
    model = RigModel(recording.cycles, config.rig)
    configured = RigValues.of_rig(config.rig)
    values = first_guess(recording.cycles, model, configured)
    patches = cut_patches(dict(enumerate(recording.cycles)), model, values)
    refiner = _Refinement(recording, model, patches, config, floor_z, assumed, configured, values)
    bars.advance(1.0)
    level = np.zeros(3)
    found: Estimate | None = None
    for number, gates in enumerate(GATES):
        if found is None or number < SEARCHES:
            surroundings = refiner.search(values)
            x = None
        else:
            x = found.solution.x
        found = refiner.refine(surroundings, values, level, x, gates, LEVEL_GATES[number])
        values, level = found.values, found.solution.x[found.problem.layout.level]
        bars.advance(1.0)
    assert found is not None
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Refinement:
    recording: CalibrationRecording
    model: RigModel
    patches: Patches
    config: Config
    floor_z: float | None
    assumed: AssumptionSigmas
    configured: RigValues
    guess: RigValues

    @property
    def places(self) -> Int64:
        return self.recording.places[self.patches.centers.cycle]

    def search(self, values: RigValues) -> RoomPlanes:
        """Return the planes under given rig parameters."""
        at = self.patches.centers
        centers = self.model.transform_points(at, values)
        normals = self.model.transform_directions(at, values, self.patches.normals)
        found = find_planes(
            centers, normals, self.places, self.recording.bag, float(self.model.pivot[2])
        )
        levels = (found.floor, *found.ceilings)
        if all(height is None for height in levels) and not found.walls:
            raise BagError("neither floor, ceiling nor walls were seen; record a room")
        return found

    def refine(
        self,
        surroundings: RoomPlanes,
        values: RigValues,
        level: Float64,
        x: Float64 | None,
        gates: tuple[float, float],
        level_gate: float,
    ) -> Estimate:
        """Assign patches to planes and solve."""
        rec = self.recording
        layout = Layout(len(rec.bags), len(surroundings.walls), len(rec.bag))
        problem = Problem(
            self.model, self.patches.hits, self.patches.patch, self.places, rec.bag, rec.poses,
            surroundings, (), pose_from_rpy(self.config.rig.level_correction), self.assumed, layout,
            blur=gates[0] / 6.0,
        )  # fmt: skip
        if x is None:
            x = problem.start(values, level)
            if self.floor_z is not None and surroundings.floor is not None:
                x[layout.rig.start + 3] += self.floor_z - surroundings.floor
                x[layout.floor] = self.floor_z
        problem = assigned(problem, x, rec, self.patches, gates, level_gate)
        rough = gates[0] > ROUGH_GATE
        means, sigmas = problem.priors(self.guess)
        strict = problem.priors(self.guess, STRICT_FACTOR)[1]
        if self.floor_z is not None:
            means[layout.floor], sigmas[layout.floor] = self.floor_z, self.assumed.floor
            strict[layout.floor] = self.assumed.floor
        free = determinable(problem, values, floor_is_known=self.floor_z is not None)
        if rough:
            free[[layout.rig.start + 1, layout.rig.start + 4, layout.bias]] = False
        solution = solve(problem, x, free, means, strict)
        return Estimate(problem, solution, free, means, sigmas, strict, self.configured)
