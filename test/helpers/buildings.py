"""Buildings that are hard to map, and a robot with the measurement errors of old logs.

They replace recordings that are not in the repository: identical offices along a corridor, a court
of several hundred metres, a block of crossing corridors. Like `plan`, the module has no code in
common with the code under test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import plan
from numpy.typing import NDArray

from tccm_ros.kernels import kernel
from tccm_ros.records import PosedScan, Scan
from tccm_ros.slam.solution import Solution

Float64 = NDArray[np.float64]

NO_RETURN = 81.91
"""Range of a SICK LMS without a return, m."""


@dataclass(frozen=True)
class Building:
    """Segments (N, 2, 2), m; transparency (N,) of each, 0 to 1; and a route (M, 2), m."""

    walls: Float64
    glass: Float64
    route: list[tuple[float, float]]


@dataclass(frozen=True)
class Robot:
    """A robot and the errors of its sensors.

    Attributes
    ----------
    step, yaw_step
        Motion between two scans, m and rad.
    drift, scale
        Yaw drift of odometry, rad/m, and scale of its translations.
    noise
        Noise of odometry, m and rad per root m (or 0.2 rad).
    slips
        Frequency of wheel slip, 1/m, and standard deviation of the yaw error of a slip, rad.
    quantum
        Resolution of odometry, m and rad; 0 for no rounding.
    sigma, max_range
        Standard deviation of a range, and maximum range, m.
    people
        Number of people around the robot at a time.
    company
        Number of people who walk with the robot, up to 5 m ahead of it.
    missing
        Fraction of beams that are lost at random.
    """

    step: float = 0.12
    yaw_step: float = 0.12
    drift: float = 0.004
    scale: float = 1.01
    noise: tuple[float, float] = (0.01, 0.01)
    slips: tuple[float, float] = (0.0, 0.0)
    quantum: float = 0.0
    beams: int = 180
    sigma: float = 0.012
    max_range: float = 80.0
    people: int = 0
    company: int = 0
    missing: float = 0.0


@kernel
def cast(
    walls: Float64, glass: Float64, x: float, y: float, angles: Float64, dice: Float64
) -> Float64:
    """Return the range of each beam, m; a pane is ignored if `dice` is below its transparency."""
    ranges = np.full(len(angles), np.inf)
    for k in range(len(angles)):
        dx, dy = np.cos(angles[k]), np.sin(angles[k])
        for i in range(len(walls)):
            ex, ey = walls[i, 1, 0] - walls[i, 0, 0], walls[i, 1, 1] - walls[i, 0, 1]
            ax, ay = walls[i, 0, 0] - x, walls[i, 0, 1] - y
            cross = dx * ey - dy * ex
            if abs(cross) < 1e-12:
                continue
            t, u = (ax * ey - ay * ex) / cross, (ax * dy - ay * dx) / cross
            if 1e-6 < t < ranges[k] and 0.0 <= u <= 1.0 and dice[k] >= glass[i]:
                ranges[k] = t
    return ranges


def drive(building: Building, robot: Robot, *, seed: int = 0, start_ns: int = 10**18) -> plan.Run:
    """Drive the route; return the run, with the robot's errors in ranges and odometry."""
    random = np.random.default_rng(seed)
    bearings = np.radians(np.linspace(-90.0, 90.0, robot.beams, endpoint=robot.beams % 2 == 1))
    poses = plan.route(building.route, step=robot.step, yaw_step=robot.yaw_step)
    odometry = _odometry(poses, robot, random)
    crowd = _Crowd(robot.people, poses[0], random)
    company = _Company(robot.company, poses[0], random)
    scans = []
    for k, pose in enumerate(poses):
        walls, glass = building.walls, building.glass
        if robot.people or robot.company:
            bodies = _bodies(np.concatenate([crowd.walk(pose), company.walk(pose)]))
            walls = np.concatenate([walls, bodies])
            glass = np.concatenate([glass, np.zeros(len(bodies))])
        ranges = cast(
            walls, glass, pose[0], pose[1], bearings + pose[2], random.random(len(bearings))
        )
        ranges = np.round(ranges + random.normal(size=len(ranges)) * robot.sigma, 2)
        lost = ~(ranges < robot.max_range) | (random.random(len(ranges)) < robot.missing)
        ranges[lost] = np.inf
        stamp = start_ns + k * 200_000_000
        scan = Scan(
            stamp,
            "laser",
            float(bearings[0]),
            float(bearings[1] - bearings[0]),
            0.0,
            0.02,
            robot.max_range,
            ranges.astype(np.float32),
        )
        T = plan.matrix(odometry[k])
        scans.append(PosedScan(scan, np.array([stamp]), T[None], np.eye(4)[None]))
    first = np.linalg.inv(plan.matrix(poses[0]))
    truth = np.stack([plan.planar(first @ plan.matrix(p)) for p in poses])
    return plan.Run(truth, scans)


