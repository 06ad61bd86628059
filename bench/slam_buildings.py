"""Whole runs in simulated buildings that are hard to map, with and without walls.

Stand-ins for logs that are not here: identical offices, a court of several hundred metres, crossing
corridors behind glass, a campus, plain corridors. Usage: python bench/slam_buildings.py
[BUILDING ...] [--robots NAME ...] [--seeds N] [--first SEED] [--layouts] [--walls]. Prints a table
of the rms error after alignment and of the mean error over pairs of poses at a distance below 3 m
with more than 10 m of path between them; asserts nothing.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np
from bench_slam import HERE

from tccm_ros.config import Config
from tccm_ros.evaluate.trajectory_errors import (
    absolute_errors,
    pairs_that_meet,
    relation_errors,
)
from tccm_ros.geometry import inverse, planar, spatial
from tccm_ros.slam.wall_slam import WallSlam

sys.path.insert(0, str(HERE.parent / "test" / "helpers"))
import buildings
import plan

BUILDINGS = {
    "offices": lambda: buildings.offices(),
    "mixed offices": lambda: buildings.offices(alike=False),
    "block": lambda: buildings.block(),
    "glass block": lambda: buildings.block(glass=0.6),
    "court": lambda: buildings.court(),
    "large court": lambda: buildings.court(220.0, 60.0),
    "rooms": lambda: buildings.rooms(),
    "alike rooms": lambda: buildings.rooms(spread=0.03, seed=1),
    "campus": lambda: buildings.campus(),
    "plain block": lambda: buildings.plain_block(),
    "row of loops": lambda: buildings.row_of_loops(),
}

DRAWN = {
    "rooms": lambda seed: buildings.rooms(seed=seed),
    "campus": lambda seed: buildings.campus(seed=seed),
    "plain block": lambda seed: buildings.plain_block(seed=seed),
    "row of loops": lambda seed: buildings.row_of_loops(seed=seed),
}
"""Buildings whose layout `--layouts` draws with the seed."""

MAX_ROWS = 700
"""Poses of which pairs are compared: a relation each few scans."""

HEAD = (
    f"{'building':14} {'robot':13} {'seed':>4} {'walls':5} {'path':>6} {'scans':>6} "
    f"{'odometry':>8} {'rms, m':>7} {'deg':>6} {'pairs m':>8} {'deg':>6} "
    f"{'loops':>6} {'wrong':>6} {'CPU s':>6}"
)


def bench(name: str, robot: str, walls: bool, seed: int, drawn: bool) -> None:
    building = DRAWN[name](seed) if drawn and name in DRAWN else BUILDINGS[name]()
    run = buildings.drive(building, buildings.ROBOTS[robot], seed=seed)
    config = Config()
    config.walls.enabled = walls
    start = time.process_time()
    slam = WallSlam(config)
    for scan in run.scans:
        slam.add_scan(scan)
    solution = slam.solve()
    seconds = time.process_time() - start
    odometry = planar(np.concatenate([s.T_odom_base for s in run.scans]))
    path = np.hypot(*np.diff(run.truth[:, :2], axis=0).T).sum()
    absolute = absolute_errors(spatial(solution.poses), spatial(run.truth))
    rms, angle = (np.sqrt(np.mean(e**2)) for e in (absolute.translation, absolute.rotation))
    rows = slice(None, None, 1 + len(run.truth) // MAX_ROWS)
    truth, found = spatial(run.truth[rows]), spatial(solution.poses[rows])
    i, j = pairs_that_meet(truth[:, :3, 3]).T
    pairs = relation_errors(found[i], found[j], inverse(truth[i]) @ truth[j])
    accepted, wrong = buildings.loops_of(run, solution)
    print(
        f"{name:14} {robot:13} {seed:4d} {'on' if walls else 'off':5} {path:6.0f} "
        f"{len(run.scans):6d} {plan.errors(run.truth, odometry)[0]:8.1f} "
        f"{rms:7.3f} {np.degrees(angle):6.3f} {pairs.translation.mean():8.4f} "
        f"{np.degrees(pairs.rotation.mean()):6.3f} {accepted:6d} {wrong:6d} {seconds:6.1f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("buildings", nargs="*", default=list(BUILDINGS), help=", ".join(BUILDINGS))
    parser.add_argument("--robots", nargs="*", default=list(buildings.ROBOTS))
    parser.add_argument("--seeds", type=int, default=1, help="runs of each")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--layouts", action="store_true", help="another layout with each seed")
    parser.add_argument("--walls", action="store_true", help="no runs without walls")
    options = parser.parse_args()
    print(HEAD)
    for name in options.buildings:
        for robot in options.robots:
            for seed in range(options.first, options.first + options.seeds):
                for walls in (True,) if options.walls else (True, False):
                    bench(name, robot, walls, seed, options.layouts)


if __name__ == "__main__":
    main()
