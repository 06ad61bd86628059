"""Hours of simulated driving through the processors as the nodes use them, as fast as they allow.

    python bench/soak.py [--hours 2] [--tilt] [--report 600]

Prints, for each stretch of simulated time, resident memory, the graph's size, the 99 % and the
longest step (processor time), the time of a solution as the SLAM node makes it while driving, and
how long another thread stood still meanwhile: gtsam holds the interpreter, and the intake of
messages is such a thread.

With `--tilt` it is the TCCM node's processor instead, with its messages: one lap of
the tilting laser is simulated and sent again and again, each time with later stamps.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.mapping.tccm import TccmProcessor
from tccm_ros.robot import Robot
from tccm_ros.ros.topic_messages import CycleMessageBuilder
from tccm_ros.sensors.registry import default_streams
from tccm_sim.engine import Simulation
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

WORLD, LAP_S = "load", 20.0
LISTENED_TO = ("planes", "objects", "surfaces", "view")
"""Topics of the TCCM node whose messages are made."""

JOINT_STEP_NS = 10_000_000
"""Of the simulator's joint samples."""

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
    parser.add_argument("--tilt", action="store_true", help="the TCCM node instead")
    parser.add_argument("--report", type=float, default=600.0, help="stretch, simulated s")
    arguments = parser.parse_args()
    (soak_tccm if arguments.tilt else soak_slam)(arguments.hours, arguments.report)


def soak_slam(hours: float, stretch_s: float) -> None:
    """Drive the level laser round a room."""
    options = Options(laps=max(1, round(3600.0 * hours / LAP_S)), tilt=False)
    simulation = Simulation(build_world(WORLD, options), 0, options)
    robot = Robot(Config(), default_streams(), expects_odometry=True)
    slam = SurfaceSlam(Config())
    print("| hour | memory | keyframes | 99 % of steps | longest step | solve | stood still |")
    print("|---|---|---|---|---|---|---|", flush=True)
    steps: list[float] = []
    due_ns = simulation.start_ns + round(stretch_s * 1e9)
    for published in simulation.run():
        for record in published.records:
            start = time.process_time()
            for event in robot.add(published.topic.lstrip("/"), record):
                slam.add(event)
            steps.append(time.process_time() - start)
        if published.log_ns >= due_ns:
            report(slam, (published.log_ns - simulation.start_ns) / 3.6e12, steps)
            due_ns += round(stretch_s * 1e9)
            steps.clear()


def soak_tccm(hours: float, stretch_s: float) -> None:
    """Tilt a laser without end."""
    records, lap_ns = tilting_lap()
    types, config = TypestoreMessages(), Config()
    robot = Robot(config, default_streams(), expects_odometry=True)
    processor = TccmProcessor(config)
    builder = CycleMessageBuilder(types, config)
    print("| hour | memory | cycles | 99 % of steps | longest step | cuboids | scans dropped |")
    print("|---|---|---|---|---|---|---|", flush=True)
    steps: list[float] = []
    due_s = stretch_s
    for lap in range(round(3600.0 * hours * 1e9 / lap_ns)):
        for role, record in records:
            start = time.process_time()
            for event in robot.add(role, later(record, lap * lap_ns)):
                for result in processor.add(event):
                    for due in builder.of(result, processor.map.cuboids):
                        if due.topic in LISTENED_TO:
                            types.serialize(due.msgtype, due.build())
            steps.append(time.process_time() - start)
        if (lap + 1) * lap_ns * 1e-9 >= due_s:
            ms, dropped = 1e3 * np.array(steps), (robot.dropped + processor.dropped).total()
            print(
                f"| {(lap + 1) * lap_ns / 3.6e12:.2f} | {memory_mb():.0f} MB | "
                f"{processor.counts['cycles']} | {np.quantile(ms, 0.99):.1f} ms | "
                f"{ms.max():.0f} ms | {len(processor.map.cuboids())} | {dropped} |",
                flush=True,
            )
            due_s += stretch_s
            steps.clear()


def tilting_lap() -> tuple[list[tuple[str, Any]], int]:
    """Return the records of a lap with their roles, and how much later the next one begins, ns."""
    options = Options(laps=1)
    simulation = Simulation(build_world(WORLD, options), 0, options)
    records = [
        (published.topic.lstrip("/"), record)
        for published in simulation.run()
        for record in published.records
        if published.topic != "/scan"
    ]
    stamps = [record.stamp_ns for role, record in records if role == "joint_states"]
    return records, max(stamps) - min(stamps) + JOINT_STEP_NS


def later(record: Any, shift_ns: int) -> Any:
    """Return a record with a later stamp; the robot description has none."""
    return (
        replace(record, stamp_ns=record.stamp_ns + shift_ns)
        if hasattr(record, "stamp_ns")
        else record
    )


def report(slam: SurfaceSlam, hour: float, steps: list[float]) -> None:
    memory, start = memory_mb(), time.process_time()
    with Standstill() as standstill:
        solution = slam.solve(is_final=False)
    elapsed = time.process_time() - start
    ms = 1e3 * np.array(steps)
    print(
        f"| {hour:.2f} | {memory:.0f} MB | {len(solution.graph.keyframes)} | "
        f"{np.quantile(ms, 0.99):.1f} ms | {ms.max():.0f} ms | {elapsed:.2f} s | "
        f"{standstill.longest_s:.2f} s |",
        flush=True,
    )


if __name__ == "__main__":
    main()
