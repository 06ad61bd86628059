"""Is what is left after calibration a fault of the rig that is not among the parameters?

python bench/calibration_faults.py --floor-z -0.3 BAG[,BAG...] BAG[,BAG...] ...

Bags that are joined by commas are of one room. Each fault is one more number that is fitted to the
calibrated hits on floor, ceiling and walls (linearised, with the same weights and the same trust in
buildings). A fault of the rig is the same in all rooms, and what the other rooms give makes a room
flatter that had no part in it. Printed are the value that all rooms give, how much they disagree,
and what the value of the other rooms does to the sum of squares on floor, ceiling and walls of each
room left out (summed over rooms, in variances: -10 is a clear gain), and to the angle between its
floor and ceiling.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tccm_ros.calibrate.calibration import calibrate
from tccm_ros.calibrate.estimate import Estimate
from tccm_ros.calibrate.model import CycleBeams, RigValues
from tccm_ros.calibrate.quality import HitMasks, flatness
from tccm_ros.calibrate.room import hits_of_bag
from tccm_ros.calibrate.surroundings import CEILING, FLOOR

Float64 = NDArray[np.float64]

#: Hits (N, 3) in the laser's frame and tilts (N,) -> their shifts (N, 3) and turns (N,) per unit.
Fault = Callable[[Float64, Float64], tuple[Float64, Float64]]

UP = np.array([0.0, 0.0, 1.0])

#: Standard deviation of a fault before anything is seen, so that what nothing shows stays small.
WIDE = 0.05

#: Standard deviation of free roll, pitch and angles of walls, rad.
FREE = 0.5

STEP = 1e-5


def shift(direction: Callable[[Float64, Float64, Float64], Float64]) -> Fault:
    """Return a fault that moves hits; `direction` takes hits, ranges and bearings."""

    def fault(points: Float64, tilt: Float64) -> tuple[Float64, Float64]:
        r, bearing = np.linalg.norm(points, axis=1), np.arctan2(points[:, 1], points[:, 0])
        return direction(points, r, bearing), np.zeros(len(tilt))

    return fault


def joint_error(angle: Callable[[Float64], Float64]) -> Fault:
    """Return a fault of the joint; `angle` takes tilts."""
    return lambda points, tilt: (np.zeros_like(points), angle(tilt))


def skew(points: Float64, tilt: Float64) -> tuple[Float64, Float64]:
    """Return the turn of a laser that tilts during a scan that takes longer or shorter."""
    return np.zeros_like(points), np.arctan2(points[:, 1], points[:, 0])


FAULTS: dict[str, Fault] = {
    "arm along the beam, m": shift(lambda p, r, b: np.tile([1.0, 0.0, 0.0], (len(p), 1))),
    "arm across the scan plane, m": shift(lambda p, r, b: np.tile(UP, (len(p), 1))),
    "range error per m2": shift(lambda p, r, b: p * r[:, None]),
    "bearing offset (yaw on the plate)": shift(lambda p, r, b: np.cross(UP, p)),
    "bearing scale": shift(lambda p, r, b: np.cross(UP, p) * b[:, None]),
    "bearing, sin 2b": shift(lambda p, r, b: np.cross(UP, p) * np.sin(2 * b)[:, None]),
    "cone angle": shift(lambda p, r, b: r[:, None] * UP),
    "roll on the plate": shift(lambda p, r, b: (r * np.sin(b))[:, None] * UP),
    "mirror wobble, cos 2b": shift(lambda p, r, b: (r * np.cos(2 * b))[:, None] * UP),
    "mirror wobble, sin 2b": shift(lambda p, r, b: (r * np.sin(2 * b))[:, None] * UP),
    "time within a scan": skew,
    "joint, t^2": joint_error(lambda t: t**2),
    "joint, t^3": joint_error(lambda t: t**3),
    **{
        f"joint, {name} {k}t": joint_error(lambda t, f=f, k=k: f(k * t))  # type: ignore[misc]
        for k in (1, 2, 4, 8)
        for name, f in (("sin", np.sin), ("cos", np.cos))
    },
}


@dataclass
class Recording:
    """A calibrated recording: its problem at the minimum, and a column for each fault."""

    estimate: Estimate
    columns: dict[str, Float64]
    beams: CycleBeams
    seen: HitMasks

    @classmethod
    def of(cls, bag: str, floor_z: float | None) -> Recording:
        """Calibrate, and say how each fault would move what is left of each hit."""
        found = calibrate(bag, floor_z=floor_z)
        estimate = found.observability.estimate
        problem, values, lin = estimate.problem, estimate.values, estimate.solution.linearised
        by_rig = lin.jacobian[:, problem.layout.rig.start]  # by the zero: per rad of tilt
        normals, tilt, columns = _normals(estimate), tilts(estimate, problem.hits), {}
        for name, fault in FAULTS.items():
            moved, turned = fault(problem.hits.points, tilt)
            across = np.sum(
                normals * problem.model.transform_directions(problem.hits, values, moved), axis=1
            )
            columns[name] = across / lin.sigma + by_rig * turned
        return cls(estimate, columns, *hits_of_bag(found.observability, found.recording, 0))

    def fit(
        self, fault: str | None, given: float | None = None, sigmas: Float64 | None = None
    ) -> tuple[Float64, float, float]:
        """Return all parameters, the fault's value and its standard deviation; it may be given.

        `sigmas` are the priors, if they are to be others than those that count.
        """
        estimate = self.estimate
        solution, lin, free = estimate.solution, estimate.solution.linearised, estimate.free
        weights = solution.weights / solution.scale**2
        means, sigmas = estimate.means, estimate.sigmas if sigmas is None else sigmas
        J, r = lin.jacobian[:, free], lin.residuals
        precision, off = 1.0 / sigmas[free] ** 2, (solution.x - means)[free]
        if fault is not None and given is None:
            J = np.column_stack([J, self.columns[fault]])
            precision, off = np.append(precision, WIDE**-2), np.append(off, 0.0)
        elif fault is not None and given is not None:
            r = r + given * self.columns[fault]
        H = J.T @ (weights[:, None] * J) + np.diag(precision)
        size = np.sqrt(np.diag(H))
        inverse = np.linalg.pinv(H / np.outer(size, size), hermitian=True) / np.outer(size, size)
        step = -inverse @ (J.T @ (weights * r) + precision * off)
        cluster = np.unique(lin.cluster, return_inverse=True)[1]
        gradients = np.zeros((int(cluster.max()) + 1, J.shape[1]))
        np.add.at(gradients, cluster, (weights * lin.residuals)[:, None] * J)
        spread = inverse @ (gradients.T @ gradients + np.diag(precision)) @ inverse
        x = solution.x.copy()
        x[free] += step[: int(free.sum())]
        if fault is None or given is not None:
            return x, given or 0.0, 0.0
        return x, float(step[-1]), float(np.sqrt(max(spread[-1, -1], inverse[-1, -1])))

    def untrusting(self) -> Float64:
        """Return priors under which bases, walls and ceilings may have any roll and pitch."""
        layout, sigmas = self.estimate.problem.layout, self.estimate.sigmas.copy()
        sigmas[layout.ceiling(0)][1:] = FREE
        for number in range(layout.walls):
            sigmas[layout.wall(number).stop - 1] = FREE
        for place in range(layout.places):
            sigmas[layout.roll_pitch(place)] = FREE
        return sigmas

    def squares(self, x: Float64, fault: str | None, value: float) -> Float64:
        """Return the sums of squares on floor, ceiling and walls, float64 (3,)."""
        solution, plane = self.estimate.solution, self.estimate.problem.plane
        lin = solution.linearised
        r = lin.residuals + lin.jacobian @ (x - solution.x)
        if fault is not None:
            r = r + value * self.columns[fault]
        terms = solution.weights / solution.scale**2 * r**2
        kinds = (plane == FLOOR, plane == CEILING, plane > CEILING)
        return np.array([terms[kind].sum() for kind in kinds])

    def parallel(self, x: Float64, fault: str | None, value: float) -> float:
        """Return the angle between floor and ceiling of all hits, deg; nan where one is gone."""
        model = self.estimate.problem.model
        values = RigValues.of_vector(x[self.estimate.problem.layout.rig])
        points = model.transform_points(self.beams, values)
        if fault is not None:
            more = replace(values, tilt_offset=values.tilt_offset + STEP)
            by_tilt = (model.transform_points(self.beams, more) - points) / STEP
            moved, turned = FAULTS[fault](self.beams.points, tilts(self.estimate, self.beams))
            by_fault = (
                model.transform_directions(self.beams, values, moved) + by_tilt * turned[:, None]
            )
            points = points + value * by_fault
        floor, ceiling = flatness(points[self.seen.floor]), flatness(points[self.seen.ceiling])
        if floor is None or ceiling is None:
            return float("nan")
        return float(np.rad2deg(np.arccos(min(np.dot(floor.normal, ceiling.normal), 1.0))))


def tilts(estimate: Estimate, beams: CycleBeams) -> Float64:
    """Return the calibrated tilt of each beam, rad."""
    values = estimate.values
    measured = estimate.problem.model.measured(beams, values)
    result: Float64 = values.tilt_scale * measured + values.tilt_offset
    return result


def _normals(estimate: Estimate) -> Float64:
    """Return the normal of each hit's plane, float64 (N, 3)."""
    problem = estimate.problem
    planes = problem.planes(estimate.solution.x)
    rows = {
        (int(number), int(place)): row
        for row, (number, place) in enumerate(zip(planes.number, planes.place))
    }
    keys = zip(problem.plane.tolist(), problem.place.tolist())
    index = [rows[(n, p)] if (n, p) in rows else rows[(n, -1)] for n, p in keys]
    return planes.normals[index]


