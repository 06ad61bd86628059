"""Data association of walls: assign the lines of all keyframes to walls.

Association goes over all keyframes in order, with poses optimised without walls, so that it does
not depend on the arrival of scans. A wall is the pooled moments of its segments: adding a segment
is exact, and gives the least-squares line of all. The two sides of a wall are two walls, because a
scan observes one side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.kernels import kernel
from tccm_ros.slam.se2 import transform_points
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.merging import MAX_DPHI, whole_walls
from tccm_ros.slam.walls.pooled import POOLED, extend_pooled, pool_segment

JOINT_CHI2_PER_LINE = 6.0
"""Maximum chi-square per line in the joint fit of a scan's lines to their walls with one common
pose correction; beyond it, the worst line is dropped (chosen)."""

GATE_SIGMAS, GATE_CHI2 = 3.0, 9.2
"""Standard deviations in ``walls.gate_distance`` and ``walls.gate_angle``, and gate on the squared
Mahalanobis distance: 99 % of two degrees of freedom."""

JOINT_GATE_SIGMAS = 6.0
"""Standard deviations in ``walls.gate_distance`` and ``walls.gate_angle`` for the common correction
of a joint fit (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class WallTable:
    """Walls and their observations.

    A wall that bows has several rows, its pieces (`merging`).

    Attributes
    ----------
    keyframe, line
        int64 (M,): observation m is line `line[m]` of keyframe `keyframe[m]`.
    wall
        int64 (M,), index of the wall; -1 for an observation without confirmed wall.
    phi, rho
        float64 (W,), pooled line of each wall in map; phi points away from the observers.
    extent
        float64 (W, 2), minimum and maximum position along the tangent (-sin phi, cos phi), m.
    roughness
        float64 (W,), standard deviation of its lines across the wall, m, without slow pose errors.
    whole
        int64 (W,), equal for the pieces of one wall.
    """

    keyframe: Int64
    line: Int64
    wall: Int64
    phi: Float64
    rho: Float64
    extent: Float64
    roughness: Float64
    whole: Int64

    def __len__(self) -> int:
        return len(self.phi)

    @property
    def endpoints(self) -> Float64:
        """The ends of each wall in map, float64 (W, 2, 2), in the tangent's direction."""
        normal = np.stack([np.cos(self.phi), np.sin(self.phi)], axis=1)
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        along = self.extent[:, :, None] * tangent[:, None]
        return np.asarray((self.rho[:, None] * normal)[:, None] + along)

    def whole_numbers(self) -> Int64:
        """Return the index of each row's whole wall, (W,), in the order of their first pieces."""
        _, first, group = np.unique(self.whole, return_index=True, return_inverse=True)
        return np.asarray(np.argsort(np.argsort(first))[group], np.int64)

    def main_pieces(self) -> list[int]:
        """Return the piece with the most observations of each whole wall, by `whole_numbers`."""
        number = self.whole_numbers()
        seen = np.bincount(self.wall[self.wall >= 0], minlength=len(self))
        walls = range(int(number.max(initial=-1)) + 1)
        return [int(max(np.flatnonzero(number == w), key=seen.item)) for w in walls]

    def joined(self) -> WallTable:
        """Return the table with one row per whole wall.

        It has the line of the piece with the most observations, the extent of all pieces and the
        largest roughness.
        """
        number, rows = self.whole_numbers(), np.array(self.main_pieces(), np.int64)
        ends, phi = self.endpoints, self.phi
        extent, roughness = self.extent[rows], self.roughness[rows]
        for w, row in enumerate(rows):
            along = ends[number == w] @ [-np.sin(phi[row]), np.cos(phi[row])]
            extent[w] = along.min(), along.max()
            roughness[w] = self.roughness[number == w].max()
        wall = np.where(self.wall >= 0, np.append(number, -1)[self.wall], -1)
        return replace(
            self, wall=wall, phi=self.phi[rows], rho=self.rho[rows], extent=extent,
            roughness=roughness, whole=np.arange(len(rows)),
        )  # fmt: skip

    def keep(self, wall: Int64, min_keyframes: int) -> WallTable:
        """Return the table with new walls for its observations (-1: none).

        Walls observed by fewer than `min_keyframes` keyframes, in all of their pieces, and pieces
        without observations are removed; the others are renumbered in order.
        """
        whole = self.whole_numbers()
        seen = keyframes_of(np.append(whole, -1)[wall], self.keyframe, len(self))
        keep = (seen[whole] >= min_keyframes) & np.isin(np.arange(len(self)), wall)
        number = np.where(keep, np.cumsum(keep) - 1, -1)
        # The last entry is for observations without a wall (-1); it also exists without walls.
        renumbered = np.append(number, -1)[wall]
        of_walls = ("phi", "rho", "extent", "roughness", "whole")
        kept = {name: getattr(self, name)[keep] for name in of_walls}
        return replace(self, wall=renumbered, **kept)


def keyframes_of(wall: Int64, keyframe: Int64, walls: int) -> Int64:
    """Return the number of keyframes that observe each wall, int64 (walls,).

    Parameters
    ----------
    wall, keyframe
        int64 (M,), wall of each observation, or -1, and its keyframe.
    walls
        Number of walls.
    """
    used = wall >= 0
    pairs = np.unique(wall[used] + walls * keyframe[used])
    return np.bincount(pairs % max(walls, 1), minlength=walls)


def min_confirmations(config: Config, keyframes: int) -> int:
    """Return the minimum number of keyframes of a confirmed wall.

    It is at most half the number of keyframes: a robot at rest has a single keyframe and sees walls
    as well.
    """
    return max(1, min(config.walls.min_observations, (keyframes + 1) // 2))


class WallAssociation:
    """Assigns lines to walls, keyframe by keyframe.

    Parameters
    ----------
    config
        Group ``walls``.

    Attributes
    ----------
    keyframe, line, wall
        int64 (M,): observation m is line `line[m]` of keyframe `keyframe[m]`, assigned to the wall
        `wall[m]`, confirmed or not; -1 for a line that fits none and begins none.
    """

    def __init__(self, config: Config) -> None:
        limits = config.walls
        self._is_enabled = limits.enabled
        self._gates = _Gates(limits.gate_distance, limits.gate_angle, limits.max_gap)
        self._pooled = np.zeros(0, POOLED)
        self._ends = np.zeros((0, 2, 2))
        self.keyframe, self.line, self.wall = np.zeros((3, 0), np.int64)

    def add(self, first: int, poses: Float64, lines: Sequence[Lines]) -> None:
        """Assign the lines of the next keyframes; none with ``walls.enabled: false``.

        Parameters
        ----------
        first
            Id of the first new keyframe.
        poses
            float64 (K, 3), planar poses of the new keyframes.
        lines
            Lines of the K new keyframes, in base frames.
        """
        counts = np.array([len(x) for x in lines], np.int64)
        keyframe = np.repeat(np.arange(len(lines)), counts)
        if not self._is_enabled or not len(keyframe):
            return
        line = np.concatenate([np.arange(n) for n in counts])
        ends = np.concatenate(
            [transform_points(pose, x.endpoints.reshape(-1, 2)) for pose, x in zip(poses, lines)]
        ).reshape(-1, 2, 2)
        phi = np.concatenate([wrap_angle(x.phi + pose[2]) for pose, x in zip(poses, lines)])
        v_phi = np.concatenate([x.cov[:, 0, 0] for x in lines])
        segments = _Segments(keyframe, ends, phi, v_phi, poses[keyframe, :2].copy())
        wall, self._pooled = _associate(segments, self._gates, self._pooled)
        self._ends = np.concatenate([self._ends, ends])
        self.keyframe = np.append(self.keyframe, first + keyframe)
        self.line, self.wall = np.append(self.line, line), np.append(self.wall, wall)

    def __len__(self) -> int:
        return len(self._pooled)

    def whole(self, thickness: float) -> Int64:
        """Return an index for each row of the table, equal for pieces within a thickness (m)."""
        return whole_walls(self._ends, self.wall, self._pooled, thickness)

    def table(self) -> WallTable:
        """Return all walls, including unconfirmed ones, as if each were whole."""
        pooled, whole = self._pooled, np.arange(len(self._pooled))
        extent = np.stack([pooled["low"], pooled["high"]], axis=1)
        return WallTable(
            self.keyframe, self.line, self.wall, pooled["phi"], pooled["rho"], extent,
            self._roughness(), whole,
        )  # fmt: skip

    def _roughness(self) -> Float64:
        """Return the roughness of each wall, float64 (W,), m.

        It is computed from the steps across the wall between segments consecutive in time: half
        their mean square (von Neumann). Slow pose errors hardly contribute.
        """
        segment = np.flatnonzero(self.wall >= 0)
        wall = self.wall[segment]
        normal = np.stack([np.cos(self._pooled["phi"]), np.sin(self._pooled["phi"])], axis=1)
        middle = self._ends[segment].mean(axis=1)
        offset = np.einsum("nk,nk->n", middle, normal[wall]) - self._pooled["rho"][wall]
        order = np.argsort(wall, kind="stable")
        wall, step = wall[order], np.diff(offset[order])
        same = wall[1:] == wall[:-1]
        count, n = len(self._pooled), wall[1:][same]
        squares = np.bincount(n, step[same] ** 2, minlength=count)
        return np.asarray(np.sqrt(0.5 * squares / np.maximum(np.bincount(n, minlength=count), 1)))


def associate_walls(poses: Float64, lines: Sequence[Lines], config: Config) -> WallTable:
    """Assign the lines of all keyframes to walls with enough confirmations.

    Parameters
    ----------
    poses
        float64 (K, 3), optimised planar poses of the keyframes.
    lines
        Lines of the K keyframes, in base frames.
    config
        Group ``walls``.
    """
    association = WallAssociation(config)
    association.add(0, poses, lines)
    table = replace(association.table(), whole=association.whole(config.walls.thickness))
    if not config.matching.enabled:
        table = table.joined()  # walls alone connect distant keyframes
    return table.keep(table.wall, min_confirmations(config, len(poses)))


class _Segments(NamedTuple):
    """Lines of all keyframes in map, in the order of keyframes.

    Attributes
    ----------
    keyframe
        int64 (N,), ascending.
    ends, phi, v_phi
        float64 (N, 2, 2), (N,) and (N,): endpoints, direction of the normal and its variance.
    centre
        float64 (N, 2), position of the keyframe.
    """

    keyframe: Int64
    ends: Float64
    phi: Float64
    v_phi: Float64
    centre: Float64


class _Gates(NamedTuple):
    """Maximum distance (m), angle (rad) and gap (m) of a line from its wall."""

    distance: float
    angle: float
    max_gap: float


@kernel
def _mismatch(w: Any, segments: _Segments, i: int, gates: _Gates) -> float:
    """Return the squared Mahalanobis distance of segment i from a wall, inf outside the gate."""
    a, b = segments.ends[i, 0], segments.ends[i, 1]
    dphi = segments.phi[i] - w.phi
    dphi = np.arctan2(np.sin(dphi), np.cos(dphi))
    if abs(dphi) > MAX_DPHI:
        return np.inf
    nx, ny = np.cos(w.phi), np.sin(w.phi)
    ta, tb = -ny * a[0] + nx * a[1], -ny * b[0] + nx * b[1]
    low, high = min(ta, tb), max(ta, tb)
    if low > w.high + gates.max_gap or high < w.low - gates.max_gap:
        return np.inf
    away = nx * 0.5 * (a[0] + b[0]) + ny * 0.5 * (a[1] + b[1]) - w.rho
    sigma2 = gates.angle * gates.angle / GATE_SIGMAS**2 + segments.v_phi[i]
    chi2 = dphi * dphi / sigma2 + away * away / (gates.distance * gates.distance / GATE_SIGMAS**2)
    return chi2 if chi2 < GATE_CHI2 else np.inf


@kernel
def _associate(segments: _Segments, gates: _Gates, known: Any) -> tuple[Int64, Any]:
    """Return the wall of each line or -1, and all walls with dtype `POOLED`, known ones first.

    Keyframes are processed in order: choose the nearest wall for each line, check, pool.
    """
    keyframe, n = segments.keyframe, len(segments.keyframe)
    wall = np.full(n, -1, np.int64)
    pooled = np.zeros(len(known) + n, POOLED)
    pooled[: len(known)] = known
    count, start = len(known), 0
    while start < n:
        stop = start
        while stop < n and keyframe[stop] == keyframe[start]:
            stop += 1
        for i in range(start, stop):
            best = np.inf
            for k in range(count):
                chi2 = _mismatch(pooled[k], segments, i, gates)
                if chi2 < best:
                    best, wall[i] = chi2, k
        _keep_compatible(wall, range(start, stop), segments, pooled, gates)
        for i in range(start, stop):
            k = wall[i]
            if k == -2:
                wall[i] = -1
                continue
            if k < 0:
                k, count = count, count + 1
                wall[i], pooled[k].low, pooled[k].high = k, np.inf, -np.inf
            pool_segment(pooled[k], segments.ends[i, 0], segments.ends[i, 1], segments.phi[i])
            extend_pooled(pooled[k], segments.ends[i])
        start = max(stop, start + 1)
    return wall, pooled[:count].copy()


@kernel
def _keep_compatible(
    wall: Int64, lines: range, segments: _Segments, pooled: Any, gates: _Gates
) -> None:
    """Mark with -2 the lines that are inconsistent with a common pose correction."""
    s_d, s_a = gates.distance / JOINT_GATE_SIGMAS, gates.angle / JOINT_GATE_SIGMAS
    prior = np.diag(np.array([s_d, s_d, s_a]) ** -2.0)
    while True:
        used = np.array([i for i in lines if wall[i] >= 0])
        # Offset and angle of each line, and their derivatives by the correction.
        r, J, weights = (
            np.zeros(2 * len(used)),
            np.zeros((2 * len(used), 3)),
            np.zeros(2 * len(used)),
        )
        for n, i in enumerate(used):
            _residual(segments, i, pooled[wall[i]], r[2 * n : 2 * n + 2], J[2 * n : 2 * n + 2])
            weights[2 * n], weights[2 * n + 1] = s_d**-2, 1.0 / (s_a * s_a + segments.v_phi[i])
        W = np.ascontiguousarray((J * weights.reshape(-1, 1)).T)
        g = W @ r
        x = np.linalg.solve(prior + W @ J, g)
        if (weights * r * r).sum() - g @ x <= JOINT_CHI2_PER_LINE * len(used):
            return
        costs = (weights * (r - J @ x) ** 2).reshape(-1, 2).sum(axis=1)
        wall[used[np.argmax(costs)]] = -2


@kernel
def _residual(segments: _Segments, i: int, w: Any, r: Float64, J: Float64) -> None:
    """Write offset and angle of line i from a wall, (2,), and their derivatives, (2, 3)."""
    nx, ny = np.cos(w.phi), np.sin(w.phi)
    ends, centre = segments.ends[i], segments.centre[i]
    cx, cy = 0.5 * (ends[0, 0] + ends[1, 0]), 0.5 * (ends[0, 1] + ends[1, 1])
    dphi = segments.phi[i] - w.phi
    r[0], r[1] = nx * cx + ny * cy - w.rho, np.arctan2(np.sin(dphi), np.cos(dphi))
    J[0, 0], J[0, 1] = nx, ny
    J[0, 2], J[1, 2] = -nx * (cy - centre[1]) + ny * (cx - centre[0]), 1.0
