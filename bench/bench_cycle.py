"""What a tilt cycle costs after its last beam: CPU milliseconds a stage.

    python bench/bench_cycle.py [BAG]

The bag is run through the processor once. Then each stage is run again on what every cycle had
before it, and the shortest CPU time of some repeats counts. Rows are medians over the cycles, and
the slowest cycle. Messages are made and written as bytes for the topics that somebody listens to;
`planes` and `objects` here. The nodes send the planes before they go on.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import FreeSpace
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.mapping.surface_message import object_boxes, surface_cloud, view_intervals
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor
from tccm_ros.planes import find_planes
from tccm_ros.planes.tracking import PlaneTracker
from tccm_ros.robot import Robot
from tccm_ros.ros.topic_messages import CycleMessageBuilder
from tccm_ros.sensors.registry import default_streams
from tccm_ros.tabletop.objects import ObjectTracker, find_objects

FLAT = Path(__file__).resolve().parents[1] / "bags" / "flat"
REPEATS = 5


class Recorder(TccmProcessor):
    """A processor that keeps its tilt cycles."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.cycles: list[Any] = []

    def _result(self, cycle: Any, *args: Any) -> CycleResult:
        self.cycles.append(cycle)
        return super()._result(cycle, *args)


class Stages:
    """Shortest CPU time of each stage of one cycle, in order of first use."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    def run(self, name: str, work: Callable[[], Any]) -> Any:
        """Return what the work returns; note how long it took."""
        start = time.process_time()
        result = work()
        spent = 1e3 * (time.process_time() - start)
        self.ms[name] = min(spent, self.ms.get(name, np.inf))
        return result


def run_cycles(cycles: list[Any], config: Config, all_stages: list[Stages]) -> None:
    """Run every stage of all cycles once."""
    the_map, seen = IntegrationMap(config), FreeSpace(config)
    tracker, objects_tracker = PlaneTracker(config), ObjectTracker(config)
    types = TypestoreMessages()
    builder = CycleMessageBuilder(types, config)
    for cycle, stages in zip(cycles, all_stages, strict=True):
        run = stages.run
        T, viewpoint = cycle.T_odom_base(), cycle.T_odom_sensor()[:3, 3]
        run("map", lambda s=cycle: the_map.add(s.part))
        cuboids = run("cuboids", the_map.cuboids)
        fits = run("planes", lambda c=cuboids, v=viewpoint: find_planes(c, config, v))
        run("outlines", lambda f=fits: [fit.area for fit in f])
        planes = run("tracking", lambda f=fits: tracker.update(f))
        found = run(
            "objects",
            lambda c=cuboids, f=fits, p=planes: objects_tracker.update(
                find_objects(c, f, p, config)
            ),
        )
        view = run("view", lambda s=cycle, T=T: view_intervals(s, config, T, "base"))
        run("seen free", lambda s=cycle, T=T, w=view: seen.add(s.part.cycle, T, w))
        surfaces = run(
            "surface message",
            lambda s=cycle, f=fits, T=T, v=viewpoint: surface_cloud(
                s, f, T, v, "base", True, config
            ),
        )
        boxes = run(
            "object boxes",
            lambda s=cycle, f=fits, p=planes, T=T: object_boxes(
                s, f, p, config, T, "base", wanted=True
            ),
        )
        result = CycleResult(
            cycle=cycle.part.cycle, stamp_ns=cycle.stamp_ns, start_ns=cycle.part.start_ns,
            end_ns=cycle.part.end_ns, frame_id="odom", base_frame_id="base", T_odom_base=T,
            planes=planes, objects=found, surfaces=surfaces, view=view, boxes=boxes,
            part=cycle.part, scans=len(cycle.records), base_speed=0.0, base_angular_speed=0.0,
            ended_by="turn",
        )  # fmt: skip
        for message in builder.of(result, lambda c=cuboids: c):
            if message.topic in ("planes", "objects", "surfaces", "view"):
                run(
                    f"message {message.topic}",
                    lambda m=message: types.serialize(m.msgtype, m.build()),
                )
        corners = sum(len(r) for p in planes for r in (p.boundary, *p.holes))
        stages.ms["(planes)"], stages.ms["(corners)"] = len(planes), corners


def main(bag: Path) -> None:
    """Print the table."""
    config = Config()
    robot = Robot(config, default_streams(), expects_odometry=True)
    recorder = Recorder(config)
    with BagReader(bag) as reader:
        topics = {k: v for k, v in DEFAULT_TOPICS.items() if k != "scan"}
        for role, _, record in reader.records(topics):
            for event in robot.add(role, record):
                recorder.add(event)
    for event in robot.flush():
        recorder.add(event)
    recorder.finish()
    all_stages = [Stages() for _ in recorder.cycles]
    for _ in range(REPEATS):
        run_cycles(recorder.cycles, config, all_stages)
    print(f"{bag.name}, {len(recorder.cycles)} cycles\n")
    print("| stage | median, ms | slowest cycle, ms |\n|---|---|---|")
    names = list(all_stages[0].ms)
    for name in names:
        values = [s.ms[name] for s in all_stages]
        print(f"| {name} | {median(values):.2f} | {max(values):.2f} |")
    first = ("map", "cuboids", "planes")
    after = [n for n in names if n not in first and not n.startswith("(")]
    for label, chosen in (
        ("until the planes are out", (*first, "outlines", "tracking", "message planes")),
        ("after the planes are found", after),
        ("all", [n for n in names if not n.startswith("(")]),
    ):
        sums = [sum(s.ms[n] for n in chosen) for s in all_stages]
        print(f"| **{label}** | **{median(sums):.2f}** | **{max(sums):.2f}** |")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FLAT)
