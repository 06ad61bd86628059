"""Time of a solution while driving, against the size of the graph, and how far it is from a batch.

    python bench/bench_growth.py [--keyframes 1000 2000 5000 10000] [--every 50]

Drives the level laser round one room, without end, as `bench/soak.py` does: each keyframe sees
walls that all others see, and every third closes a loop, which is the worst case for a graph.
Solves after each so many keyframes, as slam_node does. At each of the sizes a batch judges: its
time, and how far the last of these solutions has a keyframe from there at most. Times are processor
time; `batches` counts solutions that did not go on from the one before, as after each judgement.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from soak import LAP_S, WORLD, memory_mb

from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams
from tccm_sim.engine import Simulation
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

KEYFRAMES_PER_S = 1.5
"""At least so many are made in this world."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keyframes", type=int, nargs="+", default=[1000, 2000, 5000, 10000])
    parser.add_argument("--every", type=int, default=50, help="keyframes from solution to solution")
    arguments = parser.parse_args()
    sizes = sorted(arguments.keyframes)
    laps = round(sizes[-1] / KEYFRAMES_PER_S / LAP_S) + 1
    options = Options(laps=laps, tilt=False)
    simulation = Simulation(build_world(WORLD, options), 0, options)
    robot = Robot(Config(), default_streams(), expects_odometry=True)
    slam = SurfaceSlam(Config())
    print("| keyframes | solution, median s | longest s | batches | batch s | off mm | off deg |")
    print("|---|---|---|---|---|---|---|", flush=True)
    times: list[float] = []
    batches = solved_at = 0
    for published in simulation.run():
        for record in published.records:
            for event in robot.add(published.topic.lstrip("/"), record):
                slam.add(event)
        count = len(slam.wall_slam._chain.keyframes)
        if count < solved_at + arguments.every:
            continue
        solved_at = count
        elapsed, solution = timed(slam, is_final=False)
        if solution.graph.is_batch:
            batches += 1
        else:
            times.append(elapsed)
        if count >= sizes[0]:
            batch_s, batch = timed(slam, is_final=True)
            print(
                f"| {count} | {np.median(times or [np.nan]):.2f} | {max(times, default=0.0):.2f} | "
                f"{batches} | "
                f"{batch_s:.1f} | {{:.2f}} | {{:.3f}} |".format(*distance(solution, batch)),
                flush=True,
            )
            times, batches = [], 0
            sizes.pop(0)
        if not sizes:
            break
    print(f"\n{memory_mb():.0f} MB")


def timed(slam: SurfaceSlam, *, is_final: bool) -> tuple[float, SurfaceSolution]:
    """Solve; return the processor time as well."""
    start = time.process_time()
    solution = slam.solve(is_final=is_final)
    return time.process_time() - start, solution


def distance(one: SurfaceSolution, other: SurfaceSolution) -> tuple[float, float]:
    """Return how far a keyframe of one solution is from the other at most, mm and deg."""
    poses = [np.array([k.pose for k in s.graph.keyframes]) for s in (one, other)]
    moved = poses[0] - poses[1]
    yaw = np.abs(wrap_angle(moved[:, 2])).max()
    return float(1e3 * np.hypot(moved[:, 0], moved[:, 1]).max()), float(np.degrees(yaw))


if __name__ == "__main__":
    main()