def left_out(fault: str, rooms: list[list[Recording]]) -> str:
    """Return one line of the table."""
    fits = [[one.fit(fault) for one in room] for room in rooms]
    values = np.array([np.mean([fit[1] for fit in room]) for room in fits])
    sigmas = np.array([np.mean([fit[2] for fit in room]) for room in fits])
    weights = 1.0 / sigmas**2
    mean = float(np.average(values, weights=weights))
    chi_square = float(np.sum(weights * (values - mean) ** 2))
    change, after = np.zeros(3), []
    for left, room in enumerate(rooms):
        others = np.arange(len(rooms)) != left
        given = float(np.average(values[others], weights=weights[others]))
        for one in room:
            x, x_given = one.fit(None)[0], one.fit(fault, given)[0]
            squares = one.squares(x_given, fault, given) - one.squares(x, None, 0.0)
            change += squares / len(room)
            after.append(one.parallel(x_given, fault, given))
    cells = [f"{mean:+.4f} ± {weights.sum() ** -0.5:.4f}", f"{chi_square:.1f}"]
    cells += [f"{value:+.0f}" for value in change]
    cells += [" ".join(f"{angle:.2f}" for angle in after)]
    return f"| {fault} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rooms", nargs="+", metavar="BAG[,BAG...]")
    parser.add_argument("--floor-z", type=float, default=None)
    arguments = parser.parse_args()
    rooms = [
        [Recording.of(bag, arguments.floor_z) for bag in room.split(",")]
        for room in arguments.rooms
    ]
    print(f"| fault | value | disagreement of {len(rooms)} rooms | floors | ceilings | walls | "
          "floor and ceiling, deg |\n|---|---|---|---|---|---|---|")  # fmt: skip
    every = [one for room in rooms for one in room]
    for name, fits in (
        ("none", [one.fit(None) for one in every]),
        (
            "none; walls vertical, ceiling horizontal",
            [one.fit(None, None, one.estimate.strict) for one in every],
        ),
        ("none; all roll and pitch free", [one.fit(None, None, one.untrusting()) for one in every]),
    ):
        angles = [one.parallel(fit[0], None, 0.0) for one, fit in zip(every, fits)]
        print(f"| {name} | - | - | - | - | - | {' '.join(f'{a:.2f}' for a in angles)} |")
    for fault in FAULTS:
        print(left_out(fault, rooms), flush=True)


if __name__ == "__main__":
    main()
