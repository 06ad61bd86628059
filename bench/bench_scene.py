"""Planning scenes of random flats against the true solids, by an arm at random.

Usage: python bench/bench_scene.py [--seeds 4] [--sensors laser camera]

A hand and a forearm are placed near each solid and each shape, and a collision library (coal, which
pin installs) measures their distances from both. `outside`: how deep they are in a solid where the
scene has nothing; `lost`: how deep in a shape where there is no solid. `seen points`: how far
visible points of the solids are outside of the scene. The solids are those whose tops the map
has, and objects in it.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "test" / "helpers")]

from random_flats import random_flat  # noqa: E402
from sampled_arm import (  # noqa: E402
    clearances,
    mapped_solids,
    placed_shapes,
    placed_solids,
    seen_outside,
)
from sensor_sight import Sight  # noqa: E402

from tccm_ros.arrays import Float64  # noqa: E402
from tccm_ros.config import Config  # noqa: E402
from tccm_ros.replay.run import run_bag  # noqa: E402
from tccm_ros.scene.planning_shapes import scene_shapes  # noqa: E402
from tccm_sim.engine import Simulation  # noqa: E402
from tccm_sim.options import Options  # noqa: E402
from tccm_sim.recording import record  # noqa: E402
from tccm_sim.truth import map_from_world  # noqa: E402

SENSORS = {"laser": Options(), "camera": Options(robot="fetch")}

STOPS = slice(0, 5)
"""Stops of the robot in each flat: the first two rooms."""

ARMS = 2000
"""Arms for each row and flat."""

POINTS = 400
"""Points on each solid."""

BOARD = 0.06
"""A solid of furniture that is thicker has a body below its top, m."""

BOUND = 0.015
"""The bound of both errors, m."""

Depths = dict[str, Float64]


def measure(seed: int, sensor: str) -> Depths:
    """Return the depths of links by row, m."""
    options = SENSORS[sensor]
    world = random_flat(seed, options, stops=STOPS)
    simulation = Simulation(world, seed, options)
    config = Config()
    surfaces = config.surfaces.model_copy(update={"unseen_space": True})
    config = config.model_copy(update={"surfaces": surfaces})
    with tempfile.TemporaryDirectory() as folder:
        bag = record(simulation, Path(folder) / "bag")
        outcome = run_bag(bag, config)
    solution = outcome.solution
    T, solids = map_from_world(simulation), world.scene.solids
    contents = solution.surfaces, solution.objects, solution.compartments
    known = placed_shapes(scene_shapes(*contents))
    careful = placed_shapes(scene_shapes(*contents, solution.unseen))
    furniture, objects = mapped_solids(solids, T, solution.surfaces, solution.objects)
    boards = [s for s in furniture if 2 * s.half[2] < BOARD]
    rows = {}
    for name, scene, chosen in (
        ("outside: boards and tops", known, boards),
        ("outside: furniture, with unseen space", careful, furniture),
        ("outside: objects", known, objects),
    ):
        if chosen:
            true = placed_solids(chosen, T)
            rows[name] = clearances(scene, true, true, ARMS).outside()
    sight = Sight(world, options, seed, outcome, T)
    for name, chosen in (("seen points: boards, tops", boards), ("seen points: objects", objects)):
        if chosen:
            rows[name] = seen_outside(chosen, known, sight, T, POINTS)
    every = placed_solids([s for s in solids if s.role != "ceiling"], T)
    for name, shapes in (
        ("lost: surfaces", scene_shapes(solution.surfaces, [])),
        ("lost: panels", {k: s for k, s in scene_shapes(*contents).items() if "rack" in k}),
        ("lost: objects", scene_shapes([], solution.objects)),
    ):
        if shapes:
            scene = placed_shapes(shapes)
            rows[name] = clearances(scene, every, scene, ARMS).lost()
    return rows


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
    args = parser.parse_args()
    print("| sensor | links | count | within 15 mm | 99 %, mm | deepest, mm |")
    print("|---|---|---|---|---|---|")
    for sensor in args.sensors:
        rows: dict[str, list[Float64]] = {}
        for seed in range(args.seeds):
            for name, depths in measure(seed, sensor).items():
                rows.setdefault(name, []).append(depths)
        for name, parts in rows.items():
            mm, bound = 1000.0 * np.concatenate(parts), 1000.0 * BOUND
            print(
                f"| {sensor} | {name} | {len(mm)} | {(mm <= bound).mean():.2%} "
                f"| {np.quantile(mm, 0.99):.0f} | {mm.max():.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
