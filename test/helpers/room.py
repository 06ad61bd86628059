"""A room of horizontal boards and vertical screens, seen by an ideal tilting laser.

The simulator casts the beams; it has no code in common with the mapping.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from shapely import Polygon

from tccm_ros.records import SurfaceCloud, ViewIntervals
from tccm_sim.raycast import FACES
from tccm_sim.scene import Scene

EYE = np.array([0.0, 0.0, 1.4])


@dataclass(frozen=True)
class Board:
    """A horizontal rectangle: centre (x, y), size, height z and yaw; m, rad."""

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
    """A vertical rectangle from (x0, y0) to (x1, y1), floor to `top`."""

    x0: float
    y0: float
    x1: float
    y1: float
    top: float


@dataclass
class Room:
    """Boards and screens on a floor."""

    boards: list
    screens: list = field(default_factory=list)
    floor: Board = field(default_factory=lambda: Board(0.0, 0.0, 12.0, 12.0, 0.0))

    def look(self, pose, stamp_ns, *, rows=60, columns=200, noise=0.0, seed=0, cell=0.1):
        """Return the surface message of one tilt cycle from a planar base pose (x, y, yaw)."""
        boards, screens = (self.floor, *self.boards), tuple(self.screens)
        where = tuple(float(number) for number in pose)
        seen = _seen(boards, screens, where, rows, columns, float(noise), seed, cell)
        points, labels, intervals = (array.copy() for array in seen)
        cloud = SurfaceCloud(stamp_ns, "base", points, labels, viewpoint=EYE.astype(np.float32))
        return cloud, ViewIntervals(stamp_ns, "base", intervals)


@lru_cache(maxsize=512)
def _seen(boards, screens, pose, rows, columns, noise, seed, cell):
    """Return points, the number of each point's board, and free intervals.

    Results are cached, since many tests observe one room from the same poses.
    """
    beams = _beams(rows, columns)
    rays = beams @ _yaw_rotation(pose[2]).T
    origin = _yaw_rotation(pose[2]) @ EYE + [pose[0], pose[1], 0.0]
    hit, distance = _cast(origin, rays, boards, screens)
    ends = origin + rays * np.minimum(distance, 6.0)[:, None]
    back = (ends - [pose[0], pose[1], 0.0]) @ _yaw_rotation(pose[2])
    rng = np.random.default_rng(seed)
    seen = (hit >= 0) & (hit < len(boards)) & (distance < 6.0)
    points = back[seen] + beams[seen] * rng.normal(0.0, noise, (seen.sum(), 1))
    return points.astype(np.float32), hit[seen].astype(np.uint32), _intervals(back, cell)


def _yaw_rotation(yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _beams(rows, columns):
    tilt = np.repeat(np.linspace(0.15, 1.2, rows), columns)
    bearing = np.tile(np.linspace(-1.2, 1.2, columns), rows)
    ahead = np.cos(bearing)
    return np.stack([ahead * np.cos(tilt), np.sin(bearing), -ahead * np.sin(tilt)], axis=1)


def _cast(origin, rays, boards, screens):
    """Return the index of the board or screen that each ray hits, -1 for none, and the range."""
    scene = Scene()
    for b in boards:
        scene.box("board", (b.width, b.depth, 0.0), (b.x, b.y, b.z), (0.0, 0.0, b.yaw))
    for s in screens:
        along = np.array([s.x1 - s.x0, s.y1 - s.y0])
        middle = (0.5 * (s.x0 + s.x1), 0.5 * (s.y0 + s.y1), 0.5 * s.top)
        size, yaw = (np.hypot(*along), 0.0, s.top), np.arctan2(along[1], along[0])
        scene.box("screen", size, middle, (0.0, 0.0, float(yaw)))
    origins = np.broadcast_to(origin, rays.shape)
    distance, codes = scene.freeze().cast(origins, rays, np.zeros(len(rays)))
    return codes // FACES, distance


def _intervals(ends, cell):
    """Return the free intervals: heights in bins of 2 cm, joined over two empty bins."""
    fraction = np.linspace(0.0, 0.985, 90)
    p = (EYE + (ends[:, None] - EYE) * fraction[None, :, None]).reshape(-1, 3)
    bins = np.floor(p / [cell, cell, 0.02]).astype(np.int64) + 1000
    keys = np.sort((bins[:, 0] * 10_000 + bins[:, 1]) * 10_000 + bins[:, 2])
    start = np.flatnonzero(np.r_[True, np.diff(keys) > 3])
    low, high = keys[start], keys[np.r_[start[1:], len(keys)] - 1]
    x, y = low // 10_000**2 - 1000, low // 10_000 % 10_000 - 1000
    z_low, z_high = low % 10_000 - 1000, high % 10_000 - 999
    rows = np.c_[(x + 0.5) * cell, (y + 0.5) * cell, z_low * 0.02, z_high * 0.02]
    return rows.astype(np.float32)
