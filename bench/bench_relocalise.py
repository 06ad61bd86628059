"""Measure how soon a robot that starts anywhere finds itself in a saved map, and how often wrongly.

Each world is mapped once; the robot then starts at places of another drive through it. Columns:
how often it was found with the first scan, within 3 s, within 3 m of driving, later or not at all,
and wrongly (by more than 0.3 m or 10 deg); the same within 1 s of a pose that was told 0.5 m and
20 deg off; how often it was found, wrongly, in the map of the world before; and the time of a scan.
Used for docs/design/experiments/wall_slam.md.

Usage: python bench/bench_relocalise.py [--shared FOLDER] [--starts N] [WORLD ...]
WORLD: flat, ring, office_signs, flat:SEED (bench/random_flats.py), flats (20 of them), robocup.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from random_flats import random_flat

from tccm_ros.bags.reader import BagReader
from tccm_ros.config import Config
from tccm_ros.records import PosedScan, PoseGuess
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams
from tccm_ros.slam.se2 import between_se2, compose_se2, inverse_se2
from tccm_ros.slam.wall_slam import WallSlam
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

HERE = Path(__file__).resolve().parent

WRONG_M, WRONG_RAD = 0.3, np.radians(10.0)
SOON_S, SOON_M, LONG_M = 3.0, 3.0, 8.0
TOLD = np.array([0.4, -0.3, np.radians(20.0)])

Float64 = np.ndarray


@dataclass
class Drive:
    """Level scans, and the true pose (N, 3) of the base at each in the map's frame."""

    scans: list[PosedScan]
    truth: Float64


def simulated(name: str, seed: int) -> Drive:
    """Return the level scans of a drive; the seed is that of all noise."""
    options = Options(tilt=False)
    flat = name.partition(":")[2]
    world = random_flat(int(flat), options) if flat else build_world(name, options)
    simulation, config = Simulation(world, seed, options), Config()
    robot = Robot(config, default_streams(config), expects_odometry=True)
    events = []
    for message in simulation.run():
        role = message.topic.strip("/")
        if role in ("scan", "odom", "joint_states", "robot_description"):
            events += [e for record in message.records for e in robot.add(role, record)]
    scans = [e for e in (*events, *robot.flush()) if isinstance(e, PosedScan)]
    times = np.array([0.0, *((s.scan.stamp_ns - EPOCH_NS) * 1e-9 for s in scans)])
    poses = simulation.true_poses(times)
    return Drive(scans, planar_poses(np.linalg.inv(poses[0]) @ poses[1:]))


def planar_poses(T: Float64) -> Float64:
    return np.stack([T[:, 0, 3], T[:, 1, 3], np.arctan2(T[:, 1, 0], T[:, 0, 0])], axis=1)


def mapped(drive: Drive) -> dict:
    slam = WallSlam(Config())
    for scan in drive.scans:
        slam.add_scan(scan)
    return slam.saved(slam.solve())


@dataclass
class Found:
    """When a robot was found, after how many metres and scans, where, and how long it took."""

    after_s: float
    after_m: float
    scans: int
    pose: Float64
    search_s: float


def find(arrays: dict, drive: Drive, start: int, told: Float64 | None = None) -> Found | None:
    """Drive on from a scan until the robot has a place; None where it has none in time."""
    slam = WallSlam.from_saved(Config(), arrays)
    first_ns = drive.scans[start].scan.stamp_ns
    if told is not None:
        guess = compose_se2(drive.truth[start], told)
        slam.add_guess(PoseGuess(first_ns, guess, np.diag([0.25, 0.25, np.radians(15.0) ** 2])))
    driven, began = 0.0, time.process_time()
    for k in range(start, len(drive.scans)):
        step = drive.truth[k, :2] - drive.truth[max(k - 1, start), :2]
        driven += float(np.hypot(*step))
        after_s = (drive.scans[k].scan.stamp_ns - first_ns) * 1e-9
        if driven > LONG_M or (told is not None and after_s > 1.0):
            return None
        scan_pose = slam.add_scan(drive.scans[k])
        if slam.is_located:
            scans = k - start + 1
            busy_s = (time.process_time() - began) / scans
            return Found(after_s, driven, scans, scan_pose.pose, busy_s)
    return None


def is_right(pose: Float64, truth: Float64) -> bool:
    error = between_se2(truth, pose)
    return bool(np.hypot(*error[:2]) < WRONG_M and abs(error[2]) < WRONG_RAD)