def _odometry(poses: Float64, robot: Robot, random: np.random.Generator) -> Float64:
    """Return the poses (N, 3) of odometry."""
    T, found = np.eye(4), [np.zeros(3)]
    for a, b in pairwise(poses):
        step = plan.planar(np.linalg.inv(plan.matrix(a)) @ plan.matrix(b))
        distance = float(np.hypot(step[0], step[1]))
        error = random.normal(size=3) * np.sqrt(distance + 0.2 * abs(step[2]))
        error *= [robot.noise[0], robot.noise[0], robot.noise[1]]
        if random.random() < robot.slips[0] * distance:
            error[2] += random.normal() * robot.slips[1]
            error[0] += random.normal() * robot.slips[1]
        step = np.array([step[0] * robot.scale, step[1] * robot.scale, step[2]])
        step[2] += robot.drift * distance
        T = T @ plan.matrix(step + error)
        found.append(plan.planar(T))
    result = np.stack(found)
    if robot.quantum:
        grid = np.array([robot.quantum, robot.quantum, robot.quantum])
        result = np.round(result / grid) * grid
    return result


class _Crowd:
    """People who walk through the building at some 0.25 m a scan.

    A person more than 10 m from the robot is placed 8 m ahead of it.
    """

    def __init__(self, count: int, pose: Float64, random: np.random.Generator) -> None:
        self._random = random
        self._at = pose[:2] + random.normal(size=(count, 2)) * 5.0
        self._step = random.normal(size=(count, 2)) * 0.2

    def walk(self, pose: Float64) -> Float64:
        """Return where they are (N, 2) after one more step, none nearer than 0.5 m."""
        self._at = self._at + self._step
        for i in np.flatnonzero(np.hypot(*(self._at - pose[:2]).T) > 10.0):
            bearing = pose[2] + self._random.uniform(-0.6, 0.6)
            self._at[i] = pose[:2] + 8.0 * np.array([np.cos(bearing), np.sin(bearing)])
            self._step[i] = self._random.normal(size=2) * 0.2
        return self._at[np.hypot(*(self._at - pose[:2]).T) > 0.5]


class _Company:
    """People who walk ahead of the robot, each at a fixed position relative to it.

    They sway by some centimetres, and catch up at 0.25 m a scan where the robot turns.
    """

    def __init__(self, count: int, pose: Float64, random: np.random.Generator) -> None:
        self._random = random
        self._place = random.uniform([0.8, -0.8], [5.0, 0.8], size=(count, 2))
        self._at = self._goal(pose)

    def walk(self, pose: Float64) -> Float64:
        """Return where they are (N, 2) after one more step, none nearer than 0.5 m."""
        self._place += self._random.normal(size=self._place.shape) * 0.02
        step = self._goal(pose) - self._at
        length = np.hypot(*step.T)[:, None]
        self._at = self._at + step * np.minimum(1.0, 0.25 / np.maximum(length, 1e-9))
        return self._at[np.hypot(*(self._at - pose[:2]).T) > 0.5]

    def _goal(self, pose: Float64) -> Float64:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return pose[:2] + self._place @ np.array([[c, s], [-s, c]])


