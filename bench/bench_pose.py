"""Poses and walls on real recordings, logs and simulated worlds: one table, before and after.

Usage: python bench/bench_pose.py --shared FOLDER [--before TCCM] [--names NAME ...] [--out FOLDER]
[--degenerate SEEDS]. TCCM is the command of another checkout (its .venv/bin/tccm): its rows stand
beside ours in the same run. Prints tables; asserts nothing. Recordings that are not there are left
out and named. With --degenerate, bench_degenerate.py of each checkout follows.

Columns: rms of the position after alignment in the plane, against truth.tum, motion capture or, of
the CARMEN logs, the pairs of rows of the reference that meet; that of odometry, against truth.tum;
mean NEES of keyframes per degree of freedom, against truth.tum; rms of
the steps between scans against odometry; walls, and how many of them are double: along more than
half of the shorter one within 8 cm and 5 deg of another, facing the same side.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from drives import bag_of
from scipy.optimize import least_squares

from tccm_ros.bags.reader import BagReader
from tccm_ros.evaluate.trajectory_errors import pairs_that_meet, poses_at, relation_errors
from tccm_ros.evaluate.truth_files import read_reference, read_stamps
from tccm_ros.geometry import between2, inverse, planar, wrap_angle
from tccm_ros.results.trajectory import read_tum
from tccm_sim.carmen import import_carmen

DOUBLE_DISTANCE, DOUBLE_ANGLE = 0.08, np.deg2rad(5.0)


class Case(NamedTuple):
    """A recording.

    Attributes
    ----------
    source
        Path in the shared folder, or a world of `drives.bag_of`.
    settings
        Of the replay, and others that only the newer program has.
    drift
        Seed of the drift that its exact odometry is given (`tools/drift_odometry.py`), 0: none.
    """

    source: str
    settings: tuple[str, ...] = ()
    new_settings: tuple[str, ...] = ()
    drift: int = 0


CASES = {
    "jackal_mocap": Case("data/real/jackal_mocap"),
    "jackal_mocap, middle of a rotation": Case(
        "data/real/jackal_mocap", (), ("scan.time_offset=-0.05",)
    ),
    "turtlebot4": Case("data/real/turtlebot4"),
    "turtlebot4, as info proposes": Case(
        "data/real/turtlebot4", (), ("scan.reverse=true", "scan.time_offset=-0.168")
    ),
    "robocup_c1": Case("data/real/robocup_c1"),
    "robocup2026_1": Case("data/real/robocup2026_1"),
    "mit-csail": Case("data/carmen/mit-csail.clf.bz2"),
    "intel": Case("data/carmen/intel.clf.bz2"),
    "flat": Case("flat"),
    "sim2_flat": Case("data/bags/sim2_flat"),
    "ring": Case("ring"),
    **{
        f"hololens, {name}{level}": Case("data/real/hololens", settings, (), drift)
        for level, settings in (("", ()), (", level_from", ("sensors.level_from=depth",)))
        for name, drift in (("exact", 0), ("drift 1", 1), ("drift 2", 2), ("drift 3", 3))
    },
    "random-1": Case("random-1"),
    "random-2": Case("random-2"),
    "random-3": Case("random-3"),
}


def make_bag(case: Case, shared: Path, out: Path) -> Path | None:
    """Return the bag of a case, made in a folder where it must be; None where it is missing."""
    if "/" not in case.source:
        bag = out / case.source
        return bag if bag.exists() else bag_of(case.source, out, shared)
    source = shared / case.source
    if not source.exists():
        return None
    if case.source.endswith(".bz2"):
        bag = out / source.name.removesuffix(".clf.bz2")
        if not bag.exists():
            import_carmen(source, bag)
        return bag
    if not case.drift:
        return source
    bag = out / f"{source.name}_drift_{case.drift}"
    if not bag.exists():
        tool = shared / "tools/drift_odometry.py"
        subprocess.run([sys.executable, tool, source, bag, str(case.drift)], check=True)
    return bag


def double_walls(folder: Path) -> tuple[int, int]:
    """Return how many walls a result has, and how many of them are double."""
    walls = json.loads((folder / "walls.json").read_text())["walls"]
    double = set()
    for i, a in enumerate(walls):
        for j, b in enumerate(walls[:i]):
            if abs(wrap_angle(a["phi"] - b["phi"])) > DOUBLE_ANGLE:
                continue
            normal = np.array([np.cos(a["phi"]), np.sin(a["phi"])])
            ends = [np.array(w["endpoints"]) for w in (a, b)]
            (p, q), (r, s) = (np.sort(e @ [-normal[1], normal[0]]) for e in ends)
            distance = abs(float((ends[1] - ends[0]).mean(axis=0) @ normal))
            if min(q, s) - max(p, r) > 0.5 * min(q - p, s - r) and distance < DOUBLE_DISTANCE:
                double.add(i if a["observations"] < b["observations"] else j)
    return len(walls), len(double)


def aligned_rms(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the rms distance (m) of points (N, 2) after the best planar alignment."""
    a, b = found - found.mean(axis=0), truth - truth.mean(axis=0)
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = np.cos(angle), np.sin(angle)
    return float(np.sqrt(np.mean(np.sum((a @ np.array([[c, s], [-s, c]]) - b) ** 2, axis=1))))


