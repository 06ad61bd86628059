"""The footprint of the base, and its free motion up to the margins of obstacles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from tccm_ros.arrays import Float64
from tccm_ros.errors import MotionError
from tccm_ros.geometry import transform2

MAX_CORNER_M = 3.0
"""Maximum distance of a corner from the base's origin, m: no indoor robot is larger."""

ROTATION_STEP_RAD = 0.05
"""Step of the collision check of a turn in place, rad: it moves the corner of a footprint of 1 m by
5 cm, the edge of a costmap cell."""

WAY_STEP_M = 0.01
"""Step of the test whether a motion leads nearer to a point, m: less than any margin."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """The convex outline of the base.

    Attributes
    ----------
    corners
        float64 (N, 2), counter-clockwise, in the base frame, m; the origin is inside.
    """

    corners: Float64

    @classmethod
    def of(cls, corners: ArrayLike) -> Footprint:
        """Return the convex hull of corners.

        Parameters
        ----------
        corners
            float64 (N, 2) or (2 N,): x, y of each, in the base frame, m.

        Raises
        ------
        MotionError
            For fewer than three corners, numbers that are not finite, corners beyond
            `MAX_CORNER_M`, and an outline that does not contain the origin.
        """
        flat = np.asarray(corners, np.float64).ravel()
        if len(flat) < 6 or len(flat) % 2:
            raise MotionError(
                f"footprint has {len(flat)} numbers; expected x, y of 3 or more corners"
            )
        if not (np.abs(flat) <= MAX_CORNER_M).all():
            raise MotionError(f"footprint has a corner beyond {MAX_CORNER_M:g} m, or none at all")
        points = flat.reshape(-1, 2)
        if np.linalg.matrix_rank(points - points[0], tol=1e-3) < 2:
            raise MotionError("footprint has its corners on one line")
        made = cls(points[ConvexHull(points).vertices])
        if not made.distance(np.zeros((1, 2)))[0] < 0.0:
            raise MotionError("footprint does not hold the base's origin")
        return made

    @property
    def front(self) -> float:
        """Distance of the foremost corner ahead of the base's origin, m."""
        return float(self.corners[:, 0].max())

    @property
    def radius(self) -> float:
        """Distance of the furthest corner from the base's origin, m."""
        return float(np.hypot(*self.corners.T).max())

    def at(self, pose: Float64) -> Float64:
        """Return the corners (N, 2) at a planar pose (3,) of the base."""
        return transform2(pose, self.corners)

    def grown(self, margin: float) -> Footprint:
        """Return the footprint with every side moved outwards by a margin, m."""
        normals, offsets = self._half_planes
        before = np.roll(normals, 1, axis=0), np.roll(offsets, 1)
        corners = [
            np.linalg.solve(np.stack([a, b]), np.array([p + margin, q + margin]))
            for a, b, p, q in zip(before[0], normals, before[1], offsets)
        ]
        return Footprint(np.array(corners))

    def samples(self, spacing: float) -> Float64:
        """Return points (M, 2) that cover the footprint: a square grid and the corners."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        counts = np.ceil((high - low) / spacing).astype(int) + 1
        axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts.tolist())]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        return np.concatenate([grid[self.distance(grid) <= 0.0], self.corners])

    def distance(self, points: Float64) -> Float64:
        """Return the distances (N,) of points from the footprint, m; negative inside.

        Beyond a corner it is the distance from the further of the two lines through its sides,
        which is never more than the true distance.

        Parameters
        ----------
        points
            float64 (N, 2), in the base frame, m.
        """
        normals, offsets = self._half_planes
        return np.asarray((points @ normals.T - offsets).max(axis=1, initial=-np.inf))

    def free_way(self, points: Float64, margins: Float64, direction: float) -> float:
        """Return the length of free straight motion before a point is within its margin, m.

        Parameters
        ----------
        points
            float64 (N, 2), obstacles in the base frame, m.
        margins
            float64 (N,), minimum distance of the footprint from each point, m.
        direction
            1: ahead, -1: back.

        Returns
        -------
        m; 0 where a point is within its margin and the motion does not lead away from it, inf where
        no point limits the motion.
        """
        if not len(points):
            return np.inf
        normals, offsets = self._half_planes
        # After a distance s, point p is at p - s d; it is near while n . p - o - margin < s n . d.
        room = points @ normals.T - offsets - margins[:, None]
        rate = direction * normals[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            limits = room / rate
        first = np.where(rate > 1e-9, limits, -np.inf).max(axis=1)
        last = np.where(rate < -1e-9, limits, np.inf).min(axis=1)
        is_passed = (np.where(np.abs(rate) <= 1e-9, room, -np.inf) >= 0.0).any(axis=1)
        is_in_way = ~is_passed & (first < last) & (last > 0.0)
        # A point that is within its margin already limits only a motion towards it.
        after = self.distance(points - np.array([direction * WAY_STEP_M, 0.0]))
        is_left = (first <= 0.0) & (after >= self.distance(points) - 1e-9)
        ways = np.maximum(first[is_in_way & ~is_left], 0.0)
        return float(ways.min(initial=np.inf))

    def free_rotation(self, points: Float64, margins: Float64, angle: float) -> float:
        """Return the free angle of a turn in place before a point is within its margin, rad.

        Parameters
        ----------
        points, margins
            As in `free_way`.
        angle
            Wanted turn, counter-clockwise, rad.

        Returns
        -------
        rad, with the sign of `angle`. A point that is within its margin already limits the turn
        only if it brings the point nearer.
        """
        near = np.hypot(*points.T) < self.radius + margins.max(initial=0.0)
        points, margins = points[near], margins[near]
        if not len(points):
            return angle
        before = self.distance(points)
        steps = np.linspace(0.0, angle, int(abs(angle) / ROTATION_STEP_RAD) + 2)
        for last, now in pairwise(steps.tolist()):
            after = self.distance(transform2(np.array([0.0, 0.0, -now]), points))
            if (after < np.minimum(margins, before - 1e-9)).any():
                return last
        return angle

    @cached_property
    def _half_planes(self) -> tuple[Float64, Float64]:
        """Return outward unit normals (N, 2) and offsets (N,) of the sides."""
        along = np.roll(self.corners, -1, axis=0) - self.corners
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
        normals /= np.hypot(*normals.T)[:, None]
        return normals, (normals * self.corners).sum(axis=1)
