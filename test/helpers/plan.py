"""A floor plan of line segments, a robot that drives in it, and its level scans: the tests' truth.

It has no code in common with the code under test: rays and segments are intersected by its own
formula.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rays import ranges_to_sides

from tccm_ros.records import PosedScan, Scan

Float64 = NDArray[np.float64]

BEAMS = 181


def matrix(pose: Sequence[float] | Float64) -> Float64:
    """Return the (4, 4) matrix of a planar pose."""
    x, y, yaw = pose
    T = np.eye(4)
    T[0, 0] = T[1, 1] = np.cos(yaw)
    T[1, 0], T[0, 1] = np.sin(yaw), -np.sin(yaw)
    T[:2, 3] = x, y
    return T


def planar(T: Float64) -> Float64:
    return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])


def box(x0: float, y0: float, x1: float, y1: float) -> Float64:
    """Return the four sides of a rectangle, (4, 2, 2)."""
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def ring(length: float = 12.0, width: float = 9.0, half: float = 1.0) -> Float64:
    """Return a ring of corridors with different niches in every part."""
    outer = box(-half, -half, length + half, width + half)
    inner = box(half, half, length - half, width - half)
    blocks = [
        box(3.0, -half, 3.7, -half + 0.3),
        box(6.5, half - 0.3, 7.3, half),
        box(length + half - 0.4, 3.0, length + half, 3.5),
        box(4.0, width + half - 0.35, 5.2, width + half),
        box(8.0, width - half, 8.6, width - half + 0.3),
        box(-half, 5.5, -half + 0.3, 6.1),
    ]
    return np.concatenate([outer, inner, *blocks])


def cast(walls: Float64, pose: Float64, bearings: Float64, max_range: float = 20.0) -> Float64:
    """Return the range of each beam (N,) from a planar pose of the laser; inf without a return."""
    angles = pose[2] + bearings
    d = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ranges = ranges_to_sides(d, walls[:, 0] - pose[:2], walls[:, 1] - walls[:, 0], 1e-6)
    return np.where(ranges < max_range, ranges, np.inf)


def route(
    corners: Sequence[tuple[float, float]], step: float = 0.1, yaw_step: float = 0.15
) -> Float64:
    """Return planar poses (N, 3) along straight lines, turning in place at the corners."""
    points = np.array(corners, float)
    legs = np.diff(points, axis=0)
    headings = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    poses = [np.array([*points[0], headings[0]])]
    for k, (leg, heading) in enumerate(zip(legs, headings)):
        swing = heading - poses[-1][2]
        for f in np.linspace(0.0, 1.0, int(np.ceil(abs(swing) / yaw_step)) + 1)[1:]:
            poses.append(np.array([*points[k], heading - (1.0 - f) * swing]))
        for f in np.linspace(0.0, 1.0, int(np.ceil(np.hypot(*leg) / step)) + 1)[1:]:
            poses.append(np.array([*(points[k] + f * leg), heading]))
    return np.stack(poses)


@dataclass
class Run:
    """True poses and measurements of a drive, relative to the first pose."""

    truth: Float64
    scans: list[PosedScan]

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        return np.array([s.scan.stamp_ns for s in self.scans], np.int64)


def drive(
    walls: Float64,
    poses: Float64,
    *,
    seed: int = 0,
    sigma: float = 0.01,
    drift: float = 0.012,
    scale: float = 1.01,
    noise: tuple[float, float] = (0.01, 0.01),
    mount: Sequence[float] = (0.1, 0.0, 0.0),
    beams: int = BEAMS,
    odometry: bool = True,
    start_ns: int = 10**18,
) -> Run:
    """Return the run of a drive along `poses`, with a scan at each.

    Odometry has a yaw drift `drift`, rad/m, a scale error `scale`, and noise `noise`, m and rad per
    root m.
    """
    random = np.random.default_rng(seed)
    bearings = np.linspace(-np.pi / 2, np.pi / 2, beams)
    T_base_laser = matrix(mount)
    T_odom, scans, truth = np.eye(4), [], []
    T_first = matrix(poses[0])
    for k, pose in enumerate(poses):
        if k:
            step = planar(np.linalg.inv(matrix(poses[k - 1])) @ matrix(pose))
            distance = np.hypot(step[0], step[1])
            error = random.normal(size=3) * np.sqrt(distance + 0.2 * abs(step[2]))
            step = np.array([step[0] * scale, step[1] * scale, step[2] + drift * distance])
            T_odom = T_odom @ matrix(step + error * [noise[0], noise[0], noise[1]])
        ranges = cast(walls, planar(matrix(pose) @ T_base_laser), bearings)
        ranges = ranges + random.normal(size=beams) * sigma
        stamp = start_ns + k * 100_000_000
        scan = Scan(
            stamp,
            "laser",
            float(bearings[0]),
            float(bearings[1] - bearings[0]),
            0.0,
            0.05,
            30.0,
            ranges.astype(np.float32),
        )
        T = T_odom if odometry else np.eye(4)
        T_laser = T_base_laser[None]
        posed = PosedScan(scan, np.array([stamp]), T[None], T_laser, "scan", has_odometry=odometry)
        scans.append(posed)
        truth.append(planar(np.linalg.inv(T_first) @ matrix(pose)))
    return Run(np.stack(truth), scans)


def errors(truth: Float64, poses: Float64) -> tuple[float, float]:
    """Return the rms errors of position (m) and heading (rad)."""
    dyaw = np.arctan2(np.sin(poses[:, 2] - truth[:, 2]), np.cos(poses[:, 2] - truth[:, 2]))
    return (
        float(np.sqrt(np.mean(np.sum((poses[:, :2] - truth[:, :2]) ** 2, axis=1)))),
        float(np.sqrt(np.mean(dyaw**2))),
    )