def at(stamps: np.ndarray, known: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return planar poses (N, 3) at stamps within the known ones, interpolated."""
    yaw = np.unwrap(poses[:, 2])
    columns = [poses[:, 0], poses[:, 1], yaw]
    return np.stack([np.interp(stamps - known[0], known - known[0], c) for c in columns], axis=1)


def messages(bag: Path, topic: str) -> Iterator[Any]:
    """Yield the messages of a topic, in their order."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as raw:
        wanted = [c for c in raw.connections if c.topic == topic]
        for connection, _, data in raw.messages(connections=wanted):
            yield raw.deserialize(data, connection.msgtype)


def stamp_of(message: Any) -> int:
    """Return the stamp (ns) of a message."""
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def motion_capture_rms(bag: Path, stamps: np.ndarray, poses: np.ndarray) -> float | None:
    """Return the rms distance (m) from motion capture, with the marker's place fitted."""
    with BagReader(bag) as reader:
        topics = [t.name for t in reader.topics() if t.msgtype.endswith("msg/PoseStamped")]
    if not topics:
        return None
    rows = [(stamp_of(m), m.pose.position.x, m.pose.position.y) for m in messages(bag, topics[0])]
    known = np.array([row[0] for row in rows])
    inside = (stamps > known[0]) & (stamps < known[-1])
    truth = at(stamps[inside], known, np.array([(x, y, 0.0) for _, x, y in rows]))[:, :2]
    poses = poses[inside]
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])

    def residual(q: np.ndarray) -> np.ndarray:
        arm = np.column_stack([c * q[3] - s * q[4], s * q[3] + c * q[4]])
        R = np.array([[np.cos(q[0]), np.sin(q[0])], [-np.sin(q[0]), np.cos(q[0])]])
        return ((poses[:, :2] + arm) @ R + q[1:3] - truth).ravel()

    starts = [np.array([a, 0.0, 0.0, 0.0, 0.0]) for a in np.linspace(-3.0, 3.0, 7)]
    fits = [least_squares(residual, start, loss="huber", f_scale=0.05) for start in starts]
    best = min(fits, key=lambda fit: fit.cost)
    return float(np.sqrt(2.0 * np.mean(residual(best.x) ** 2)))


def steps(poses: np.ndarray) -> np.ndarray:
    """Return the motion (N - 1, 3) from each pose to the next, in the frame of the first."""
    d, c, s = np.diff(poses, axis=0), np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    x, y = c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]
    return np.stack([x, y, wrap_angle(d[:, 2])], axis=1)


def odometry_at(bag: Path, stamps: np.ndarray) -> np.ndarray | None:
    """Return planar poses (N, 3) of odometry at stamps; None without odometry."""
    with BagReader(bag) as reader:
        if "/odom" not in {topic.name for topic in reader.topics()}:
            return None
        samples = {
            r.stamp_ns: planar(r.T_odom_base) for _, _, r in reader.records({"odom": "/odom"})
        }
    known = np.array(sorted(samples))
    return at(stamps, known, np.array([samples[int(t)] for t in known]))


def step_error(poses: np.ndarray, odometry: np.ndarray | None) -> str:
    """Return the rms of the steps between scans against odometry, in words."""
    if odometry is None:
        return ""
    error = steps(poses) - steps(odometry)
    position = np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1)))
    yaw = np.sqrt(np.mean(wrap_angle(error[:, 2]) ** 2))
    return f"{1e3 * position:.1f} mm, {np.rad2deg(yaw):.2f} deg"


