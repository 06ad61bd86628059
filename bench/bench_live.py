"""The live pose against the truth, the final batch and the solutions that follow it.

Usage: python bench/bench_live.py [DRIVE ...] [--latency S] [--without-feedback]. Prints a table;
asserts nothing. The live estimate is that of slam_node: a tracker that takes over each solution.
Stamps are the clock, so that runs repeat: a solution is asked for where the node asks for it, and
comes `--latency` seconds later.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import choose_topics
from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.geometry import between2, planar
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.replay.processors import Pipeline
from tccm_ros.results.trajectory import read_tum
from tccm_ros.slam.tracking import Tracker
from tccm_sim.recording import simulate

ROOT = Path(__file__).resolve().parents[1]

PERIOD_S, KEYFRAMES = 2.0, 5
"""As slam_node: shortest time between two solutions, and new keyframes that are worth one."""

LAP = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (4, 0)]


class Drive(NamedTuple):
    """Events of a SLAM processor, the true poses (N, 3) at stamps (N,), and the configuration."""

    events: list[Any]
    stamps_ns: np.ndarray
    truth: np.ndarray
    config: Config


class Live(NamedTuple):
    """Live poses (N, 3) at stamps (N,), the poses of the same stamps in the first solution that
    has them (NaN where none does), and in the last; when a solution first followed a loop.
    """

    stamps_ns: np.ndarray
    poses: np.ndarray
    solved: np.ndarray
    final: np.ndarray
    closed_ns: float


class _Tee:
    """Takes the place of a SLAM processor and notes its events."""

    def __init__(self, config: Config) -> None:
        self.events: list[Any] = []
        self._slam = SurfaceSlam(config)

    def add(self, event: Any) -> None:
        if self._slam.takes(event):
            self.events.append(event)

    def add_pose_stamp(self, stamp_ns: int) -> None:
        """Not needed where there is a level laser."""


def of_bag(path: Path, truth: Path, config: Config | None = None) -> Drive:
    config = config or Config()
    with BagReader(path) as reader:
        choice = choose_topics(reader, config)
        reader.add_readers(choice.readers)
        pipeline = Pipeline(config, streams=choice.streams, expects_odometry=True)
        tee = pipeline.slam = _Tee(config)
        for role, _, record in reader.records(choice.topics):
            pipeline.add(role, record)
        pipeline.finish()
    known = read_tum(truth)
    return Drive(tee.events, known.stamps_ns, planar(known.T_map_base), config)


def of_flat(settings: str | None = None) -> Drive:
    bag = ROOT / "bags" / "flat"
    return of_bag(bag, bag / "truth.tum", read_config(settings and ROOT / "config" / settings))


def of_world(name: str) -> Drive:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / name
        simulate(name, out)
        return of_bag(out, out / "truth.tum")


def of_plan(*, matching: bool) -> Drive:
    path = ROOT / "test" / "helpers" / "plan.py"
    spec = importlib.util.spec_from_file_location("plan", path)
    plan = sys.modules["plan"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(plan)
    config = Config()
    config.matching.enabled = config.loops.enabled = matching
    run = plan.drive(plan.ring(), plan.route(LAP), seed=3)
    scans = [replace(scan, role="scan") for scan in run.scans]
    return Drive(scans, run.stamps_ns, run.truth, config)


DRIVES = {
    "flat": of_flat,
    "flat, config/paper.yaml": lambda: of_flat("paper.yaml"),
    "walkthrough": lambda: of_bag(ROOT / "bags/walkthrough", ROOT / "bags/walkthrough/truth.tum"),
    "ring": lambda: of_world("ring"),
    "ring of the tests": lambda: of_plan(matching=True),
    "the same, walls only": lambda: of_plan(matching=False),
}


def follow(drive: Drive, latency_s: float, feedback: bool) -> Live:
    """Track a drive and give it solutions as the node does."""
    tracker, slam = Tracker(drive.config), SurfaceSlam(drive.config)
    stamps, poses, found = [], [], {}
    unsolved: Counter[str] = Counter()
    due_ns, arrival_ns, coming, closed_ns = 0, 0, None, np.inf
    for event in drive.events:
        before = Counter(tracker.counts)
        tracker.add(event)
        slam.add(event)
        for counted in ("clouds", "keyframes"):
            unsolved[counted] += tracker.counts[counted] - before[counted]
        live = tracker.current_pose()
        now_ns = live.stamp_ns
        if tracker.counts["level scans"] > before["level scans"]:
            stamps.append(now_ns)
            poses.append(live.pose)
        if coming is not None and now_ns >= arrival_ns:
            if feedback:
                tracker.take(coming)
            coming = None
        is_due = unsolved["clouds"] or unsolved["keyframes"] >= KEYFRAMES
        if coming is None and is_due and now_ns >= due_ns:
            unsolved.clear()
            solution = slam.solve()
            coming = slam.solved_map(solution)
            arrival_ns = now_ns + round(latency_s * 1e9)
            due_ns = now_ns + round(max(PERIOD_S, latency_s / 0.3) * 1e9)
            found |= _new(solution.graph, found)
            if any(loop.accepted for loop in solution.graph.loops):
                closed_ns = min(closed_ns, arrival_ns)
    final = slam.solve().graph
    found |= _new(final, found)
    return Live(
        np.array(stamps),
        np.array(poses),
        np.array([found[stamp] for stamp in stamps]),
        final.pose_at(stamps),
        closed_ns,
    )


def _new(solution, found) -> dict[int, np.ndarray]:
    return {
        stamp: pose
        for stamp, pose in zip(solution.stamps_ns.tolist(), solution.poses)
        if stamp not in found
    }


def errors(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances in mm and deg of poses (N, 3)."""
    delta = between2(a, b)
    return 1e3 * np.hypot(delta[:, 0], delta[:, 1]), np.degrees(np.abs(delta[:, 2]))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def row(name: str, of: np.ndarray, live: Live, other: np.ndarray) -> str:
    if not of.any():
        return ""
    mm, deg = errors(live.poses[of], other[of])
    at = ", ".join(f"{np.quantile(mm, q):.1f}" for q in (0.5, 0.95, 1.0))
    by = ", ".join(f"{np.quantile(deg, q):.2f}" for q in (0.5, 0.95, 1.0))
    return f"    {name:42} {at:>22} mm  {by:>18} deg"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drives", nargs="*", default=list(DRIVES), help="; ".join(DRIVES))
    parser.add_argument("--latency", type=float, default=1.0, help="of a solution, s")
    parser.add_argument("--without-feedback", action="store_true")
    options = parser.parse_args()
    for name in options.drives:
        drive = DRIVES[name]()
        live = follow(drive, options.latency, not options.without_feedback)
        at = np.searchsorted(drive.stamps_ns, live.stamps_ns).clip(0, len(drive.stamps_ns) - 1)
        start = np.flatnonzero(drive.stamps_ns[at] == live.stamps_ns)
        truth = between2(drive.truth[at[start[0]]], drive.truth[at])
        live_mm, final_mm = errors(truth, live.poses)[0], errors(truth, live.final)[0]
        every = np.ones(len(live.poses), bool)
        closed = live.stamps_ns > live.closed_ns
        print(f"{name}: rms live {rms(live_mm):.1f} mm, batch {rms(final_mm):.1f} mm;", end=" ")
        print(f"in the end {live_mm[-1]:.1f} and {final_mm[-1]:.1f} mm; distances (p50, p95, max)")
        print(row("from the first solution with the scan", every, live, live.solved))
        print(row("from the final batch", every, live, live.final))
        if closed.any() and not closed.all():
            print(row("from the final batch, once a loop is closed", closed, live, live.final))
        sys.stdout.flush()


if __name__ == "__main__":
    main()