def _bodies(centres: Float64) -> Float64:
    """Return the outlines of people as segments (4 N, 2, 2): diamonds of 0.4 m."""
    corners = np.array([[0.2, 0.0], [0.0, 0.2], [-0.2, 0.0], [0.0, -0.2]])
    at = centres[:, None] + corners
    return np.stack([at, np.roll(at, -1, axis=1)], axis=2).reshape(-1, 2, 2)


def _wall_with_gaps(
    a: Sequence[float], b: Sequence[float], gaps: Sequence[tuple[float, float]]
) -> list[Float64]:
    """Return the pieces of the wall a-b between gaps (from, to), m along it."""
    a, b = np.array(a, float), np.array(b, float)
    length = float(np.hypot(*(b - a)))
    u = (b - a) / length
    at, pieces = 0.0, []
    for low, high in sorted(gaps):
        if low > at:
            pieces.append(np.array([a + at * u, a + low * u]))
        at = max(at, high)
    if at < length:
        pieces.append(np.array([a + at * u, b]))
    return pieces


def _niches(
    a: Sequence[float],
    b: Sequence[float],
    every: float,
    width: float,
    depth: float,
    open_at: Sequence[tuple[float, float]] = (),
) -> list[Float64]:
    """Return a wall a-b with door niches to its left at a regular distance."""
    a, b = np.array(a, float), np.array(b, float)
    length = float(np.hypot(*(b - a)))
    u = (b - a) / length
    n = np.array([-u[1], u[0]])
    places = []
    at = 0.5 * every
    while at + width < length:
        if all(at + width < low or at > high for low, high in open_at):
            places.append((at, at + width))
        at += every
    pieces = _wall_with_gaps(a, b, [*places, *open_at])
    for low, high in places:
        p, q = a + low * u, a + high * u
        pieces += [np.array([p, p + depth * n]), np.array([q, q + depth * n])]
        pieces.append(np.array([p + depth * n, q + depth * n]))
    return pieces


def _building(pieces: Sequence[Float64], route: list[tuple[float, float]]) -> Building:
    walls = np.stack(list(pieces))
    return Building(walls, np.zeros(len(walls)), route)


def offices(rooms: int = 9, *, alike: bool = True, seed: int = 0) -> Building:
    """Return a corridor of 2.2 m with offices of 4 m on both sides, some of which are entered.

    With `alike` all offices have the same furniture in the same place.
    """
    random = np.random.default_rng(seed)
    pitch, half, deep = 4.0, 1.1, 5.0
    length = rooms * pitch
    door = [(k * pitch + 1.5, k * pitch + 2.4) for k in range(rooms)]
    pieces = _wall_with_gaps((0, half), (length, half), door)
    pieces += _wall_with_gaps((0, -half), (length, -half), door)
    for side in (1.0, -1.0):
        pieces.append(np.array([[0, side * (half + deep)], [length, side * (half + deep)]]))
        for k in range(rooms + 1):
            x = k * pitch
            pieces.append(np.array([[x, side * half], [x, side * (half + deep)]]))
        for k in range(rooms):
            dx, dy = (0.0, 0.0) if alike else random.uniform(-0.6, 0.6, 2)
            desk = plan.box(
                k * pitch + 2.6 + dx,
                side * (half + 2.2) + dy,
                k * pitch + 3.4 + dx,
                side * (half + 3.8) + dy,
            )
            pieces += list(desk)
            if not alike and random.random() < 0.6:
                x = k * pitch + random.uniform(0.2, 0.8)
                pieces += list(plan.box(x, side * (half + 4.2), x + 0.7, side * (half + 4.9)))
    pieces += [np.array([[0, half], [0, -half]]), np.array([[length, half], [length, -half]])]
    route = [(1.0, 0.0)]
    for k in range(rooms):
        x = k * pitch + 1.95
        route.append((x, 0.0))
        if k % 2 == 0:
            side = 1.0 if k % 4 == 0 else -1.0
            route += [(x, side * 3.6), (x - 0.6, side * 4.2), (x, side * 3.0), (x, 0.0)]
    route += [(length - 1.0, 0.0), (1.0, 0.0), (length / 2, 0.0)]
    return _building(pieces, route)


