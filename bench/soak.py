"""Hours of driving: through the processors, or in real time through both nodes as processes.

    python bench/soak.py level [--hours 2] [--report 600]
    python bench/soak.py tilt [--hours 2] [--report 600]
    python bench/soak.py bag BAG [--rate 1] [--remap NAME:=TOPIC]... [--no-replay] [--one]
    setsid sh -c 'echo -15 > /proc/self/autogroup; exec python bench/soak.py day DIR'
        [--minutes 120] [--first 1] [--long 5]

`level` drives the level laser round one room, as fast as the processors allow. For each stretch of
simulated time it prints resident memory, the graph's size, the 99 % and the longest step (processor
time), the time of a solution as the SLAM node makes it while driving, and how long another thread
stood still meanwhile: gtsam holds the interpreter, and the intake of messages is such a thread.
`tilt` is the TCCM node's processor instead, with its messages: one lap of the tilting laser is
simulated and sent again and again, each time with later stamps.

`bag` plays a bag into tccm_node and slam_node, and prints the longest pause of `/pose`, the counts
of both nodes, the time of two saves on the way and of one at the end, the memory of the nodes and
of the processes that they started (PSS: memory common to several is divided among them), and
whether the saved files are those of a replay.

`day` drives through flats at random (`soak_flats.py`, made while the one before is driven), with
people, stops and a fault in the middle. Between two flats both nodes are reset by their service;
each sixth flat has the stamps of the first again instead, which the nodes must notice themselves.
The command above keeps other work on the machine from disturbing the nodes, where the scheduler
groups processes by session. DIR then has `summary.md` (a row for each flat, and warnings of the
nodes), `log.jsonl` (memory every 5 s, pauses of `/pose` over 0.1 s, saves, counts), the output of
the nodes, and for each flat its bag, truth and map.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from soak_flats import later

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
    """Run a mode."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    modes = parser.add_subparsers(dest="mode", required=True)
    for mode, laser in (("level", "level"), ("tilt", "tilting")):
        processors = modes.add_parser(mode, help=f"processors of the {laser} laser")
        processors.add_argument("--hours", type=float, default=2.0)
        processors.add_argument("--report", type=float, default=600.0, help="stretch, simulated s")
    bag = modes.add_parser("bag", help="both nodes with a bag")
    bag.add_argument("bag", type=Path)
    bag.add_argument("--rate", type=float, default=1.0)
    bag.add_argument("--remap", action="append", default=[], metavar="NAME:=TOPIC")
    bag.add_argument("--one", action="store_true", help="both nodes in one process: all_in_one")
    bag.add_argument("--no-replay", action="store_true", help="compare no files")
    day = modes.add_parser("day", help="both nodes with flats at random and faults")
    day.add_argument("out", type=Path)
    day.add_argument("--minutes", type=float, default=120.0)
    day.add_argument("--first", type=int, default=1, help="seed of the first flat")
    day.add_argument("--long", type=int, default=5, help="laps of the second flat")
    arguments = parser.parse_args()
    if arguments.mode in ("level", "tilt"):
        soak = soak_tccm if arguments.mode == "tilt" else soak_slam
        soak(arguments.hours, arguments.report)
    else:
        soak_live(arguments)


def soak_live(arguments: argparse.Namespace) -> None:
    """Drive in real time through the nodes."""
    import rclpy
    from soak_nodes import Day, soak_bag

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "98")
    rclpy.init()
    if arguments.mode == "bag":
        options = {"one_process": arguments.one, "compare": not arguments.no_replay}
        soak_bag(arguments.bag, arguments.rate, arguments.remap, **options)
    else:
        arguments.out.mkdir(parents=True)
        Day(arguments.out, arguments.first, arguments.long).run(arguments.minutes)
    rclpy.try_shutdown()


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
