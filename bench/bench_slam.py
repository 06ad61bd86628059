"""SLAM: line extraction, the graph at 10,000 poses, and the two public logs where they are.

Usage: python bench/bench_slam.py [--shared FOLDER] [--seeds N]. Prints tables; asserts nothing.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tccm_ros.bags.reader import BagReader
from tccm_ros.baselines.line_ransac import label_by_ransac
from tccm_ros.config import Config
from tccm_ros.evaluate.trajectory_errors import pairs_that_meet, relation_errors
from tccm_ros.evaluate.truth_files import read_reference, read_stamps
from tccm_ros.geometry import between2, compose2, inverse, spatial
from tccm_ros.records import Odometry, PosedScan, Scan
from tccm_ros.slam.chain import yaw_offset_for
from tccm_ros.slam.factors.factor import Factor, by_variables
from tccm_ros.slam.factors.keys import keyframe_key, wall_key
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.incremental import IncrementalGraph
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.loops import closing
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.slam.walls.lines import extract_lines, label_by_splitting
from tccm_sim.carmen import import_carmen

HERE = Path(__file__).resolve().parent


def load_plan():
    """Load the tests' floor plan: truth that shares no code with the package."""
    path = HERE.parent / "test" / "helpers" / "plan.py"
    spec = importlib.util.spec_from_file_location("plan", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["plan"] = module
    spec.loader.exec_module(module)
    return module


def bench_lines(plan) -> None:
    config = Config()
    bearings = np.linspace(-2.4, 2.4, 1080)
    ranges = plan.cast(plan.ring(), np.array([0.0, 0.0, 0.3]), bearings)
    ranges = ranges + np.random.default_rng(0).normal(size=1080) * 0.01
    beams = np.stack([np.cos(bearings), np.sin(bearings)], axis=1) * ranges[:, None]
    beams = beams[np.isfinite(ranges)]
    print("### Lines of a scan of 1,080 beams\n\n| method | us | lines |\n|---|---|---|")
    for label in (label_by_splitting, label_by_ransac):
        times = []
        for _ in range(60):
            start = time.perf_counter()
            lines = extract_lines(beams, np.zeros(2), config, label)
            times.append(time.perf_counter() - start)
        name = label.__name__.removeprefix("label_").replace("_", " ")
        print(f"| {name} | {np.median(times) * 1e6:.0f} | {len(lines)} |", flush=True)


def big_graph(poses: int, per_pose: int):
    """Return per-keyframe factors and start poses of 16 rounds in a building 60 m wide."""
    random = np.random.default_rng(1)
    truth = np.zeros((poses, 3))
    for k in range(1, poses):
        truth[k] = compose2(truth[k - 1], [0.3, 0.0, 0.01])
    cov = np.diag([0.01**2, 0.01**2, 0.003**2])
    steps, start = [], truth[:1].copy()
    groups: list[list[Factor]] = []
    bearings = 1.3 * np.arange(per_pose) + 0.2
    keys = [keyframe_key(k, yaw_offset_for(bearings - truth[k, 2])) for k in range(poses)]
    for k in range(poses):
        if k == 0:
            groups.append([PriorPose(keys[0], truth[0], cov)])
            steps.append(truth[0])
            continue
        delta = between2(truth[k - 1], truth[k]) + random.normal(size=3) * [0.01, 0.01, 0.003]
        steps.append(compose2(steps[-1], delta))
        groups.append(
            [BetweenKeyframes(keys[k - 1], keys[k], delta, cov), Planar(keys[k], start[0])]
        )
    wall_cov = np.diag([0.01**2, 0.02**2])
    for k in range(poses):
        for j in range(per_pose):
            wall = (k // 40) * per_pose + j
            phi_map = 1.3 * j + 0.2
            rho_map = (
                3.0
                + j
                + np.cos(phi_map) * truth[(k // 40) * 40, 0]
                + (np.sin(phi_map) * truth[(k // 40) * 40, 1])
            )
            x, y, yaw = truth[k]
            phi = phi_map - yaw + random.normal() * 0.01
            rho = rho_map - np.cos(phi_map) * x - np.sin(phi_map) * y + random.normal() * 0.02
            groups[k].append(WallObservation(keys[k], wall_key(wall), phi, rho, wall_cov))
    return keys, groups, np.array(steps), truth


def bench_graph(poses: int = 10_000, per_pose: int = 5) -> None:
    keys, groups, start, truth = big_graph(poses, per_pose)
    isam, times, pose = IncrementalGraph(), [], start[0]
    for k, group in enumerate(groups):
        pose = compose2(pose, between2(start[max(k - 1, 0)], start[k]))
        t = time.process_time()
        isam.update(by_variables(group), {keys[k]: pose})
        times.append(time.process_time() - t)
    ms = np.array(times) * 1e3
    print(f"\n### A graph of {poses:,} poses and {poses * per_pose:,} wall measurements\n")
    print("| ISAM2 | ms |\n|---|---|")
    print(f"| median step | {np.median(ms):.2f} |\n| p99 | {np.quantile(ms, 0.99):.2f} |")
    print(f"| longest step | {ms.max():.1f} |\n| all steps | {ms.sum():.0f} |", flush=True)
    t0 = time.process_time()
    live = isam.planar_poses(keys)
    graph = PoseGraph([f for group in groups for f in group], dict(zip(keys, live)))
    t1 = time.process_time()
    solution = graph.optimise()
    t2 = time.process_time()
    error = between2(truth, solution.planar_poses(keys))
    rms = float(np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))))
    print("\n| batch from there | build, s | optimise, s | steps | rms, m |\n|---|---|---|---|---|")
    row = f"{t1 - t0:.2f} | {t2 - t1:.2f} | {solution.iterations} | {rms:.3f}"
    print(f"| all poses | {row} |", flush=True)


def bench_nees(plan, seeds: int) -> None:
    poses = plan.route([(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (5, 0)])
    print(f"\n### A ring of 42 m, {seeds} seeds\n")
    print(
        "| by | rms, m | rms, deg | NEES/dof of the last pose | of the middle | of all keyframes |"
    )
    print("|---|---|---|---|---|---|")
    for walls in (True, False):
        config = Config()
        config.walls.enabled = walls
        rms, consistency = [], []
        for seed in range(seeds):
            run = plan.drive(plan.ring(), poses, seed=seed)
            slam = WallSlam(config)
            for scan in run.scans:
                slam.add_scan(scan)
            solution = slam.solve()
            found = solution.keyframes[1:]
            at = np.searchsorted(run.stamps_ns, [k.stamp_ns for k in found])
            error = between2(run.truth[at], np.stack([k.pose for k in found]))
            # Squared per degree of freedom; a consistent estimator has a mean of 1.
            scaled = np.linalg.solve(solution.cov_keyframes[1:], error[..., None])[..., 0]
            nees = np.sum(error * scaled, axis=-1) / error.shape[-1]
            consistency.append([nees[-1], nees[len(nees) // 2], nees.mean()])
            rms.append(plan.errors(run.truth, solution.poses))
        m, rad = np.mean(rms, axis=0)
        name = "walls and matching" if walls else "matching alone"
        last, middle, every = np.mean(consistency, axis=0)
        row = f"{m:.4f} | {np.degrees(rad):.3f} | {last:.2f} | {middle:.2f} | {every:.2f}"
        print(f"| {name} | {row} |", flush=True)


def scans_of(bag: Path) -> list[PosedScan]:
    """Read an imported log's scans with their odometry: one pose each, as logged."""
    odometry: dict[int, np.ndarray] = {}
    scans: list[Scan] = []
    for _, _, record in BagReader(bag).records({"scan": "/scan", "odom": "/odom"}):
        if isinstance(record, Odometry):
            odometry[record.stamp_ns] = record.T_odom_base
        elif isinstance(record, Scan):
            scans.append(record)
    mount = np.eye(4)
    return [
        PosedScan(s, np.array([s.stamp_ns]), odometry[s.stamp_ns][None], mount[None])
        for s in scans
        if s.stamp_ns in odometry
    ]


class TimedGraph(IncrementalGraph):
    """Notes the processor time (s) of the live graph of the loop search."""

    seconds = 0.0

    def update(self, *arguments) -> None:
        """Update as `IncrementalGraph`."""
        start = time.process_time()
        super().update(*arguments)
        TimedGraph.seconds += time.process_time() - start


def bench_log(log: Path, reference: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        import_carmen(log, bag)
        scans = scans_of(bag)
        stamps = read_stamps(bag / "stamps.csv")
    truth = read_reference(reference)
    meet = pairs_that_meet(truth.poses[:, :3, 3])
    for walls in (True, False):
        config = Config()
        config.walls.enabled = walls
        slam, TimedGraph.seconds = WallSlam(config), 0.0
        t0 = time.process_time()
        for scan in scans:
            slam.add_scan(scan)
        t1 = time.process_time()
        solution = slam.solve()
        t2 = time.process_time()
        at = solution.pose_at([stamps[int(i)] for i in truth.scan_index])
        poses = spatial(at)
        i, j = meet.T
        errors = relation_errors(poses[i], poses[j], inverse(truth.poses[i]) @ truth.poses[j])
        accepted = sum(loop.accepted for loop in solution.loops)
        cells = [
            f"{log.name.split('.')[0]}, walls {'on' if walls else 'off'}",
            f"{t1 - t0:.1f}",
            f"{TimedGraph.seconds:.1f}",
            f"{t2 - t1:.1f}",
            f"{len(solution.keyframes)}",
            f"{len(solution.walls)}",
            f"{accepted}",
            f"{len(errors)}",
            f"{errors.translation.mean():.4f} +- {errors.translation.std():.4f}",
            f"{np.median(errors.translation):.4f}",
            f"{np.degrees(errors.rotation.mean()):.3f}",
            f"{np.degrees(np.median(errors.rotation)):.3f}",
        ]
        print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = os.environ.get("TCCM_SHARED", HERE.parents[1] / "shared")
    parser.add_argument("--shared", type=Path, default=Path(default))
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    plan = load_plan()
    bench_lines(plan)
    bench_graph()
    bench_nees(plan, options.seeds)
    closing.IncrementalGraph = TimedGraph
    print(
        "\n### Public logs: pairs of reference rows at a distance below 3 m with more than 10 m of "
        "path between\n"
    )
    columns = (
        "log",
        "scans, s CPU",
        "its live graph, s CPU",
        "solution, s CPU",
        "keyframes",
        "walls",
        "loops",
        "pairs",
        "mean, m",
        "median, m",
        "mean, deg",
        "median, deg",
    )
    print("| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|")
    for name in ("intel", "mit-csail"):
        log = options.shared / "data" / "carmen" / f"{name}.clf.bz2"
        if not log.exists():
            print(f"| {name}: its log is not here |" + " |" * (len(columns) - 1))
            continue
        bench_log(log, log.with_name(f"{name}_reference.txt"))


if __name__ == "__main__":
    main()