def court(
    length: float = 110.0, width: float = 45.0, *, laps: int = 1, glass: float = 0.0
) -> Building:
    """Return a ring of corridors 3 m wide around a court, with the same doors every 5 m.

    One corridor crosses the court. The robot goes round, across, and round the other way.
    """
    half, every, door, depth = 1.5, 5.0, 1.2, 0.15
    middle = 0.45 * length
    pieces: list[Float64] = []
    # Outer ring: niches towards the outside.
    corners = [(-half, -half), (-half, width + half), (length + half, width + half)]
    corners += [(length + half, -half), (-half, -half)]
    for a, b in pairwise(corners):
        pieces += _niches(a, b, every, door, depth)
    # Two inner blocks, left and right of the crossing corridor.
    for x0, x1 in ((half, middle - half), (middle + half, length - half)):
        block = [(x0, half), (x1, half), (x1, width - half), (x0, width - half), (x0, half)]
        for a, b in pairwise(block):
            pieces += _niches(a, b, every, door, depth)
    # A few objects that are different.
    pieces += list(plan.box(0.27 * length, half - 0.45, 0.27 * length + 1.1, half))
    pieces += list(plan.box(0.66 * length, width + half - 0.5, 0.66 * length + 2.0, width + half))
    pieces += list(plan.box(length + half - 0.4, 0.4 * width, length + half, 0.4 * width + 0.8))
    lap = [(0.0, 0.0), (length, 0.0), (length, width), (0.0, width)]
    route = [*(lap * laps), (0.0, 0.0), (middle, 0.0), (middle, width), (length, width)]
    route += [(length, 0.0), (0.6 * length, 0.0)]
    walls = np.stack(pieces)
    panes = np.zeros(len(walls))
    if glass:
        lengths = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
        panes[(lengths > 3.0) & (np.arange(len(walls)) % 7 == 0)] = glass
    return Building(walls, panes, route)


def block(size: float = 36.0, *, glass: float = 0.0) -> Building:
    """Return four blocks with crossing corridors 2.4 m wide: a window of corridors."""
    half, gap = 1.2, 0.5 * size
    pieces = list(plan.box(-half, -half, size + half, size + half))
    for i in range(2):
        for j in range(2):
            x0, y0 = i * gap + half, j * gap + half
            x1, y1 = (i + 1) * gap - half, (j + 1) * gap - half
            block = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
            for side, (a, b) in enumerate(pairwise(block)):
                pieces += _niches(a, b, 4.0 + 0.3 * side, 1.0, 0.12)
    pieces += list(plan.box(7.0, -half, 7.8, -half + 0.4))
    pieces += list(plan.box(size - 9.0, size + half - 0.5, size - 7.5, size + half))
    walls = np.stack(pieces)
    panes = np.zeros(len(walls))
    panes[np.arange(len(walls)) % 5 == 2] = glass
    m, e = gap, size
    route = [(0.0, 0.0), (e, 0.0), (e, e), (0.0, e), (0.0, 0.0), (m, 0.0), (m, e)]
    route += [(e, e), (e, m), (0.0, m), (0.0, 0.0), (e * 0.4, 0.0)]
    return Building(walls, panes, route)


