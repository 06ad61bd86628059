"""Corners in M-space, as the second paper publishes them, beside ours: a Markdown table.

Usage: python bench/mspace_corners.py [--shared FOLDER] [--worlds flat ring intel mit-csail]

The second paper's walls are features of the M-space (III.A.1, III.C): the free variables are their
endpoints, which walls that meet have in common, and the derivatives of a measurement
eta = (phi, rho) come from the chain rule over building blocks. Here a wall with a corner has two
endpoints for variables, the corner's being that of the other wall as well; an observation of it is
a custom factor of the keyframe and both endpoints. All other walls, all observations, their noise,
the loop closures and the association are the same in all rows, so that the rows differ in the
corners alone: none; ours (a point that two planes pass through); M-space.

Before the table the derivatives are compared with differences. The positions are compared with the
truth of every scan (rms after alignment), or with references by pairs of rows less than 3 m from
each other with more than 10 m of path between them. Logs that are not there are left out.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
from bench_slam import HERE, scans_of
from drives import run_drives

from tccm_ros.arrays import Float64
from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import choose_topics
from tccm_ros.config import Config
from tccm_ros.evaluate.trajectory_errors import (
    absolute_errors,
    pairs_that_meet,
    poses_at,
    relation_errors,
)
from tccm_ros.evaluate.truth_files import read_reference, read_stamps
from tccm_ros.geometry import inverse, spatial, wrap_angle
from tccm_ros.replay.processors import Pipeline
from tccm_ros.results.trajectory import read_tum
from tccm_ros.robot import MountKind
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.factors.noise import gaussian
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.inliers import Inliers
from tccm_ros.slam.trajectory import scan_poses
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.corners import POINT_SIGMA, Corner, corner_factors, meeting_point
from tccm_ros.slam.walls.landmarks import wall_factors
from tccm_sim.carmen import import_carmen

ROOT = HERE.parent

FREE_SIGMA = 1.0
"""Of the endpoint of a wall that no other wall shares, m: nothing observes it along the wall."""


def point_in_frame(pose: gtsam.Pose3, point: Float64) -> tuple[Float64, Float64, Float64]:
    """Return a point (2,) in the frame of a pose, and its derivatives.

    Returns
    -------
    p
        float64 (2,), m.
    by_pose
        float64 (2, 6), by the pose's tangent (rotation, translation).
    by_point
        float64 (2, 2).
    """
    R = pose.rotation().matrix()[:2, :2]
    p = R.T @ (point - pose.translation()[:2])
    by_pose = np.zeros((2, 6))
    by_pose[:, 2] = p[1], -p[0]
    by_pose[:, 3:5] = -np.eye(2)
    return p, by_pose, R.T


def line_through(p: Float64, q: Float64, phi: float) -> tuple[Float64, Float64, Float64]:
    """Return eta = (phi, rho) of the line through two points, and its derivatives.

    Parameters
    ----------
    p, q
        float64 (2,), m.
    phi
        About the direction of its normal, rad: a line has two.

    Returns
    -------
    eta
        float64 (2,), rad and m.
    by_p, by_q
        float64 (2, 2).
    """
    d = q - p
    length = float(np.hypot(*d))
    left = np.array([-d[1], d[0]]) / length
    normal = left if left @ (np.cos(phi), np.sin(phi)) > 0.0 else -left
    rotated = np.array([-normal[1], normal[0]])
    swing = left / length  # of phi, by a motion of q
    eta = np.array([np.arctan2(normal[1], normal[0]), normal @ p])
    arm = rotated @ p
    return eta, np.stack([-swing, normal - arm * swing]), np.stack([swing, arm * swing])


@dataclass(frozen=True, eq=False)
class Custom:
    """A factor written in Python: a function of some variables and its derivatives."""

    symbols: tuple[int, ...]
    noise: gtsam.noiseModel.Base
    error: Callable[[gtsam.Values], tuple[Float64, list[Float64]]]
    starts: tuple[tuple[Key, Float64], ...]

    @property
    def landmark(self) -> Key | None:
        """The endpoint that it starts."""
        return self.starts[0][0] if self.starts else None

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add the custom factor."""

        def evaluate(_: Any, values: gtsam.Values, jacobians: list[Float64] | None) -> Float64:
            residual, derivatives = self.error(values)
            if jacobians is not None:
                for n, part in enumerate(derivatives):
                    jacobians[n] = np.asfortranarray(part)
            return residual

        graph.add(gtsam.CustomFactor(self.noise, list(self.symbols), evaluate))

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return where the endpoint starts."""
        return list(self.starts)


def observed_wall(seen: WallObservation, ends: tuple[Key, Key]) -> Custom:
    """Return the factor of a wall that is known by its endpoints."""
    k, p, q = seen.keyframe.symbol, ends[0].symbol, ends[1].symbol
    phi = seen.phi - seen.keyframe.yaw_offset

    def error(values: gtsam.Values) -> tuple[Float64, list[Float64]]:
        pose = values.atPose3(k)
        a, a_pose, a_point = point_in_frame(pose, values.atPoint2(p))
        b, b_pose, b_point = point_in_frame(pose, values.atPoint2(q))
        eta, by_a, by_b = line_through(a, b, phi)
        residual = np.array([wrap_angle(eta[0] - phi), eta[1] - seen.rho])
        return residual, [by_a @ a_pose + by_b @ b_pose, by_a @ a_point, by_b @ b_point]

    return Custom((k, p, q), gaussian(seen.cov), error, ())


def observed_end(keyframe: Key, end: Key, point: Float64, sigma: float) -> Custom:
    """Return the factor of an endpoint that a keyframe saw."""
    k, p, angle = keyframe.symbol, end.symbol, -keyframe.yaw_offset
    c, s = np.cos(angle), np.sin(angle)
    measured = np.array([[c, -s], [s, c]]) @ point

    def error(values: gtsam.Values) -> tuple[Float64, list[Float64]]:
        at, by_pose, by_point = point_in_frame(values.atPose3(k), values.atPoint2(p))
        return at - measured, [by_pose, by_point]

    return Custom((k, p), gtsam.noiseModel.Isotropic.Sigma(2, sigma), error, ())


def started_end(end: Key, at: Float64, sigma: float) -> Custom:
    """Return the factor that starts an endpoint and holds it loosely."""

    def error(values: gtsam.Values) -> tuple[Float64, list[Float64]]:
        return values.atPoint2(end.symbol) - at, [np.eye(2)]

    noise = gtsam.noiseModel.Isotropic.Sigma(2, sigma)
    return Custom((end.symbol,), noise, error, ((end, at),))


def ends_of_walls(
    table: WallTable, corners: Sequence[Corner]
) -> tuple[dict[int, tuple[Key, Key]], dict[Key, Float64], dict[int, Key]]:
    """Return the endpoints of each wall with a corner, where they start, and those of corners.

    Where two corners are at one end of a wall the outermost is its endpoint; the other is left to
    the wall that has it at its end.
    """
    found: dict[int, dict[int, tuple[float, int]]] = defaultdict(dict)
    points = [meeting_point(table.phi[[c.a, c.b]], table.rho[[c.a, c.b]]) for c in corners]
    for n, corner in enumerate(corners):
        for w in (corner.a, corner.b):
            tangent = np.array([-np.sin(table.phi[w]), np.cos(table.phi[w])])
            along = float(points[n] @ tangent - table.extent[w].mean())
            side = int(along > 0.0)
            if side not in found[w] or abs(along) > abs(found[w][side][0]):
                found[w][side] = along, n
    ends, starts, keys = {}, {}, {}
    for w, sides in sorted(found.items()):
        pair = []
        for side in (0, 1):
            if side in sides:
                key = Key("e", sides[side][1])
                starts[key], keys[sides[side][1]] = points[sides[side][1]], key
            else:
                key = Key("f", 2 * w + side)
                normal = np.array([np.cos(table.phi[w]), np.sin(table.phi[w])])
                tangent = np.array([-normal[1], normal[0]])
                starts[key] = table.rho[w] * normal + table.extent[w, side] * tangent
            pair.append(key)
        ends[w] = pair[0], pair[1]
    return ends, starts, keys


def mspace_factors(walls: Sequence[Factor], used: Inliers, keys: Sequence[Key]) -> list[Factor]:
    """Return the factors of all walls, those with corners by their endpoints."""
    ends, starts, shared = ends_of_walls(used.walls, used.corners)
    factors: list[Factor] = [started_end(key, at, FREE_SIGMA) for key, at in starts.items()]
    for seen in walls:
        assert isinstance(seen, WallObservation)
        pair = ends.get(seen.wall.number)
        factors.append(seen if pair is None else observed_wall(seen, pair))
    for n, corner in enumerate(used.corners):
        if n in shared:
            sigma = POINT_SIGMA * float(np.sqrt(len(corner.points)))
            for k, point in zip(corner.keyframes, corner.points, strict=True):
                factors.append(observed_end(keys[k], shared[n], point, sigma))
    return factors


def none_factors(walls: Sequence[Factor], used: Inliers, keys: Sequence[Key]) -> list[Factor]:
    """Return the factors of all walls without corners."""
    return list(walls)


def our_factors(walls: Sequence[Factor], used: Inliers, keys: Sequence[Key]) -> list[Factor]:
    """Return the factors of all walls, and points that two of them pass through."""
    return [*walls, *corner_factors(used.corners, used.walls, keys, Config())]


def endpoint_factors(walls: Sequence[Factor], used: Inliers, keys: Sequence[Key]) -> list[Factor]:
    """Return the factors of all walls, and corners that are their endpoints."""
    config = Config()
    config.walls.corners = "endpoint"
    return [*walls, *corner_factors(used.corners, used.walls, keys, config)]


ROWS = {
    "none": none_factors,
    "`point`": our_factors,
    "`endpoint`": endpoint_factors,
    "M-space by the chain rule": mspace_factors,
}


def check_derivatives(step: float = 1e-6) -> float:
    """Return the largest difference of a derivative from central differences."""
    rng, worst = np.random.default_rng(0), 0.0
    for _ in range(100):
        keyframe, ends = Key("x", 0, float(rng.uniform(-3, 3))), (Key("e", 0), Key("e", 1))
        values = gtsam.Values()
        values.insert(keyframe.symbol, keyframe.to_value(spatial(rng.uniform(-3, 3, 3))))
        for end in ends:
            values.insert(end.symbol, rng.uniform(-5, 5, 2))
        seen = WallObservation(keyframe, Key("w", 0), *rng.uniform(-3, 3, 2), np.eye(2))
        for factor in (observed_wall(seen, ends), observed_end(keyframe, ends[0], np.ones(2), 1.0)):
            _, derivatives = factor.error(values)
            for symbol, by in zip(factor.symbols, derivatives, strict=True):
                for axis in range(by.shape[1]):
                    if by.shape[1] == 6 and axis in {0, 1, 5}:
                        continue  # roll, pitch and z are held at zero
                    sides = [
                        factor.error(values.retract(_along(values, symbol, axis, d)))[0]
                        for d in (step, -step)
                    ]
                    change = sides[0] - sides[1]
                    change[0] = wrap_angle(change[0]) if len(factor.symbols) == 3 else change[0]
                    worst = max(worst, float(np.abs(change / (2 * step) - by[:, axis]).max()))
    return worst


def _along(values: gtsam.Values, symbol: int, axis: int, step: float) -> gtsam.VectorValues:
    """Return a change of one variable along one axis of its tangent."""
    zeros, delta = values.zeroVectors(), gtsam.VectorValues()
    for other in values.keys():  # noqa: SIM118 - no mapping
        change = np.array(zeros.at(other))
        if other == symbol:
            change[axis] = step
        delta.insert(other, change)
    return delta


def solved(slam: WallSlam, used: Inliers, factors: Sequence[Factor]) -> tuple[Float64, int]:
    """Return the poses of all scans, planar (N, 3), and the iterations it took."""
    keys = slam._chain.keys
    graph = slam._chain.graph(used.poses, slam._closer.fixed_starts(used.loops))
    graph.add([p.factor(keys) for p in used.loops])
    graph.add(factors)
    solution = graph.optimise()
    poses = solution.planar_poses(keys)
    return scan_poses(slam._front.tracked, slam._chain.keyframes, poses), solution.iterations


def print_rows(world: str, slam: WallSlam, error_of: Callable[[Float64], str]) -> None:
    """Print the rows of one drive."""
    used = slam._inliers()
    walls = wall_factors(used.walls, slam._lines, slam._chain.keys, slam.config)
    for name, make in ROWS.items():
        start = time.process_time()
        poses, iterations = solved(slam, used, make(walls, used, slam._chain.keys))
        seconds = time.process_time() - start
        print(
            f"| {world} | {len(used.corners)} | {name} | {error_of(poses)} | {iterations}"
            f" | {seconds:.2f} |",
            flush=True,
        )


def simulated(world: str, bag: Path, _folder: Path) -> None:
    """Print the rows of a simulated world, from its level laser."""
    truth, config = read_tum(bag / "truth.tum"), Config()
    with BagReader(bag) as reader:
        choice = choose_topics(reader, config, [])
        reader.add_readers(choice.readers)
        level = [s for s in choice.streams if s.mount is MountKind.LEVEL]
        others = {s.role for s in choice.streams} - {s.role for s in level}
        topics = {role: name for role, name in choice.topics.items() if role not in others}
        pipeline = Pipeline(config, streams=level, expects_odometry=True)
        for role, _, record in reader.records(topics):
            pipeline.add(role, record)
        pipeline.finish()
    slam = pipeline.slam.wall_slam
    stamps = np.array([p.stamp_ns for p in slam._front.tracked], np.int64)
    at, is_known = poses_at(truth.stamps_ns, truth.T_map_base, stamps)

    def error_of(poses: Float64) -> str:
        found = absolute_errors(spatial(poses)[is_known], at[is_known], aligned=True)
        return f"{1e3 * np.sqrt(np.mean(found.translation**2)):.2f} mm"

    print_rows(world, slam, error_of)


def recorded(log: Path, folder: Path) -> None:
    """Print the rows of a public log."""
    bag = folder / log.name.split(".")[0]
    import_carmen(log, bag)
    slam = WallSlam(Config())
    for scan in scans_of(bag):
        slam.add_scan(scan)
    stamps = read_stamps(bag / "stamps.csv")
    truth = read_reference(log.with_name(f"{bag.name}_reference.txt"))
    i, j = pairs_that_meet(truth.poses[:, :3, 3]).T
    known = np.array([p.stamp_ns for p in slam._front.tracked], np.int64)
    wanted = np.array([stamps[int(k)] for k in truth.scan_index], np.int64)
    rows = np.clip(np.searchsorted(known, wanted), 0, len(known) - 1)

    def error_of(poses: Float64) -> str:
        at = spatial(poses[rows])
        found = relation_errors(at[i], at[j], inverse(truth.poses[i]) @ truth.poses[j])
        return f"{found.translation.mean():.4f} +- {found.translation.std():.4f} m"

    print_rows(bag.name, slam, error_of)


def main() -> None:
    """Print the table."""
    print(f"derivatives differ by at most {check_derivatives():.1e} from differences\n")
    run_drives(
        __doc__.partition("\n")[0],
        ("drive", "corners", "corners as", "position", "iterations", "seconds"),
        simulated,
        recorded,
    )


if __name__ == "__main__":
    main()
