"""Hours of simulated driving through both processors, as fast as they allow.

    python bench/soak.py [--hours 2] [--tilt] [--report 600]

Prints, for each stretch of simulated time, resident memory, the graph's size, the 99 % and the
longest step, and the time of a solution.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np

from tccm_ros.config import Config
from tccm_ros.pipeline import Pipeline
from tccm_ros.sim.engine import Simulation
from tccm_ros.sim.options import Options
from tccm_ros.sim.worlds import build_world

ROLES = {
    "/scan": "scan",
    "/tilt_scan": "tilt_scan",
    "/odom": "odom",
    "/joint_states": "joint_states",
    "/robot_description": "robot_description",
}
WORLD, LAP_S = "load", 20.0


def memory_mb() -> float:
    """Return the resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--tilt", action="store_true", help="with the tilting laser")
    parser.add_argument("--report", type=float, default=600.0, help="stretch, simulated s")
    arguments = parser.parse_args()
    options = Options(laps=max(1, round(3600.0 * arguments.hours / LAP_S)), tilt=arguments.tilt)
    simulation = Simulation(build_world(WORLD, options), 0, options)
    pipeline = Pipeline(Config(), expects_odometry=True)
    print("| hour | memory | keyframes | 99 % of steps | longest step | solve |")
    print("|---|---|---|---|---|---|")
    steps: list[float] = []
    due_ns = simulation.start_ns + round(arguments.report * 1e9)
    for published in simulation.run():
        role = ROLES.get(published.topic)
        for record in published.records if role else ():
            start = time.perf_counter()
            pipeline.add(role, record)
            steps.append(time.perf_counter() - start)
        if published.log_ns >= due_ns:
            hour = (published.log_ns - simulation.start_ns) / 3.6e12
            due_ns += round(arguments.report * 1e9)
            report(pipeline, hour, steps)
            steps.clear()
            # The pipeline keeps every cycle for the report; a live node does not.
            pipeline.cycles.clear()


def report(pipeline: Pipeline, hour: float, steps: list[float]) -> None:
    before = memory_mb()
    start = time.perf_counter()
    solution = pipeline.solve()
    took = time.perf_counter() - start
    ms = 1e3 * np.array(steps)
    print(
        f"| {hour:.2f} | {before:.0f} MB | {len(solution.slam.keyframes)} | "
        f"{np.quantile(ms, 0.99):.1f} ms | {ms.max():.0f} ms | {took:.2f} s |",
        flush=True,
    )


if __name__ == "__main__":
    main()
