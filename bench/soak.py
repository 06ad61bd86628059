"""Hours of simulated driving through the processors as the nodes use them, as fast as they allow.

    python bench/soak.py [--hours 2] [--tilt] [--report 600]

Prints, for each stretch of simulated time, resident memory, the graph's size, the 99 % and the
longest step (processor time), the time of a solution as the SLAM node makes it while driving, and
how long another thread stood still meanwhile: gtsam holds the interpreter, and the intake of
messages is such a thread.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
from pathlib import Path

import numpy as np

from tccm_ros.config import Config
from tccm_ros.mapping.tccm import TccmProcessor
from tccm_ros.sim.engine import Simulation
from tccm_ros.sim.options import Options
from tccm_ros.sim.worlds import build_world
from tccm_ros.surfaces.surface_slam import SurfaceSlam

TCCM_TOPICS = ("/tilt_scan", "/odom", "/joint_states", "/robot_description")
SLAM_TOPICS = ("/scan", "/odom", "/joint_states", "/robot_description")
WORLD, LAP_S = "load", 20.0
TICK_S = 0.001


class Standstill:
    """Measures the longest time for which a thread that wants to run could not."""

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        before = time.perf_counter()
        while not self._done.is_set():
            time.sleep(TICK_S)
            now = time.perf_counter()
            self.longest_s = max(self.longest_s, now - before - TICK_S)
            before = now

    def __enter__(self) -> Standstill:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()


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
    tccm = TccmProcessor(Config(), expects_odometry=True)
    slam = SurfaceSlam(Config(), expects_odometry=True)
    print("| hour | memory | keyframes | 99 % of steps | longest step | solve | stood still |")
    print("|---|---|---|---|---|---|---|", flush=True)
    steps: list[float] = []
    due_ns = simulation.start_ns + round(arguments.report * 1e9)
    for published in simulation.run():
        for record in published.records:
            start = time.process_time()
            if arguments.tilt and published.topic in TCCM_TOPICS:
                for result in tccm.add(record):
                    slam.add(result.surfaces)
                    slam.add(result.view)
            if published.topic in SLAM_TOPICS:
                slam.add(record)
            steps.append(time.process_time() - start)
        if published.log_ns >= due_ns:
            report(slam, (published.log_ns - simulation.start_ns) / 3.6e12, steps)
            due_ns += round(arguments.report * 1e9)
            steps.clear()


def report(slam: SurfaceSlam, hour: float, steps: list[float]) -> None:
    memory, start = memory_mb(), time.process_time()
    with Standstill() as standstill:
        solution = slam.solve(every_covariance=False)
    took = time.process_time() - start
    ms = 1e3 * np.array(steps)
    print(
        f"| {hour:.2f} | {memory:.0f} MB | {len(solution.slam.keyframes)} | "
        f"{np.quantile(ms, 0.99):.1f} ms | {ms.max():.0f} ms | {took:.2f} s | "
        f"{standstill.longest_s:.2f} s |",
        flush=True,
    )


if __name__ == "__main__":
    main()
