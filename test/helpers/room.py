"""A room of horizontal boards and upright screens, seen by an ideal tilting laser.

Independent of the package: beams are cut with rectangles in closed form.
"""

from dataclasses import dataclass, field

import numpy as np
from shapely import Polygon

from tccm_ros.records import SurfaceCloud, ViewIntervals

EYE = np.array([0.0, 0.0, 1.4])


@dataclass(frozen=True)
class Board:
    """A horizontal rectangle: middle (x, y), size, height z, turned by yaw."""

    x: float
    y: float
    width: float
    depth: float
    z: float
    yaw: float = 0.0

    @property
    def polygon(self):
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [self.width, self.depth]
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return Polygon(half @ np.array([[c, s], [-s, c]]) + [self.x, self.y])


@dataclass(frozen=True)
class Screen:
    """An upright rectangle from (x0, y0) to (x1, y1), floor to `top`."""

    x0: float
    y0: float
    x1: float
    y1: float
    top: float


@dataclass
class Room:
    boards: list
    screens: list = field(default_factory=list)
    floor: Board = field(default_factory=lambda: Board(0.0, 0.0, 12.0, 12.0, 0.0))

    def look(self, pose, stamp_ns, *, rows=60, columns=200, noise=0.0, seed=0, cell=0.1):
        """Return the hand-over of one sweep from a planar base pose (x, y, yaw)."""
        boards = [self.floor, *self.boards]
        beams = _beams(rows, columns)
        rays = beams @ _turn(pose[2]).T
        origin = _turn(pose[2]) @ EYE + [pose[0], pose[1], 0.0]
        hit, distance = _cast(origin, rays, boards, self.screens)
        ends = origin + rays * np.minimum(distance, 6.0)[:, None]
        back = (ends - [pose[0], pose[1], 0.0]) @ _turn(pose[2])
        rng = np.random.default_rng(seed)
        seen = (hit >= 0) & (hit < len(boards)) & (distance < 6.0)
        points = back[seen] + beams[seen] * rng.normal(0.0, noise, (seen.sum(), 1))
        cloud = SurfaceCloud(
            stamp_ns, "base", points.astype(np.float32), hit[seen].astype(np.uint32)
        )
        return cloud, ViewIntervals(stamp_ns, "base", _intervals(back, cell))


def _turn(yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _beams(rows, columns):
    tilt = np.repeat(np.linspace(0.15, 1.2, rows), columns)
    bearing = np.tile(np.linspace(-1.2, 1.2, columns), rows)
    ahead = np.cos(bearing)
    return np.stack([ahead * np.cos(tilt), np.sin(bearing), -ahead * np.sin(tilt)], axis=1)


def _cast(origin, rays, boards, screens):
    best = np.full(len(rays), 1e9)
    hit = np.full(len(rays), -1)
    for k, board in enumerate(boards):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (board.z - origin[2]) / rays[:, 2]
        p = origin + rays * t[:, None]
        local = (p[:, :2] - [board.x, board.y]) @ _turn(board.yaw)[:2, :2]
        inside = np.all(np.abs(local) <= 0.5 * np.array([board.width, board.depth]), axis=1)
        better = inside & (t > 0) & (t < best)
        best[better], hit[better] = t[better], k
    for k, s in enumerate(screens):
        along, normal = np.array([s.x1 - s.x0, s.y1 - s.y0]), np.array([s.y0 - s.y1, s.x1 - s.x0])
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ([s.x0, s.y0] - origin[:2]) @ normal / (rays[:, :2] @ normal)
        p = origin + rays * t[:, None]
        u = (p[:, :2] - [s.x0, s.y0]) @ along / (along @ along)
        better = (t > 0) & (t < best) & (u >= 0) & (u <= 1) & (p[:, 2] <= s.top) & (p[:, 2] >= 0)
        best[better], hit[better] = t[better], len(boards) + k
    return hit, best


def _intervals(ends, cell):
    """Return where beams passed: heights in bins of 2 cm, joined over two empty bins."""
    share = np.linspace(0.0, 0.985, 90)
    p = (EYE + (ends[:, None] - EYE) * share[None, :, None]).reshape(-1, 3)
    bins = np.floor(p / [cell, cell, 0.02]).astype(np.int64) + 1000
    keys = np.unique((bins[:, 0] * 10_000 + bins[:, 1]) * 10_000 + bins[:, 2])
    start = np.flatnonzero(np.r_[True, np.diff(keys) > 3])
    low, high = keys[start], keys[np.r_[start[1:], len(keys)] - 1]
    x, y = low // 10_000**2 - 1000, low // 10_000 % 10_000 - 1000
    z_low, z_high = low % 10_000 - 1000, high % 10_000 - 999
    rows = np.c_[(x + 0.5) * cell, (y + 0.5) * cell, z_low * 0.02, z_high * 0.02]
    return rows.astype(np.float32)
