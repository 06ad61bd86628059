"""Check of the rig while mapping: find the error that explains the floors of tilt cycles.

Each tilt cycle's part map gives the floor once, from pooled cuboid moments. A floor that is tilted
in every tilt cycle indicates a wrong tilt zero (or a tilted base); a slope that alternates with the
direction of the tilt cycle indicates a time delay; a bent floor indicates a wrong scale. Two large
horizontal planes closely above each other indicate that a table was mapped twice, due to odometry,
a delay, or roll and pitch of the base during acceleration and turns.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Float64
from tccm_ros.cuboids.tilt_cycle import CycleEnd
from tccm_ros.geometry import inverse, level, transform
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.records import PlaneRecord
from tccm_ros.robust import median_sigma

MAX_CYCLES, MIN_CYCLES = 8, 4
"""Maximum and minimum number of compared tilt cycles (chosen)."""

MIN_TILT, MIN_SWING, MIN_BEND = np.deg2rad(0.4), np.deg2rad(0.25), 0.010
"""Minimum reported slope (rad), alternating slope (rad) and bend of the floor (m) (chosen: above
those of correct rigs, `bench/rig_check_trials.py`)."""

FLOOR_AREA, MAX_FLOOR_TILT, GATES = 1.0, 0.3, (0.25, 0.15, 0.08)
"""The floor is the largest low plane of at least this area, m2, and below this angle to the
horizontal, rad. It combines the tilt cycles of the window, which may disagree: the floor of a
single tilt cycle is searched near it, with gates of these widths, m (chosen)."""

MIN_CUBOIDS, MIN_EXTENT = 150, 1.0
"""Minimum number of cuboids of a floor, and minimum extent along x, m (chosen)."""

DOUBLED_DISTANCE, MIN_OVERLAP = (0.012, 0.06), 0.4
"""Range of distances, m, at which two horizontal planes would occlude each other, and minimum
overlap as a fraction of the smaller one, for a doubled plane (chosen)."""

DRIVING_TILT = np.deg2rad(0.3)
"""Maximum roll or pitch of a correct base while driving, rad (chosen)."""

SIGN_AGREEMENT = 0.75
"""Minimum fraction of the tilt cycles whose slope or bend has the sign of the median (chosen)."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One suspected error of the rig.

    Attributes
    ----------
    name
        Name of the error.
    size
        Size of the error, rad or m.
    text
        One line of text for users.
    """

    name: str
    size: float
    text: str


@dataclass(frozen=True, slots=True)
class _Floor:
    """The floor in the levelled base frame: slopes forward and left (rad), bend along x (m)."""

    cycle: int
    forward: float
    left: float
    bend: float
    ended_by: str


class RigCheck:
    """Collects tilt cycles and finds errors of the rig; takes a few milliseconds per cycle."""

    def __init__(self) -> None:
        self._floors: deque[_Floor] = deque(maxlen=MAX_CYCLES)
        self._doubled: tuple[float, float] | None = None

    def clear(self) -> None:
        """Clear all tilt cycles."""
        self._floors.clear()
        self._doubled = None

    def add(self, result: CycleResult) -> None:
        """Add one tilt cycle."""
        floor = _floor(result)
        if floor is not None:
            self._floors.append(floor)
        self._doubled = _doubled(
            result.planes, result.T_odom_base, DRIVING_TILT + 2.0 * self._slope()
        )

    def _slope(self) -> float:
        """Return the mean slope of the floor, rad."""
        if not self._floors:
            return 0.0
        slopes = [(floor.forward, floor.left) for floor in self._floors]
        return float(np.hypot(*np.mean(slopes, axis=0)))

    def findings(self) -> list[Finding]:
        """Return the errors indicated by the last tilt cycles, the most certain first."""
        found = []
        if len(self._floors) >= MIN_CYCLES:
            found += [f for f in (self._swing(), self._bend(), self._tilt(), self._roll()) if f]
        if self._doubled is not None:
            distance, height = self._doubled
            found.append(
                Finding(
                    "doubled surface",
                    distance,
                    f"a surface at {height:.2f} m is mapped twice, at a distance of "
                    f"{distance * 1e3:.0f} mm: the base rolls or pitches as it drives, odometry "
                    "drifts, or the joint's stamps are late",
                )
            )
        return found

    def problems(self) -> list[str]:
        """Return the findings as lines for /diagnostics."""
        return [finding.text for finding in self.findings()]

    def _swing(self) -> Finding | None:
        """Return the error indicated by consecutive tilt cycles, which alternate in direction."""
        pairs = [
            (-1.0) ** before.cycle * (after.forward - before.forward)
            for before, after in zip(self._floors, list(self._floors)[1:])
            if after.cycle == before.cycle + 1 and before.ended_by == CycleEnd.REVERSAL
        ]
        if len(pairs) < MIN_CYCLES - 1:
            return None
        size = abs(float(np.median(pairs)))
        if size < MIN_SWING or abs(float(np.sum(np.sign(pairs)))) < len(pairs) - 1:
            return None
        return Finding(
            "delay",
            size,
            f"tilt cycles up and down differ by {np.rad2deg(size):.2f} deg in pitch: joint and "
            "scan stamps do not agree (rig.joint_time_offset); run tccm calibrate",
        )

    def _tilt(self) -> Finding | None:
        slopes = [floor.forward for floor in self._floors]
        return _sloped("tilt zero", slopes, "forward", "wrong rig.tilt_offset")

    def _roll(self) -> Finding | None:
        slopes = [floor.left for floor in self._floors]
        return _sloped("roll", slopes, "to the left", "the laser's mount is rolled")

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


def _sloped(name: str, slopes: list[float], side: str, cause: str) -> Finding | None:
    """Return the error that a steady slope of the floor to a side indicates."""
    size = _steady(slopes, MIN_TILT)
    if size is None:
        return None
    text = f"the floor {'rises' if size > 0 else 'falls'} {side} by {np.rad2deg(abs(size)):.2f} deg"
    return Finding(name, size, f"{text}: {cause}, or the base is tilted; run tccm calibrate")


def _steady(values: list[float], min_size: float) -> float | None:
    """Return the median if it is large and most values have its sign, else None."""
    middle = float(np.median(values))
    agree = np.mean(np.sign(values) == np.sign(middle))
    return middle if abs(middle) >= min_size and agree >= SIGN_AGREEMENT else None


def _floor(result: CycleResult) -> _Floor | None:
    """Return the floor of the newest part map, in the levelled base frame."""
    horizontal = [p for p in result.planes if abs(float(p.normal[2])) > np.cos(MAX_FLOOR_TILT)]
    large = [p for p in horizontal if p.area >= FLOOR_AREA]
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
    fit = _fit_bent_plane(points[near], cuboids.count[near])
    if fit is None:
        return None
    return _Floor(result.cycle, *fit, result.ended_by)


def _fit_plane(points: Float64, counts: Float64) -> Float64:
    """Return a, b, c of a robust fit of z = a + b x + c y."""
    return _robust(np.column_stack([np.ones(len(points)), points[:, :2]]), points[:, 2], counts)


def _fit_bent_plane(points: Float64, counts: Float64) -> tuple[float, float, float] | None:
    """Return the slopes and the bend of a robust fit of z = a + b x + c y + d x^2."""
    x, y, z = points.T
    low, high = np.quantile(x, [0.05, 0.95])
    if high - low < MIN_EXTENT:
        return None
    u = (x - (low + high) / 2.0) / ((high - low) / 2.0)
    A = np.column_stack([np.ones(len(u)), u, y, u**2 - 1.0 / 3.0])
    fit = _robust(A, z, counts)
    return float(fit[1] / ((high - low) / 2.0)), float(fit[2]), float(fit[3])


def _robust(A: Float64, z: Float64, counts: Float64) -> Float64:
    """Solve A x = z by reweighted least squares, with weights by hits and residuals."""
    weights = np.minimum(counts, 10.0)
    for _ in range(4):
        root = np.sqrt(weights)
        fit = np.linalg.lstsq(A * root[:, None], z * root, rcond=None)[0]
        off = np.abs(z - A @ fit)
        scale = max(median_sigma(off), 0.003)
        weights = np.minimum(counts, 10.0) / (1.0 + (off / (2.0 * scale)) ** 2) ** 2
    return np.asarray(fit, float)


def _doubled(
    planes: list[PlaneRecord], T_odom_base: Float64, base_tilt: float = DRIVING_TILT
) -> tuple[float, float] | None:
    """Return distance and height (m) of two horizontal planes above each other; None for none.

    The distance is that of the smaller one's centroid to the larger one's plane, as heights vary
    along a floor that is tilted by a fraction of a degree. A tilted base, or a wrong tilt zero,
    lifts distant objects by an angle of `base_tilt`, rad.
    """
    flat = [p for p in planes if p.kind == "horizontal"]
    for a, b in combinations(flat, 2):
        small, large = sorted((a, b), key=lambda p: p.area)
        distance = abs(float(small.centroid @ large.normal - large.offset))
        lifted = base_tilt * float(np.linalg.norm(small.centroid[:2] - T_odom_base[:2, 3]))
        if DOUBLED_DISTANCE[0] + lifted < distance < DOUBLED_DISTANCE[1] and (
            _overlap(small, large) > MIN_OVERLAP
        ):
            return distance, float(min(a.centroid[2], b.centroid[2]))
    return None


def _overlap(a: PlaneRecord, b: PlaneRecord) -> float:
    """Return the overlap of two planes in the top view, as a fraction of the smaller.

    Holes do not overlap.
    """
    first, second = _area(a), _area(b)
    smaller = min(first.area, second.area)
    return float(first.intersection(second).area / smaller) if smaller > 0.0 else 0.0


def _area(plane: PlaneRecord) -> BaseGeometry:
    if len(plane.boundary) < 3:
        return Polygon()
    holes = [hole[:, :2] for hole in plane.holes if len(hole) >= 3]
    return Polygon(plane.boundary[:, :2], holes).buffer(0)
