"""What an IMU's roll and pitch are worth where the base stands askew, and whether they harm.

Simulates drives whose base has another roll and pitch at each stop, maps each of them with the IMU
and without, and prints a row for both; asserts nothing. Without more roll and pitch, the two should
be the same but for the noise of the heading.

    python bench/bench_roll_pitch.py [--worlds flat ring] [--stop-tilt 0 0.0087] [--seeds 2]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "helpers")]

from imu_maps import map_with_and_without_imu  # noqa: E402

from tccm_ros.evaluate.surfaces import score_surfaces  # noqa: E402
from tccm_ros.evaluate.trajectory_errors import absolute_errors  # noqa: E402
from tccm_ros.geometry import planar, spatial, transform  # noqa: E402
from tccm_ros.mapping.surface_slam import SurfaceSolution  # noqa: E402
from tccm_ros.results.models import SurfacesFile  # noqa: E402
from tccm_ros.results.numbers import json_text  # noqa: E402
from tccm_sim import truth  # noqa: E402
from tccm_sim.engine import EPOCH_NS, Simulation  # noqa: E402
from tccm_sim.options import Options  # noqa: E402

Array = NDArray[np.float64]

AHEAD = np.array([[3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, -3.0, 0.0]])
"""Points 3 m ahead of a view and to its sides, m: how high are they?"""

HEAD = (
    "| world | tilt at stops, deg | IMU | height at 3 m in views, mm "
    "| heights of surfaces, mm | surfaces | position, mm |"
)


class Outcome(NamedTuple):
    """Errors of one map.

    Attributes
    ----------
    at_3_m
        Heights of `AHEAD` in each view, float64 (3 V,), m.
    heights
        Of the surfaces that were found, float64 (S,), m.
    found, surfaces, false
        Numbers of surfaces.
    position
        Rms of the trajectory after alignment, m.
    """

    at_3_m: Array
    heights: Array
    found: int
    surfaces: int
    false: int
    position: float


def outcome(solution: SurfaceSolution, simulation: Simulation) -> Outcome:
    """Compare a map with the truth of its world."""
    T_map_world = truth.map_from_world(simulation)
    views = (solution.view_stamps_ns - EPOCH_NS) * 1e-9
    off = transform(solution.T_map_views, AHEAD) - transform(
        T_map_world @ simulation.true_poses(views), AHEAD
    )
    with tempfile.TemporaryDirectory() as name:
        found, true = Path(name) / "found.json", Path(name) / "truth.json"
        found.write_text(json_text(SurfacesFile.of(solution.surfaces, solution.floor_z, "map")))
        true.write_text(json.dumps(truth.surfaces(simulation)))
        score = score_surfaces(found, true)
    heights = np.array([m.height_error for m in score.matches if m.is_found])
    times = (solution.trajectory_ns - EPOCH_NS) * 1e-9
    poses = planar(T_map_world @ simulation.true_poses(times))
    errors = absolute_errors(spatial(solution.trajectory), spatial(poses)).translation
    position = float(np.sqrt(np.mean(errors**2)))
    matches = len(score.matches)
    return Outcome(off[..., 2].ravel(), heights, score.found, matches, len(score.false), position)


def run(world: str, seed: int, stop_tilt: float) -> tuple[Outcome, Outcome]:
    """Map a drive with the IMU and without."""
    options = Options(imu=True, stop_tilt=stop_tilt)
    simulation, with_imu, without = map_with_and_without_imu(world, seed, options)
    return outcome(with_imu, simulation), outcome(without, simulation)


def rms_and_largest(errors: Array) -> str:
    """Return rms and largest of errors in m, as text in mm."""
    return f"{1e3 * np.sqrt(np.mean(errors**2)):.1f} / {1e3 * np.abs(errors).max():.1f}"


def row(world: str, stop_tilt: float, imu: str, outcomes: list[Outcome]) -> str:
    """Return a row of the table: all seeds together."""
    found, surfaces, false = (sum(o[k] for o in outcomes) for k in (2, 3, 4))
    position = 1e3 * np.sqrt(np.mean([o.position**2 for o in outcomes]))
    return (
        f"| {world} | {np.rad2deg(stop_tilt):.1f} | {imu} "
        f"| {rms_and_largest(np.concatenate([o.at_3_m for o in outcomes]))} "
        f"| {rms_and_largest(np.concatenate([o.heights for o in outcomes]))} "
        f"| {found} of {surfaces}, {false} false | {position:.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", nargs="+", default=["flat", "ring"])
    parser.add_argument("--stop-tilt", nargs="+", type=float, default=[0.0, 0.0087], help="rad")
    parser.add_argument("--seeds", type=int, default=2)
    arguments = parser.parse_args()
    print(HEAD, "|---" * 7 + "|", sep="\n")
    for world in arguments.worlds:
        for stop_tilt in arguments.stop_tilt:
            outcomes = [run(world, seed, stop_tilt) for seed in range(1, 1 + arguments.seeds)]
            for k, imu in enumerate(("yes", "no")):
                print(row(world, stop_tilt, imu, [pair[k] for pair in outcomes]), flush=True)


if __name__ == "__main__":
    main()
