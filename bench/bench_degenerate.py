"""Wall SLAM where geometry says little: errors of odometry, of ours, and their covariances.

Usage: python bench/bench_degenerate.py [WORLD ...] [--seeds N] [--no-odometry]. Prints a table of
the simulator's worlds; asserts nothing. Each seed draws the errors of the wheels anew: a scale and
a drift that are constant in a run, and noise.

Each world has a motion that nothing shows: a shift along a corridor, a rotation about the middle of
a round hall. The error along it is that motion of the last pose; odometry's is the sum of what its
steps are off by along it, seen by its own covariance, from the true pose of each step. In a
corridor these are its steps in the true heading.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tccm_ros.config import Config
from tccm_ros.geometry import between2, planar
from tccm_ros.records import Odometry, PosedScan, Scan
from tccm_ros.slam.odometry_model import odometry_covariance
from tccm_ros.slam.wall_slam import WallSlam
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.motion import OdometryErrors
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

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

Unseen = Callable[[np.ndarray], np.ndarray]
"""Returns the unseen motion at a pose (3,), in its frame: (m, m, rad), of 1 m or of 1 rad."""


def shift(direction: float) -> Unseen:
    """Return a shift along a direction, rad, in the frame of the first pose."""
    return lambda pose: np.array([np.cos(direction - pose[2]), np.sin(direction - pose[2]), 0.0])


def rotation(x: float, y: float) -> Unseen:
    """Return a rotation about a point, m, in the frame of the first pose."""

    def at(pose: np.ndarray) -> np.ndarray:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        dx, dy = pose[0] - x, pose[1] - y
        return np.array([-c * dy + s * dx, s * dy + c * dx, 1.0])

    return at


UNSEEN: dict[str, Unseen] = {
    "front": shift(0.5 * np.pi),
    "pole": rotation(2.5, 0.8),
    "round_hall": rotation(0.0, 0.0),
}
"""Where it is not a shift along the x axis."""

HEAD = (
    f"{'':16} {'standing':>15} {'unseen, mm or mrad':>19} {'seen':>15} {'NEES':>15} {'':>6}\n"
    f"{'world':16} {'mm':>8} {'deg':>6} {'odometry':>10} {'ours':>8} "
    f"{'mm':>8} {'deg':>6} {'unseen':>8} {'seen':>6} {'lost':>6}"
)


class Drive(NamedTuple):
    """Level scans with odometry, the true poses (N, 3) relative to the first, and who stands."""

    scans: list[PosedScan]
    truth: np.ndarray
    stands: np.ndarray


class Outcome(NamedTuple):
    """Errors of one run.

    Attributes
    ----------
    standing
        Largest distance (m) and yaw (rad) from the true pose while the robot stood at first.
    odometry, ours
        Error of the last pose along the unseen motion, m or rad.
    seen
        The rest of that error: distance (m) and yaw (rad).
    nees
        NEES along the unseen motion, and per degree of freedom of the other two; NaN for a robot
        that has not moved.
    is_lost
        Whether it had no place in the map in the end; the last pose is then that before.
    """

    standing: np.ndarray
    odometry: float
    ours: float
    seen: np.ndarray
    nees: np.ndarray
    is_lost: bool


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


def unseen_error_of_odometry(drive: Drive, unseen: Unseen, last: int) -> float:
    """Return the sum of the errors of odometry's steps along the unseen motion, m or rad."""
    model, error = Config().odometry, 0.0
    odometry = np.stack([planar(s.T_odom_base[0]) for s in drive.scans[: last + 1]])
    for k in range(1, last + 1):
        step = between2(odometry[k - 1], odometry[k])
        if not step.any():
            continue
        wrong = between2(between2(drive.truth[k - 1], drive.truth[k]), step)
        motion = unseen(drive.truth[k])
        weighted = np.linalg.solve(odometry_covariance(step, model), motion)
        error += float(weighted @ wrong) / float(weighted @ motion)
    return error


def run(drive: Drive, unseen: Unseen) -> Outcome:
    """Map a drive and compare it with the truth."""
    slam = WallSlam(Config())
    live = np.array([slam.add_scan(scan).pose for scan in drive.scans])
    solution = slam.solve()
    standing = np.abs(between2(drive.truth, live))[drive.stands]
    # The newest keyframe that has a place in the map, and not beside it.
    saved = slam.saved(solution)
    beside = dict(saved.get("unjoined_sessions", np.zeros((0, 2), np.int64)).tolist())
    mapped = [n for n, session in enumerate(saved["keyframe_session"]) if session not in beside]
    keyframe, cov = solution.keyframes[mapped[-1]], solution.cov_keyframes[mapped[-1]]
    at = int(np.searchsorted(solution.stamps_ns, keyframe.stamp_ns))
    error, motion = between2(drive.truth[at], keyframe.pose), unseen(drive.truth[at])
    ours = float(motion @ error) / float(motion @ motion)
    rest = error - ours * motion
    nees = np.full(2, np.nan)
    if at:
        dual = motion / float(motion @ motion)
        others = np.linalg.svd(motion[None])[2][1:]
        seen = others @ error
        nees[0] = ours**2 / float(dual @ cov @ dual)
        nees[1] = seen @ np.linalg.solve(others @ cov @ others.T, seen) / 2.0
    return Outcome(
        np.array([np.hypot(*standing.T[:2]).max(), standing[:, 2].max()]),
        unseen_error_of_odometry(drive, unseen, at),
        ours,
        np.array([np.hypot(*rest[:2]), abs(rest[2])]),
        nees,
        slam.is_lost or slam.is_unjoined,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="*", default=list(ROWS), help="; ".join(ROWS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--no-odometry", action="store_true", help="a bare laser")
    options = parser.parse_args()
    print(HEAD)
    for row in options.rows:
        world, settings = ROWS[row]
        unseen = UNSEEN.get(world, shift(0.0))
        runs = [
            run(simulated(world, settings, seed, not options.no_odometry), unseen)
            for seed in range(options.seeds)
        ]
        standing = np.max([r.standing for r in runs], axis=0)
        odometry, ours = (np.sqrt(np.mean([r[k] ** 2 for r in runs])) for k in (1, 2))
        seen = np.sqrt(np.mean(np.square([r.seen for r in runs]), axis=0))
        nees = np.mean([r.nees for r in runs], axis=0)
        print(
            f"{row:16} {1e3 * standing[0]:8.1f} {np.degrees(standing[1]):6.2f} "
            f"{1e3 * odometry:10.1f} {1e3 * ours:8.1f} "
            f"{1e3 * seen[0]:8.1f} {np.degrees(seen[1]):6.2f} "
            f"{nees[0]:8.2f} {nees[1]:6.2f} {sum(r.is_lost for r in runs):6}",
            flush=True,
        )


if __name__ == "__main__":
    main()
