"""Walls from line observations: which line of which keyframe is which wall.

Association runs over all keyframes in order, on poses that are already optimised without walls, so
that it never depends on when a scan arrived. A wall is held as the pooled moments of its segments:
adding a segment is exact, and the least-squares line of all of them costs nothing. Each side of a
wall is a wall of its own, because a scan sees one side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.lines import Lines
from tccm_ros.slam.se2 import place

__all__ = ["WallTable", "associate_walls", "confirmations"]

Float64 = NDArray[np.float64]

JOINT_CHI2_PER_LINE = 6.0
"""Lines of one scan fit their walls with one small common correction; a worse fit than this per
line drops the worst line."""


@dataclass(frozen=True, slots=True, eq=False)
class WallTable:
    """Observations and the walls they belong to.

    Attributes
    ----------
    keyframe, line
        int64 (M,): observation m is line `line[m]` of keyframe `keyframe[m]`.
    wall
        int64 (M,), index of the wall, -1 where the observation belongs to none that is confirmed.
    phi, rho
        float64 (W,), of each wall in map as pooled, phi on the side away from the viewers.
    extent
        float64 (W, 2), lowest and highest place along the tangent (-sin phi, cos phi), m.
    """

    keyframe: NDArray[np.int64]
    line: NDArray[np.int64]
    wall: NDArray[np.int64]
    phi: Float64
    rho: Float64
    extent: Float64

    def __len__(self) -> int:
        return len(self.phi)

    def keep(self, wall: NDArray[np.int64], least: int) -> WallTable:
        """Return the table with other walls for its observations (-1: none).

        Walls that fewer than `least` keyframes see vanish; the others are renumbered in their
        order.
        """
        pairs = np.unique(np.stack([wall, self.keyframe], axis=1)[wall >= 0], axis=0)
        seen = np.bincount(pairs[:, 0], minlength=len(self))
        keep = seen >= least
        number = np.where(keep, np.cumsum(keep) - 1, -1)
        # The entry at the end is for observations of no wall (-1), also where there is no wall.
        renamed = np.append(number, -1)[wall]
        return WallTable(
            self.keyframe, self.line, renamed, self.phi[keep], self.rho[keep], self.extent[keep]
        )


def confirmations(config: Config, keyframes: int) -> int:
    """Return how many keyframes must see a wall.

    Half of them are enough where a robot has made few: one that stands still has a single keyframe,
    and walls all the same.
    """
    return max(1, min(config.walls.min_observations, (keyframes + 1) // 2))


def associate_walls(poses: Float64, lines: list[Lines], config: Config) -> WallTable:
    """Assign the lines of all keyframes to walls.

    Parameters
    ----------
    poses
        float64 (K, 3), optimised planar poses of the keyframes.
    lines
        Their lines, K of them, in base frames.
    config
        ``walls.*``.
    """
    counts = np.array([len(x) for x in lines], np.int64)
    keyframe = np.repeat(np.arange(len(lines)), counts)
    line = np.concatenate([np.arange(n) for n in counts]) if len(lines) else np.zeros(0, np.int64)
    if not len(keyframe):
        empty = np.zeros(0)
        return WallTable(keyframe, line, line.copy(), empty, empty, np.zeros((0, 2)))
    ends = np.concatenate(
        [place(pose, x.endpoints.reshape(-1, 2)) for pose, x in zip(poses, lines)]
    ).reshape(-1, 2, 2)
    phi = np.concatenate([wrap_angle(x.phi + pose[2]) for pose, x in zip(poses, lines)])
    v_phi = np.concatenate([x.cov[:, 0, 0] for x in lines])
    walls = config.walls
    wall, moments, extent = _associate(
        keyframe,
        ends,
        phi,
        v_phi,
        poses[keyframe, :2].copy(),
        walls.gate_distance,
        walls.gate_angle,
        walls.max_gap,
    )
    table = WallTable(keyframe, line, wall, moments[:, 8], moments[:, 9], extent)
    return table.keep(wall, confirmations(config, len(poses)))


@njit(nogil=True, cache=True)
def _pool(m: Float64, a: Float64, b: Float64, facing: float) -> None:  # pragma: no cover
    """Add the segment a-b to moments m = (mass, x, y, xx, xy, yy, cos, sin, phi, rho)."""
    length = np.hypot(b[0] - a[0], b[1] - a[1])
    cx, cy = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])
    hx, hy = 0.5 * (b[0] - a[0]), 0.5 * (b[1] - a[1])
    m[0] += length
    m[1] += length * cx
    m[2] += length * cy
    m[3] += length * (cx * cx + hx * hx / 3.0)
    m[4] += length * (cx * cy + hx * hy / 3.0)
    m[5] += length * (cy * cy + hy * hy / 3.0)
    m[6] += length * np.cos(facing)
    m[7] += length * np.sin(facing)
    mx, my = m[1] / m[0], m[2] / m[0]
    sxx, sxy, syy = m[3] / m[0] - mx * mx, m[4] / m[0] - mx * my, m[5] / m[0] - my * my
    phi = 0.5 * np.arctan2(2.0 * sxy, sxx - syy) + 0.5 * np.pi
    if np.cos(phi) * m[6] + np.sin(phi) * m[7] < 0.0:
        phi -= np.pi
    m[8] = phi
    m[9] = np.cos(phi) * mx + np.sin(phi) * my


@njit(nogil=True, cache=True)
def _mismatch(
    m: Float64,
    extent: Float64,
    a: Float64,
    b: Float64,
    phi: float,
    v_phi: float,
    gate_distance: float,
    gate_angle: float,
    max_gap: float,
) -> float:  # pragma: no cover - compiled
    """Return the squared Mahalanobis distance of a segment to a wall, inf outside the gate."""
    turn = phi - m[8]
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    if abs(turn) > 0.35:
        return np.inf
    nx, ny = np.cos(m[8]), np.sin(m[8])
    ta, tb = -ny * a[0] + nx * a[1], -ny * b[0] + nx * b[1]
    low, high = min(ta, tb), max(ta, tb)
    if low > extent[1] + max_gap or high < extent[0] - max_gap:
        return np.inf
    away = nx * 0.5 * (a[0] + b[0]) + ny * 0.5 * (a[1] + b[1]) - m[9]
    sigma2 = gate_angle * gate_angle / 9.0 + v_phi
    chi2 = turn * turn / sigma2 + away * away / (gate_distance * gate_distance / 9.0)
    return chi2 if chi2 < 9.2 else np.inf


@njit(nogil=True, cache=True)
def _associate(
    keyframe: NDArray[np.int64],
    ends: Float64,
    phi: Float64,
    v_phi: Float64,
    centres: Float64,
    gate_distance: float,
    gate_angle: float,
    max_gap: float,
) -> tuple[NDArray[np.int64], Float64, Float64]:  # pragma: no cover - compiled
    """Walk over the keyframes: choose the nearest wall for each line, check, pool."""
    n = len(keyframe)
    wall = np.full(n, -1, np.int64)
    moments, extent = np.zeros((n, 10)), np.zeros((n, 2))
    count, start = 0, 0
    while start < n:
        stop = start
        while stop < n and keyframe[stop] == keyframe[start]:
            stop += 1
        for i in range(start, stop):
            best = np.inf
            for k in range(count):
                chi2 = _mismatch(
                    moments[k],
                    extent[k],
                    ends[i, 0],
                    ends[i, 1],
                    phi[i],
                    v_phi[i],
                    gate_distance,
                    gate_angle,
                    max_gap,
                )
                if chi2 < best:
                    best, wall[i] = chi2, k
        _keep_compatible(
            wall, start, stop, ends, phi, v_phi, moments, centres, gate_distance, gate_angle
        )
        for i in range(start, stop):
            k = wall[i]
            if k == -2:
                wall[i] = -1
                continue
            if k < 0:
                k, count = count, count + 1
                wall[i], extent[k, 0], extent[k, 1] = k, np.inf, -np.inf
            _pool(moments[k], ends[i, 0], ends[i, 1], phi[i])
            _extend(moments[k], extent[k], ends[i])
        start = max(stop, start + 1)
    return wall, moments[:count].copy(), extent[:count].copy()


@njit(nogil=True, cache=True)
def _extend(m: Float64, extent: Float64, ends: Float64) -> None:  # pragma: no cover - compiled
    nx, ny = np.cos(m[8]), np.sin(m[8])
    for e in range(2):
        t = -ny * ends[e, 0] + nx * ends[e, 1]
        extent[0], extent[1] = min(extent[0], t), max(extent[1], t)


@njit(nogil=True, cache=True)
def _keep_compatible(
    wall: NDArray[np.int64],
    start: int,
    stop: int,
    ends: Float64,
    phi: Float64,
    v_phi: Float64,
    moments: Float64,
    centres: Float64,
    gate_distance: float,
    gate_angle: float,
) -> None:  # pragma: no cover - compiled
    """Mark with -2 the lines that one common correction of the pose cannot explain."""
    J, r = np.zeros(3), 0.0
    s_d, s_a = gate_distance / 6.0, gate_angle / 6.0
    for _ in range(stop - start):
        H, g, total, used = np.zeros((3, 3)), np.zeros(3), 0.0, 0
        H[0, 0] = H[1, 1] = 1.0 / (s_d * s_d)
        H[2, 2] = 1.0 / (s_a * s_a)
        for i in range(start, stop):
            if wall[i] < 0:
                continue
            used += 1
            for row in range(2):
                r = _residual(row, ends[i], phi[i], moments[wall[i]], centres[i], J)
                w = 1.0 / (s_d * s_d) if row == 0 else 1.0 / (s_a * s_a + v_phi[i])
                total += w * r * r
                for a in range(3):
                    g[a] += w * J[a] * r
                    for b in range(3):
                        H[a, b] += w * J[a] * J[b]
        x = np.linalg.solve(H, g)
        joint = total - (g[0] * x[0] + g[1] * x[1] + g[2] * x[2])
        if used == 0 or joint <= JOINT_CHI2_PER_LINE * used:
            return
        worst, where = -1.0, -1
        for i in range(start, stop):
            if wall[i] < 0:
                continue
            cost = 0.0
            for row in range(2):
                r = _residual(row, ends[i], phi[i], moments[wall[i]], centres[i], J)
                r -= J[0] * x[0] + J[1] * x[1] + J[2] * x[2]
                w = 1.0 / (s_d * s_d) if row == 0 else 1.0 / (s_a * s_a + v_phi[i])
                cost += w * r * r
            if cost > worst:
                worst, where = cost, i
        wall[where] = -2


@njit(nogil=True, cache=True)
def _residual(
    row: int, ends: Float64, phi: float, m: Float64, centre: Float64, J: Float64
) -> float:  # pragma: no cover - compiled
    """Return offset (row 0) or angle (row 1) of a line against its wall, J its derivative."""
    nx, ny = np.cos(m[8]), np.sin(m[8])
    if row == 1:
        J[0], J[1], J[2] = 0.0, 0.0, 1.0
        return np.arctan2(np.sin(phi - m[8]), np.cos(phi - m[8]))
    cx, cy = 0.5 * (ends[0, 0] + ends[1, 0]), 0.5 * (ends[0, 1] + ends[1, 1])
    J[0], J[1] = nx, ny
    J[2] = -nx * (cy - centre[1]) + ny * (cx - centre[0])
    return nx * cx + ny * cy - m[9]
