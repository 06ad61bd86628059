"""Wall SLAM where geometry says little: errors of odometry, of ours, and their covariances.

Usage: python bench/bench_degenerate.py [WORLD ...] [--seeds N] [--no-odometry]. Prints a table of
the simulator's worlds; asserts nothing. Each seed draws the errors of the wheels anew: a scale and
a drift that are constant in a run, and noise. The errors of odometry along and across are those of
its steps in the true heading.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2, planar
from tccm_ros.pipeline.sim.engine import EPOCH_NS, Simulation
from tccm_ros.pipeline.sim.motion import OdometryErrors
from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.worlds import build_world
from tccm_ros.records import Odometry, PosedScan, Scan
from tccm_ros.slam.wall_slam import WallSlam

ROWS: dict[str, tuple[str, Options]] = {
    **{
        f"front {d} m, {1e3 * sigma:.0f} mm": (
            "front",
            Options(translation=(d - 1.0, 0.0, 0.0), level_sigma=sigma),
        )
        for d in (0.4, 1.0, 3.0)
        for sigma in (0.005, 0.010)
    },
    **{
        name: (name, Options())
        for name in (
            "corridor",
            "single_wall",
            "pole",
            "round_hall",
            "glass_corridor",
            "lift",
            "turning",
        )
    },
}
"""World and options of each row."""

SCALE_SIGMA, YAW_SCALE_SIGMA, DRIFT_SIGMA = 0.01, 0.005, 0.01
"""Standard deviations of the wheels' scales (1) and of their drift (rad/m) over robots (chosen)."""

HEAD = (
    f"{'':16} {'standing':>15} {'odometry':>24} {'ours':>24} {'NEES':>21}\n"
    f"{'world':16} {'mm':>8} {'deg':>6} {'along m':>8} {'across':>8} {'deg':>6} "
    f"{'along m':>8} {'across':>8} {'deg':>6} {'along':>7} {'across':>6} {'yaw':>6}"
)


class Drive(NamedTuple):
    """Level scans with odometry, the true poses (N, 3) relative to the first, and who stands."""

    scans: list[PosedScan]
    truth: np.ndarray
    stands: np.ndarray


class Outcome(NamedTuple):
    """Errors of one run: m, m, rad; NEES of (x, y, yaw) in the last keyframe's frame."""

    standing: np.ndarray
    odometry: np.ndarray
    ours: np.ndarray
    nees: np.ndarray


def simulated(world_name: str, options: Options, seed: int, has_odometry: bool) -> Drive:
    """Drive through a world with wheels whose errors the seed draws."""
    options = options.model_copy(update={"tilt": False, "self_hits": False})
    random = np.random.default_rng(1000 + seed)
    scale, yaw_scale, drift = random.normal(size=3) * (SCALE_SIGMA, YAW_SCALE_SIGMA, DRIFT_SIGMA)
    world = build_world(world_name, options)
    errors = OdometryErrors(1.0 + scale, 1.0 + yaw_scale, drift)
    simulation = Simulation(replace(world, rig=replace(world.rig, errors=errors)), seed, options)
    stamps, poses, scans = [], [], []
    for message in simulation.run():
        record = message.records[0]
        if isinstance(record, Odometry):
            stamps.append(record.stamp_ns)
            poses.append(planar(record.T_odom_base))
        elif isinstance(record, Scan):
            scans.append(record)
    rig = simulation.rig
    T_base_laser = rig.laser_poses(rig.level_frame, {}, 1)[0]
    wheels, yaw = np.array(poses), np.unwrap(np.array(poses)[:, 2])
    posed, truth = [], []
    for scan in scans:
        ends = scan.stamp_ns + np.array([0, round(rig.level.offsets[-1] * 1e9)])
        T = np.stack([matrix(_pose_at(t, stamps, wheels, yaw)) for t in ends])
        if not has_odometry:
            T = np.broadcast_to(np.eye(4), T.shape)
        T_laser = np.broadcast_to(T_base_laser, (2, 4, 4))
        posed.append(PosedScan(scan, ends, T, T_laser, has_odometry=has_odometry))
        truth.append(planar(simulation.true_poses(np.array([(ends[0] - EPOCH_NS) * 1e-9]))[0]))
    times = np.array([s.scan.stamp_ns - EPOCH_NS for s in posed]) * 1e-9
    return Drive(posed, between2(truth[0], np.array(truth)), times < world.drive.stops[0, 1])


def _pose_at(stamp_ns: int, stamps: list[int], wheels: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    x, y = (np.interp(stamp_ns, stamps, wheels[:, k]) for k in range(2))
    return np.array([x, y, np.interp(stamp_ns, stamps, yaw)])


def matrix(pose: np.ndarray) -> np.ndarray:
    """Return the transform (4, 4) of a planar pose (3,)."""
    T = np.eye(4)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    T[:2, :2], T[:2, 3] = ((c, -s), (s, c)), pose[:2]
    return T


def wheels_with_true_heading(drive: Drive) -> np.ndarray:
    """Return the last pose (3,) by odometry's steps, each in the true heading."""
    odometry = np.stack([planar(s.T_odom_base[0]) for s in drive.scans])
    pose = np.zeros(3)
    for before, now, heading in zip(odometry, odometry[1:], drive.truth[:, 2]):
        pose = compose2(np.array([*pose[:2], heading]), between2(before, now))
    return pose


def run(drive: Drive) -> Outcome:
    """Map a drive and compare it with the truth."""
    slam = WallSlam(Config())
    live = np.array([slam.add_scan(scan).pose for scan in drive.scans])
    solution = slam.solve()
    standing = np.abs(between2(drive.truth, live))[drive.stands]
    odometry = planar(drive.scans[-1].T_odom_base[0])
    start = planar(drive.scans[0].T_odom_base[0])
    heading = between2(start, odometry)[2]
    along = between2(drive.truth[-1], wheels_with_true_heading(drive))
    last = solution.keyframes[-1]
    at = int(np.searchsorted(solution.stamps_ns, last.stamp_ns))
    error, variance = between2(drive.truth[at], last.pose), np.diag(solution.cov_keyframes[-1])
    return Outcome(
        np.array([np.hypot(*standing.T[:2]).max(), standing[:, 2].max()]),
        np.array([*along[:2], np.angle(np.exp(1j * (heading - drive.truth[-1, 2])))]),
        between2(drive.truth[-1], solution.poses[-1]),
        error**2 / variance if at else np.full(3, np.nan),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="*", default=list(ROWS), help="; ".join(ROWS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--no-odometry", action="store_true", help="a bare laser")
    options = parser.parse_args()
    print(HEAD)
    for row in options.rows:
        runs = [
            run(simulated(*ROWS[row], seed, not options.no_odometry))
            for seed in range(options.seeds)
        ]
        standing = np.max([r.standing for r in runs], axis=0)
        odometry, ours = (np.sqrt(np.mean(np.square([r[k] for r in runs]), axis=0)) for k in (1, 2))
        along, across, yaw = np.mean([r.nees for r in runs], axis=0)
        print(
            f"{row:16} {1e3 * standing[0]:8.1f} {np.degrees(standing[1]):6.2f} "
            f"{odometry[0]:8.3f} {odometry[1]:8.3f} {np.degrees(odometry[2]):6.2f} "
            f"{ours[0]:8.3f} {ours[1]:8.3f} {np.degrees(ours[2]):6.2f} "
            f"{along:7.2f} {across:6.2f} {yaw:6.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