def against_truth(bag: Path, result: Path, stamps: np.ndarray, poses: np.ndarray) -> list[str]:
    """Return position error of odometry and NEES of the trajectory against truth.tum, in words."""
    if not (bag / "truth.tum").exists():
        return ["", ""]
    true = read_tum(bag / "truth.tum")
    inside = (stamps >= true.stamps_ns[0]) & (stamps <= true.stamps_ns[-1])
    stamps, poses = stamps[inside], poses[inside]
    expected = at(stamps, true.stamps_ns, planar(true.T_map_base))
    odometry = odometry_at(bag, stamps)
    by_odometry = ""
    if odometry is not None:
        by_odometry = f"{1e3 * aligned_rms(odometry[:, :2], expected[:, :2]):.1f} mm"
    covs = {
        stamp_of(m): np.asarray(m.pose.covariance).reshape(6, 6)[np.ix_([0, 1, 5], [0, 1, 5])]
        for m in messages(result / "result.mcap", "/pose")
    }
    # Of keyframes, as poses between them have the covariance of the last one; along map's axes.
    graph = json.loads((result / "graph.json").read_text(), parse_float=Decimal)
    is_keyframe = np.isin(stamps, [int(k["stamp"] * 10**9) for k in graph["keyframes"][1:]])
    if not is_keyframe.any():  # a drive without a level scan
        return [by_odometry, ""]
    error = between2(expected[0], expected)
    error = between2(error, between2(poses[0], poses))[is_keyframe]
    yaw = poses[is_keyframe, 2]
    c, s, (x, y) = np.cos(yaw), np.sin(yaw), error[:, :2].T
    error[:, :2] = np.stack([c * x - s * y, s * x + c * y], axis=1)
    cov = np.array([covs[int(t)] for t in stamps[is_keyframe]])
    scaled = np.linalg.solve(cov, error[..., None])[..., 0]
    return [by_odometry, f"{np.mean(np.sum(error * scaled, axis=1)) / 3.0:.2f}"]


def position_error(bag: Path, source: Path, stamps: np.ndarray, T: np.ndarray) -> str:
    """Return the error of the position against what a recording has for truth, in words."""
    poses = planar(T)
    if source.name.endswith(".clf.bz2"):
        name = source.name.removesuffix(".clf.bz2")
        truth = read_reference(source.parent / f"{name}_reference.txt")
        read = read_stamps(bag / "stamps.csv")
        wanted = np.array([read[int(i)] for i in truth.scan_index])
        found, _ = poses_at(stamps, T, wanted)
        i, j = pairs_that_meet(truth.poses[:, :3, 3]).T
        relations = inverse(truth.poses[i]) @ truth.poses[j]
        return f"{relation_errors(found[i], found[j], relations).translation.mean():.4f} m"
    if (bag / "truth.tum").exists():
        true = read_tum(bag / "truth.tum")
        inside = (stamps >= true.stamps_ns[0]) & (stamps <= true.stamps_ns[-1])
        expected = at(stamps[inside], true.stamps_ns, planar(true.T_map_base))
        return f"{1e3 * aligned_rms(poses[inside, :2], expected[:, :2]):.1f} mm"
    rms = motion_capture_rms(bag, stamps, poses)
    return "" if rms is None else f"{1e3 * rms:.1f} mm"


def replay(tccm: Path, bag: Path, out: Path, settings: Sequence[str]) -> bool:
    """Replay a bag; return whether that went well."""
    options = [part for setting in settings for part in ("--set", setting)]
    command = [tccm, "replay", bag, "--out", out, "--quiet", "--no-pictures", *options]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--before", type=Path)
    parser.add_argument("--names", nargs="*", default=list(CASES))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--degenerate", type=int, default=0, metavar="SEEDS")
    arguments = parser.parse_args()
    ours = Path(sys.executable).parent / "tccm"
    programs = {"after": ours} if arguments.before is None else {
        "before": arguments.before, "after": ours,
    }  # fmt: skip
    out = arguments.out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    print("### Poses and walls\n")
    head = "recording, program, position, odometry, NEES, steps against odometry, walls, double"
    print("| " + " | ".join(head.split(", ")) + " |\n" + "|---" * 8 + "|", flush=True)
    for name in arguments.names:
        case = CASES[name]
        bag = make_bag(case, arguments.shared, out)
        if bag is None:
            print(f"{name}: {case.source} is not there", file=sys.stderr)
            continue
        for label, tccm in programs.items():
            if label == "before" and case.new_settings:
                continue
            result = out / f"{label}_{name.replace(', ', '_').replace(' ', '_')}"
            settings = (*case.settings, *case.new_settings)
            if not replay(tccm, bag, result, settings):
                print(f"| {name} | {label} | failed | | | | | |", flush=True)
                continue
            trajectory = read_tum(result / "trajectory.tum")
            stamps, T = trajectory.stamps_ns, trajectory.T_map_base
            cells = [
                name,
                label,
                position_error(bag, arguments.shared / case.source, stamps, T),
                *against_truth(bag, result, stamps, planar(T)),
                step_error(planar(T), odometry_at(bag, stamps)),
                *map(str, double_walls(result)),
            ]
            print("| " + " | ".join(cells) + " |", flush=True)
    for label, tccm in programs.items() if arguments.degenerate else ():
        print(f"\n### Worlds that say little: {label}\n", flush=True)
        bench = tccm.parents[2] / "bench" / "bench_degenerate.py"
        seeds = ("--seeds", str(arguments.degenerate))
        subprocess.run([tccm.with_name("python"), bench, *seeds], check=True)


if __name__ == "__main__":
    main()