def rooms(count: int = 11, *, spread: float = 0.15, seed: int = 0) -> Building:
    """Return a corridor of 2 m with similar rooms of 3.6 m on both sides, most of them entered.

    Each has the same three pieces of furniture, moved by up to `spread` (m); some are missing. The
    robot drives up, down, and up the corridor again, as in Freiburg's building 079.
    """
    random = np.random.default_rng(seed)
    pitch, half, deep = 3.6, 1.0, 5.0
    length = count * pitch
    doors = [(k * pitch + 1.3, k * pitch + 2.2) for k in range(count)]
    pieces = [np.array([[x, half], [x, -half]]) for x in (0.0, length)]
    for side in (1.0, -1.0):
        pieces += _wall_with_gaps((0, side * half), (length, side * half), doors)
        pieces.append(np.array([[0, side * (half + deep)], [length, side * (half + deep)]]))
        for k in range(count + 1):
            pieces.append(np.array([[k * pitch, side * half], [k * pitch, side * (half + deep)]]))
        for k in range(count):
            for x, y, w, h in ((2.3, 2.0, 1.0, 1.6), (0.2, 3.2, 0.8, 1.5), (0.1, 0.4, 0.5, 1.2)):
                x, y = np.array([k * pitch + x, half + y]) + random.uniform(-spread, spread, 2)
                if random.random() < 0.85:
                    low, high = sorted((side * y, side * (y + h)))
                    pieces += list(plan.box(x, low, x + w, high))

    def visit(k: int, side: float) -> list[tuple[float, float]]:
        x = k * pitch + 1.75
        return [(x, 0.0), (x, 3.0 * side), (x - 0.2, 4.0 * side), (x, 3.0 * side), (x, 0.0)]

    route = [(0.8, 0.0)]
    for k in range(count):
        route += visit(k, 1.0 if k % 2 == 0 else -1.0)
    route.append((length - 0.8, 0.0))
    for k in reversed(range(count)):
        route += visit(k, -1.0 if k % 2 == 0 else 1.0)
    route += [(0.8, 0.0), (length - 0.8, 0.0), (0.5 * length, 0.0)]
    return _building(pieces, route)


