"""A small analytic laser and a plain part map, independent of the code under test."""

from __future__ import annotations

import numpy as np

from tccm_ros.cuboids.cuboids import TICKS_PER_M, Cuboids

EYE = np.array([0.0, 0.0, 1.52])


def rays(tilts_deg=None, beams=569, fan_deg=240.0):
    """Return the directions (beams * tilts, 3) of a laser that tilts about y."""
    bearing = np.deg2rad(np.linspace(-fan_deg / 2, fan_deg / 2, beams))
    tilt = np.deg2rad(np.linspace(5, 65, 40) if tilts_deg is None else np.asarray(tilts_deg, float))
    b, t = np.meshgrid(bearing, tilt)
    x, y = np.cos(b), np.sin(b)
    return np.stack([x * np.cos(t), y, -x * np.sin(t)], axis=-1).reshape(-1, 3)


class Patch:
    """A rectangle: corner, two edge vectors; `name` is its label."""

    def __init__(self, name, corner, a, b):
        self.name = name
        self.corner, self.a, self.b = (np.asarray(k, float) for k in (corner, a, b))
        normal = np.cross(self.a, self.b)
        self.normal = normal / np.linalg.norm(normal)
        self.offset = self.normal @ self.corner

    def hit(self, eye, directions):
        """Return the ranges (N,) at which rays from `eye` meet the rectangle, inf for none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.offset - self.normal @ eye) / (directions @ self.normal)
            p = eye + t[:, None] * directions - self.corner
            i = p @ self.a / (self.a @ self.a)
            j = p @ self.b / (self.b @ self.b)
            inside = (t > 0.05) & (i >= 0) & (i <= 1) & (j >= 0) & (j <= 1)
        return np.where(inside, t, np.inf)


def box(name, low, high, yaw=0.0, pivot=(0.0, 0.0)):
    """Return the six faces of a box, rotated about the vertical through `pivot`."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    size = high - low
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    pivot = np.array([*pivot, 0.0])
    ex, ey, ez = (R @ (size * np.eye(3)[k]) for k in range(3))
    o = R @ (low - pivot) + pivot
    return [
        Patch(name + ".front", o, ey, ez),
        Patch(name + ".back", o + ex, ey, ez),
        Patch(name + ".right", o, ex, ez),
        Patch(name + ".left", o + ey, ex, ez),
        Patch(name + ".bottom", o, ex, ey),
        Patch(name + ".top", o + ez, ex, ey),
    ]


def room(back=2.6):
    """Return a floor and a wall ahead at x = `back`."""
    return [
        Patch("floor", (-3, -3, 0), (back + 3, 0, 0), (0, 6, 0)),
        Patch("wall", (back, -3, 0), (0, 6, 0), (0, 0, 2.5)),
    ]


def scan(patches, sigma=0.0, seed=0, eye=EYE, directions=None):
    """Return points (N, 3) and the index of each point's patch."""
    directions = rays() if directions is None else directions
    ranges = np.stack([p.hit(eye, directions) for p in patches])
    nearest = ranges.argmin(axis=0)
    r = ranges[nearest, np.arange(len(directions))]
    seen = np.isfinite(r)
    r = r[seen] + np.random.default_rng(seed).normal(0, 1, seen.sum()) * sigma
    return eye + r[:, None] * directions[seen], nearest[seen]


def part_map(points, cell=0.02, d0=0.03, cycle=0):
    """Return the cuboids of points: the union of [z - d0, z] in each cell, in plain numpy."""
    ticks = np.rint(np.asarray(points) * TICKS_PER_M).astype(np.int64)
    width = cell * TICKS_PER_M
    ix, iy = (np.floor(ticks[:, k] / width).astype(np.int64) for k in (0, 1))
    order = np.lexsort((ticks[:, 2], iy, ix))
    ticks, ix, iy = ticks[order], ix[order], iy[order]
    depth = round(d0 * TICKS_PER_M)
    new = np.ones(len(ix), bool)
    same = (np.diff(ix) == 0) & (np.diff(iy) == 0)
    new[1:] = ~(same & (np.diff(ticks[:, 2]) <= depth))
    first = np.flatnonzero(new)
    last = np.append(first[1:], len(ix)) - 1
    rel = ticks.astype(float)
    rel[:, 0] -= np.rint(ix * width)
    rel[:, 1] -= np.rint(iy * width)
    products = np.stack([rel[:, i] * rel[:, j] for i in range(3) for j in range(i, 3)], axis=1)
    return Cuboids(
        cell,
        ix[first].astype(np.int32),
        iy[first].astype(np.int32),
        (ticks[first, 2] - depth).astype(np.int32),
        ticks[last, 2].astype(np.int32),
        np.diff(np.append(first, len(ix))).astype(float),
        np.add.reduceat(rel, first),
        np.add.reduceat(products, first),
        np.full(len(first), cycle, np.int32),
        np.arange(len(first) + 1, dtype=np.int64),
    )


def cuboid_of(points, cuboids, d0=0.03):
    """Return the cuboid of each point."""
    ticks = np.rint(np.asarray(points) * TICKS_PER_M).astype(np.int64)
    width = cuboids.cell_size * TICKS_PER_M
    lookup = {}
    for k in range(len(cuboids)):
        lookup.setdefault((int(cuboids.ix[k]), int(cuboids.iy[k])), []).append(k)
    result = np.empty(len(ticks), int)
    for i, (x, y, z) in enumerate(ticks):
        for k in lookup[int(np.floor(x / width)), int(np.floor(y / width))]:
            if cuboids.bottom[k] <= z <= cuboids.top[k]:
                result[i] = k
    return result


def least_squares(points):
    """Return normal and offset of the least-squares plane."""
    mean = points.mean(axis=0)
    normal = np.linalg.svd(points - mean, full_matrices=False)[2][2]
    return normal, normal @ mean


def table(x=(0.5, 1.3), y=(-0.6, 0.6), top=0.7, yaw=0.0, name="table"):
    """Return a board 3 cm thick, rotated about the middle of its near edge."""
    return box(name, (x[0], y[0], top - 0.03), (x[1], y[1], top), yaw, (x[0], 0.0))


def sheet(rng, n, low, high, normal=(0, 0, 1), offset=0.0, sigma=0.0):
    """Return points (n, 3) spread over a rectangle in x and y, lifted onto a plane, with noise."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    xy = rng.uniform(low, high, (n, 2))
    z = (offset - xy @ normal[:2]) / normal[2]
    points = np.column_stack([xy, z])
    return points + rng.normal(0, sigma, n)[:, None] * normal if sigma else points