def kind(found: Found | None, truth: Float64) -> str:
    if found is None:
        return "searching"
    if not is_right(found.pose, truth):
        return "wrong"
    if found.scans == 1:
        return "first scan"
    if found.after_s <= SOON_S:
        return "3 s"
    return "3 m" if found.after_m <= SOON_M else "later"


def starts_of(drive: Drive, starts: int) -> list[int]:
    """Return the first scans of the starts, spread over a drive; the last has some way to go."""
    return np.linspace(0, len(drive.scans), starts, endpoint=False).astype(int).tolist()


KINDS = ("first scan", "3 s", "3 m", "later", "searching", "wrong")


def row(name: str, arrays: dict, drive: Drive, starts: int, other: Drive | None) -> None:
    places = starts_of(drive, starts)
    free, told, busy = Counter[str](), Counter[str](), []
    for start in places:
        found = find(arrays, drive, start)
        truth = drive.truth[start + found.scans - 1] if found else drive.truth[start]
        free[kind(found, truth)] += 1
        busy += [found.search_s] if found else []
        found = find(arrays, drive, start, TOLD)
        truth = drive.truth[start + found.scans - 1] if found else drive.truth[start]
        told["no" if found is None else "right" if is_right(found.pose, truth) else "wrong"] += 1
    false = "-"
    if other is not None:
        elsewhere = starts_of(other, starts)
        false = str(sum(find(arrays, other, start) is not None for start in elsewhere))
    cells = [name, str(starts), *(str(free[k]) for k in KINDS)]
    cells += [f"{told['right']} / {told['wrong']} / {told['no']}", false]
    cells.append(f"{1e3 * float(np.median(busy)):.0f}" if busy else "-")
    print("| " + " | ".join(cells) + " |", flush=True)


def recorded(folder: Path) -> Drive:
    """Return the level scans of a recording, and the poses of its reference."""
    config = Config()
    robot = Robot(config, default_streams(config), expects_odometry=True)
    roles = {"scan": "/scan", "odom": "/odom", "tf": "/tf", "tf_static": "/tf_static"}
    roles["robot_description"] = "/robot_description"
    events = [e for role, _, r in BagReader(folder).records(roles) for e in robot.add(role, r)]
    scans = [e for e in (*events, *robot.flush()) if isinstance(e, PosedScan)]
    rows = np.loadtxt(folder / "truth.tum")
    stamps = np.array([s.scan.stamp_ns * 1e-9 for s in scans])
    nearest = np.abs(rows[:, 0][None] - stamps[:, None]).argmin(axis=1)
    yaw = 2.0 * np.arctan2(rows[nearest, 6], rows[nearest, 7])
    return Drive(scans, np.stack([rows[nearest, 1], rows[nearest, 2], yaw], axis=1))


def row_of_arena(real: Path, starts: int) -> None:
    """Print how a drive of another day is found in the map of an arena.

    The two references have frames of their own: the offset of most places found is taken for true.
    """
    arrays = mapped(recorded(real / "robocup_c1"))
    drive = recorded(real / "robocup2026_1")
    rounds = []
    for start in starts_of(drive, starts):
        found = find(arrays, drive, start)
        if found is None:
            rounds.append((None, 0.0, 0))
            continue
        truth = drive.truth[start + found.scans - 1]
        rounds.append((compose_se2(found.pose, inverse_se2(truth)), found.after_m, found.scans))
    offsets = np.array([T for T, *_ in rounds if T is not None])
    usual = np.median(offsets, axis=0)
    for T, metres, scans in rounds:
        error = "" if T is None else f", {np.hypot(*(T - usual)[:2]):.2f} m from the median offset"
        print(f"robocup: {'not found' if T is None else f'{metres:.1f} m, {scans} scans'}{error}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = os.environ.get("TCCM_SHARED", HERE.parents[1] / "shared")
    parser.add_argument("--shared", type=Path, default=Path(default))
    parser.add_argument("--starts", type=int, default=12)
    parser.add_argument("worlds", nargs="*", default=["flat", "ring", "office_signs", "flats"])
    options = parser.parse_args()
    worlds = [w for name in options.worlds for w in expanded(name)]
    head = ["world", "starts", *KINDS, "told: right / wrong / no", "in another map", "ms a scan"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    before: Drive | None = None
    for name in worlds:
        if name == "robocup":
            row_of_arena(options.shared / "data" / "real", options.starts)
            continue
        drive = simulated(name, 1)
        row(name, mapped(simulated(name, 0)), drive, options.starts, before)
        before = drive


def expanded(name: str) -> list[str]:
    return [f"flat:{seed}" for seed in range(20)] if name == "flats" else [name]


if __name__ == "__main__":
    main()