def campus(length: float = 250.0, width: float = 215.0, *, seed: int = 0) -> Building:
    """Return corridors 3 m wide around and across four blocks; the first loop closes after 550 m.

    Each corridor has door niches at its own spacing, and a few cupboards. The size is that of MIT's
    Killian Court.
    """
    random = np.random.default_rng(seed)
    half, middle, across = 1.5, 0.44 * length, 0.4 * width
    corners = [(-half, -half), (-half, width + half), (length + half, width + half)]
    corners += [(length + half, -half), (-half, -half)]
    walls = list(pairwise(corners))
    for x0, x1 in ((half, middle - half), (middle + half, length - half)):
        for y0, y1 in ((half, across - half), (across + half, width - half)):
            walls += pairwise([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
    pieces: list[Float64] = []
    for a, b in walls:
        pieces += _niches(a, b, 5.0 + random.uniform(0.0, 3.0), 1.2, 0.15)
    for _ in range(30):
        x, y = random.uniform(0.0, [length, width])
        wide, deep = random.uniform([0.3, 0.2], [1.2, 0.5])
        pieces += list(plan.box(x, -half, x + wide, deep - half))
        pieces += list(plan.box(-half, y, deep - half, y + wide))
    e, w, m, h = length, width, middle, across
    route = [(0.0, 0.0), (m, 0.0), (m, h), (e, h), (e, 0.0), (m, 0.0), (m, w), (0.0, w)]
    route += [(0.0, h), (m, h), (m, w), (e, w), (e, h), (0.6 * e, h)]
    return _building(pieces, route)


def plain_block(size: float = 50.0, *, seed: int = 0) -> Building:
    """Return four blocks with crossing corridors 2.4 m wide and few features.

    Each side has only door niches of 10 cm at its own spacing, as in the ACES building of Austin.
    """
    random = np.random.default_rng(seed)
    half, gap = 1.2, 0.5 * size
    pieces = list(plan.box(-half, -half, size + half, size + half))
    for i in range(2):
        for j in range(2):
            x0, y0 = i * gap + half, j * gap + half
            x1, y1 = (i + 1) * gap - half, (j + 1) * gap - half
            for a, b in pairwise([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]):
                pieces += _niches(a, b, 6.0 + random.uniform(0.0, 4.0), 1.0, 0.1)
    m, e = gap, size
    route = [(0.0, 0.0), (e, 0.0), (e, e), (0.0, e), (0.0, 0.0), (m, 0.0), (m, e), (e, e)]
    route += [(e, m), (0.0, m), (0.0, 0.0), (e, 0.0), (e, m), (m, m), (m, 0.0)]
    return _building(pieces, route)


def row_of_loops(
    count: int = 4, length: float = 80.0, width: float = 45.0, *, seed: int = 0
) -> Building:
    """Return loops of 250 m in a row, each beside the last, and a way back along all of them.

    Corridors of 2.6 m with door niches and a few cupboards: the other difficulty of MIT's Killian
    Court.
    """
    random = np.random.default_rng(seed)
    half, end = 1.3, count * length
    walls = list(pairwise([(-half, -half), (-half, width + half), (end + half, width + half)]))
    walls += pairwise([(end + half, width + half), (end + half, -half), (-half, -half)])
    for k in range(count):
        x0, x1, y0, y1 = k * length + half, (k + 1) * length - half, half, width - half
        walls += pairwise([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
    pieces: list[Float64] = []
    for a, b in walls:
        pieces += _niches(a, b, 4.0 + random.uniform(0.0, 4.0), 1.1, 0.12)
    for x in random.uniform(0.0, end, 4 * count):
        pieces += list(plan.box(x, -half, x + random.uniform(0.4, 1.2), 0.35 - half))
    route = [(0.0, 0.0)]
    for k in range(count):
        a, b = k * length, (k + 1) * length
        route += [(b, 0.0), (b, width), (a, width), (a, 0.0), (b, 0.0)]
    route += [(end, width), (0.0, width), (0.0, 0.0), (0.5 * length, 0.0)]
    return _building(pieces, route)


ROBOTS = {
    "good": Robot(),
    "slipping": Robot(drift=0.008, scale=1.03, noise=(0.03, 0.03), slips=(0.04, 0.15)),
    "seldom": Robot(step=0.6, yaw_step=0.5, noise=(0.03, 0.03)),
    "crowded": Robot(people=6, missing=0.05, drift=0.006),
    "accompanied": Robot(company=6, drift=0.006),
    "coarse": Robot(quantum=0.05, scale=0.9, drift=0.002),
    "near-sighted": Robot(max_range=8.0, noise=(0.02, 0.02)),
    "fine": Robot(beams=360, noise=(0.02, 0.02), sigma=0.015, people=3, missing=0.03),
    "noisy": Robot(
        sigma=0.025, drift=0.01, scale=0.97, noise=(0.03, 0.03), slips=(0.02, 0.1), missing=0.02
    ),
    "swerving": Robot(sigma=0.02, drift=0.015, scale=1.02, noise=(0.03, 0.05), slips=(0.05, 0.2)),
    "rough": Robot(sigma=0.015, drift=0.006, scale=1.02, noise=(0.03, 0.03), slips=(0.02, 0.1)),
}


def loops_of(run: plan.Run, solution: Solution) -> tuple[int, int]:
    """Return the number of accepted loop closures, and the number of wrong ones.

    A loop closure is wrong if its error is more than half a metre or 0.1 rad: another place.
    """
    at = {int(stamp): k for k, stamp in enumerate(run.stamps_ns)}
    truth = [plan.matrix(run.truth[at[k.stamp_ns]]) for k in solution.keyframes]
    accepted = [loop for loop in solution.loops if loop.accepted]
    wrong = 0
    for loop in accepted:
        T = np.linalg.inv(truth[loop.from_id]) @ truth[loop.to_id]
        x, y, yaw = plan.planar(np.linalg.inv(T) @ plan.matrix(loop.delta))
        wrong += bool(np.hypot(x, y) > 0.5 or abs(yaw) > 0.1)
    return len(accepted), wrong
