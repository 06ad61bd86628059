"""A check of the rig while it maps: which error would explain what the cycles show.

Each cycle's part map gives the floor once, from pooled cuboid moments. A floor that is tilted in
every cycle means a wrong tilt zero (or a leaning base); one that tilts to and fro with the
direction of the sweep means a delay; one that is bent means a wrong scale. Two large level planes
one just above the other mean that the same table was mapped twice: odometry, or a delay.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse, level, transform
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.records import PlaneRecord

__all__ = ["Finding", "RigCheck"]

#: Cycles that are looked at together, and how many must agree.
WINDOW, ENOUGH = 8, 4

#: What is reported: tilts (rad) and bends over the floor seen (m).
MIN_TILT, MIN_SWING, MIN_BEND = np.deg2rad(0.4), np.deg2rad(0.25), 0.010

#: The floor is the largest low plane, of at least this area, m2, that leans less than this, rad. It
#: mixes the sweeps of the window, which may disagree: a sweep's own floor is looked for near it,
#: through gates of these widths, m.
FLOOR_AREA, MAX_LEAN, GATES = 1.0, 0.3, (0.25, 0.15, 0.08)

#: Cuboids that a floor needs, and how far it must reach, m.
MIN_CUBOIDS, MIN_REACH = 150, 1.0

#: Level planes this far apart cannot both be seen where one hides the other, m, if they share this
#: part of the smaller one.
DOUBLED, SHARED = (0.012, 0.06), 0.4

#: How far a sound base leans while it drives, rad.
LEAN = np.deg2rad(0.3)


@dataclass(frozen=True, slots=True)
class Finding:
    """One suspicion: its name, its size (rad or m) and what to say."""

    name: str
    size: float
    text: str


@dataclass(frozen=True, slots=True)
class _Floor:
    """The floor in the levelled base: slopes forward and left (rad), and bend along x (m)."""

    cycle: int
    forward: float
    left: float
    bend: float
    ended_by: str


class RigCheck:
    """Takes cycles and says what may be wrong with the rig; costs a few milliseconds a cycle."""

    def __init__(self) -> None:
        self._floors: deque[_Floor] = deque(maxlen=WINDOW)
        self._doubled: tuple[float, float] | None = None

    def clear(self) -> None:
        """Forget all cycles."""
        self._floors.clear()
        self._doubled = None

    def add(self, result: CycleResult) -> None:
        """Take one cycle."""
        floor = _floor(result)
        if floor is not None:
            self._floors.append(floor)
        self._doubled = _doubled(result.planes, result.T_odom_base, LEAN + 2.0 * self._slope())

    def _slope(self) -> float:
        """Return how steep the floor is on average, rad: seen from two sides, twice that."""
        if not self._floors:
            return 0.0
        slopes = [(floor.forward, floor.left) for floor in self._floors]
        return float(np.hypot(*np.mean(slopes, axis=0)))

    def findings(self) -> list[Finding]:
        """Return what the last cycles show, the most certain first."""
        found = []
        if len(self._floors) >= ENOUGH:
            found += [f for f in (self._swing(), self._bend(), self._tilt(), self._roll()) if f]
        if self._doubled is not None:
            apart, height = self._doubled
            found.append(
                Finding(
                    "doubled surface",
                    apart,
                    f"a surface at {height:.2f} m is mapped twice, {apart * 1e3:.0f} mm apart: "
                    "odometry drifts, or the joint's stamps are late",
                )
            )
        return found

    def problems(self) -> list[str]:
        """Return the findings as lines for /diagnostics."""
        return [finding.text for finding in self.findings()]

    def _swing(self) -> Finding | None:
        """Compare sweeps that turned into each other: they go up and down by turns."""
        pairs = [
            (-1.0) ** before.cycle * (after.forward - before.forward)
            for before, after in zip(self._floors, list(self._floors)[1:])
            if after.cycle == before.cycle + 1 and before.ended_by == "turn"
        ]
        if len(pairs) < ENOUGH - 1:
            return None
        size = abs(float(np.median(pairs)))
        if size < MIN_SWING or abs(float(np.sum(np.sign(pairs)))) < len(pairs) - 1:
            return None
        return Finding(
            "delay",
            size,
            f"up and down sweeps differ by {np.rad2deg(size):.2f} deg in pitch: joint and scan "
            "stamps do not agree (rig.joint_time_offset); run tccm calibrate",
        )

    def _tilt(self) -> Finding | None:
        size = _steady([floor.forward for floor in self._floors], MIN_TILT)
        if size is None:
            return None
        return Finding(
            "tilt zero",
            size,
            f"the floor {'rises' if size > 0 else 'falls'} forward by {np.rad2deg(abs(size)):.2f} "
            "deg: wrong rig.tilt_offset, or the base leans; run tccm calibrate",
        )

    def _roll(self) -> Finding | None:
        size = _steady([floor.left for floor in self._floors], MIN_TILT)
        if size is None:
            return None
        return Finding(
            "roll",
            size,
            f"the floor {'rises' if size > 0 else 'falls'} to the left by "
            f"{np.rad2deg(abs(size)):.2f} deg: the laser's mount is rolled, or the base leans; run "
            "tccm calibrate",
        )

    def _bend(self) -> Finding | None:
        size = _steady([floor.bend for floor in self._floors], MIN_BEND)
        if size is None:
            return None
        return Finding(
            "tilt scale",
            size,
            f"the floor is bent by {abs(size) * 1e3:.0f} mm: wrong rig.tilt_scale; run "
            "tccm calibrate",
        )


def _steady(values: list[float], least: float) -> float | None:
    """Return the median where it is large and most values agree on its sign."""
    middle = float(np.median(values))
    agree = np.mean(np.sign(values) == np.sign(middle))
    return middle if abs(middle) >= least and agree >= 0.75 else None


def _floor(result: CycleResult) -> _Floor | None:
    """Fit the floor of the newest part map, in the levelled base."""
    lying = [p for p in result.planes if abs(float(p.normal[2])) > np.cos(MAX_LEAN)]
    large = [p for p in lying if p.area >= FLOOR_AREA]
    if not large:
        return None
    lowest = min(float(p.centroid[2]) for p in large)
    plane = max((p for p in large if p.centroid[2] < lowest + GATES[0]), key=lambda p: p.area)
    cuboids = result.part.cuboids()
    if len(cuboids) == 0:
        return None
    T_level_odom = inverse(level(result.T_odom_base))
    points = transform(T_level_odom, cuboids.mean())
    centroid, normal = (
        transform(T_level_odom, plane.centroid[None])[0],
        T_level_odom[:3, :3] @ plane.normal,
    )
    off = (points - centroid) @ normal
    for gate in GATES:
        near = np.abs(off) < gate
        if near.sum() < MIN_CUBOIDS:
            return None
        slopes = _fit_plane(points[near], cuboids.count[near])
        off = points[:, 2] - slopes[0] - points[:, :2] @ slopes[1:]
    fit = _fit(points[near], cuboids.count[near])
    if fit is None:
        return None
    return _Floor(result.cycle, *fit, result.ended_by)


def _fit_plane(points: Float64, counts: Float64) -> Float64:
    """Return a, b, c of z = a + b x + c y, robustly."""
    return _robust(np.column_stack([np.ones(len(points)), points[:, :2]]), points[:, 2], counts)


def _fit(points: Float64, counts: Float64) -> tuple[float, float, float] | None:
    """Return the slopes and the bend of z = a + b x + c y + d x^2, robustly."""
    x, y, z = points.T
    low, high = np.quantile(x, [0.05, 0.95])
    if high - low < MIN_REACH:
        return None
    u = (x - (low + high) / 2.0) / ((high - low) / 2.0)
    A = np.column_stack([np.ones(len(u)), u, y, u**2 - 1.0 / 3.0])
    fit = _robust(A, z, counts)
    return float(fit[1] / ((high - low) / 2.0)), float(fit[2]), float(fit[3])


def _robust(A: Float64, z: Float64, counts: Float64) -> Float64:
    """Solve A x = z by least squares, weighted by hits and by how well each row fits."""
    weights = np.minimum(counts, 10.0)
    for _ in range(4):
        root = np.sqrt(weights)
        fit = np.linalg.lstsq(A * root[:, None], z * root, rcond=None)[0]
        off = np.abs(z - A @ fit)
        scale = max(1.4826 * float(np.median(off)), 0.003)
        weights = np.minimum(counts, 10.0) / (1.0 + (off / (2.0 * scale)) ** 2) ** 2
    return np.asarray(fit, float)


def _doubled(
    planes: list[PlaneRecord], T_odom_base: Float64, lean: float = LEAN
) -> tuple[float, float] | None:
    """Return distance and height of two level planes that lie over each other, None if none do.

    The distance is that of the smaller one's middle from the larger one's plane: heights differ
    along a floor that leans by a fraction of a degree. A base that leans while it drives, or a tilt
    zero that is wrong, lifts what is far from the base: by `lean`, rad.
    """
    flat = [p for p in planes if p.kind == "horizontal"]
    for a, b in combinations(flat, 2):
        small, large = sorted((a, b), key=lambda p: p.area)
        apart = abs(float(small.centroid @ large.normal - large.offset))
        lifted = lean * float(np.linalg.norm(small.centroid[:2] - T_odom_base[:2, 3]))
        if DOUBLED[0] + lifted < apart < DOUBLED[1] and _overlap(small, large) > SHARED:
            return apart, float(min(a.centroid[2], b.centroid[2]))
    return None


def _overlap(a: PlaneRecord, b: PlaneRecord) -> float:
    """Return the shared area of two planes seen from above, as a share of the smaller.

    What lies in a hole of the other shares nothing with it.
    """
    first, second = _area(a), _area(b)
    smaller = min(first.area, second.area)
    return float(first.intersection(second).area / smaller) if smaller > 0.0 else 0.0


def _area(plane: PlaneRecord) -> BaseGeometry:
    if len(plane.boundary) < 3:
        return Polygon()
    holes = [hole[:, :2] for hole in plane.holes if len(hole) >= 3]
    return Polygon(plane.boundary[:, :2], holes).buffer(0)
