"""A room with furniture and a simulated base with its kinematics and sensors.

Independent of the code under test: this module casts rays and integrates poses itself, and tests
contacts on the true polygons.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

import numpy as np
import shapely
from numpy.random import Generator
from rays import ranges_to_sides
from shapely import Point, Polygon, affinity

from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.obstacle_memory import ObstacleMemory
from tccm_ros.approach.readings import Readings, TopCycle
from tccm_ros.approach.settings import Goal, RobotBase, Surroundings
from tccm_ros.approach.speeds import SpeedLimits, Speeds
from tccm_ros.approach.target import Target
from tccm_ros.geometry import between2, compose2, inverse2, transform2
from tccm_ros.slam.occupancy import OccupancyGrid

TICK_S = 0.05
LATENCY_S, LAG_S, WHEEL_ERROR = 0.10, 0.05, 0.02
"""Latency of commands, s, lag of the motors, s, and odometry error of each wheel."""

LOW_M = 0.25
"""Height of the level laser; robots are lower than `HEIGHT_M`."""

LASER = np.array([0.10, 0.0, 1.25])
"""The tilting laser in the base frame."""

TILT, CYCLE_LINES, LINES_PER_TICK = (0.25, 1.25), 60, 2
BEARINGS = np.linspace(-1.2, 1.2, 241)
FIRST_CYCLE_S = (CYCLE_LINES / LINES_PER_TICK + 1.0) * TICK_S
"""The base stands for its first tilt cycle before time 0."""

RANGE_SIGMA = 0.005
CUBE_M, WINDOW_CYCLES = 0.05, 10
"""Cubes of ~/obstacles, and the default of `map.window_cycles`: what left stays that long."""

WATCHDOG_S = 0.25
"""Without a new command for so long the base stops by itself, s, as the guide asks for."""

HEIGHT_M = 1.3
ROBOT = RobotBase(
    Footprint.of([(0.25, 0.22), (-0.25, 0.22), (-0.25, -0.22), (0.25, -0.22)]),
    SpeedLimits(0.25, 0.6, 0.3, 1.0), HEIGHT_M, LATENCY_S, 0.05, 8.0,
)  # fmt: skip
CELL_M = 0.05


@dataclass
class Piece:
    """A table: a top on legs, m."""

    top: Polygon
    height: float
    legs: list[Polygon]

    def moved(self, dx: float, dy: float, yaw: float) -> Piece:
        about = self.top.centroid

        def move(shape):
            return affinity.translate(affinity.rotate(shape, yaw, about, use_radians=True), dx, dy)

        return Piece(move(self.top), self.height, [move(leg) for leg in self.legs])


def piece(outline: Polygon, height: float, inset: float = 0.06) -> Piece:
    """Return a top with square legs near its corners; a round top has four."""
    inner = outline.buffer(-inset, join_style="mitre").simplify(0.01)
    corners = np.asarray(inner.exterior.coords)[:-1]
    if len(corners) > 8:
        corners = corners[:: len(corners) // 4][:4]
    return Piece(outline, height, [Point(c).buffer(0.025, quad_segs=1) for c in corners])


def rectangle(w: float, d: float) -> Polygon:
    return shapely.box(-w / 2, -d / 2, w / 2, d / 2)


def l_shape(w: float, d: float, depth: float) -> Polygon:
    return Polygon([(0, 0), (w, 0), (w, depth), (depth, depth), (depth, d), (0, d)])


def circle(radius: float) -> Polygon:
    angles = np.arange(48) * 2 * np.pi / 48
    return Polygon(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))


@cache
def _cells(room: Polygon, legs: tuple[Polygon, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells of a room's occupancy grid and its corner."""
    low = np.floor(np.array(room.bounds[:2]) / CELL_M) * CELL_M - 0.5
    high = np.array(room.bounds[2:]) + 0.5
    width, height = np.ceil((high - low) / CELL_M).astype(int)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    x, y = x * CELL_M + low[0], y * CELL_M + low[1]
    cells = np.where(shapely.contains_xy(room, x, y), 0, -1).astype(np.int8)
    points = shapely.points(x, y)
    cells[shapely.distance(room.exterior, points) < 0.6 * CELL_M] = 100
    for leg in legs:
        cells[shapely.distance(leg, points) < 0.5 * CELL_M] = 100
    return cells, low


@dataclass
class Flat:
    """A room with furniture, and its state when it was mapped.

    Attributes
    ----------
    room
        Inside of the room.
    target, mapped
        The surface to approach, now and when it was mapped.
    others, mapped_others
        Other furniture, now and when it was mapped.
    person
        (start, direction, speed, radius, start time) of a person who walks straight through the
        room, or None.
    start
        Initial planar pose of the base.
    is_round
        Whether the target is round.
    """

    room: Polygon
    target: Piece
    mapped: Piece
    others: list[Piece] = field(default_factory=list)
    mapped_others: list[Piece] = field(default_factory=list)
    person: tuple | None = None
    start: np.ndarray = field(default_factory=lambda: np.zeros(3))
    is_round: bool = False

    def pieces(self) -> list[Piece]:
        return [self.target, *self.others]

    def person_at(self, t: float) -> Polygon | None:
        if self.person is None:
            return None
        start, way, speed, radius, begins = self.person
        if t < begins:
            return None
        place = np.asarray(start) + max(t - begins, 0.0) * speed * np.asarray(way)
        body = Point(place).buffer(radius)
        return body if self.room.contains(Point(place)) else None

    def grid(self) -> OccupancyGrid:
        """Return the occupancy grid of the level laser when the flat was mapped."""
        legs = tuple(leg for p in [self.mapped, *self.mapped_others] for leg in p.legs)
        cells, low = _cells(self.room, legs)
        return OccupancyGrid(cells.copy(), CELL_M, low.copy())

    def solids(self, t: float) -> list[Polygon]:
        """Return the obstacles that the base must not touch, tops included: the robot is higher."""
        found = [p.top for p in self.pieces()] + [leg for p in self.pieces() for leg in p.legs]
        person = self.person_at(t)
        return [*found, person] if person is not None else found


class SimulatedBase:
    """The base and its sensors; the odometry frame begins where the base starts."""

    def __init__(self, flat: Flat, rng: Generator):
        self.flat, self.rng = flat, rng
        self.truth, self.odom, self.t = flat.start.copy(), np.zeros(3), -FIRST_CYCLE_S
        self._origin = flat.start.copy()
        self._sent: deque = deque([(-np.inf, Speeds())])
        self._actual, self._commanded_s = np.zeros(2), -np.inf
        self.wheels = 1.0 + rng.uniform(-WHEEL_ERROR, WHEEL_ERROR, 2)
        # Localisation error of level scans: 2 cm and 0.5 deg.
        self._lost = np.array([*rng.normal(0, 0.015, 2), rng.normal(0, np.radians(0.4))])
        self.map_odom = compose2(self._origin, self._lost)
        self._line, self._direction = 0, 1
        self._lines: list = []
        self._cycle: TopCycle | None = None
        self.window: deque = deque(maxlen=WINDOW_CYCLES)
        self.obstacles, self.obstacles_s = np.zeros((0, 3)), -np.inf
        self._memory = ObstacleMemory(CUBE_M)
        self.contacts = 0
        self.mute: set[str] = set()
        self._last: dict = {}
        self.path: list = []
        while self.t < 0.0:
            self.tick(None)
        self.readings()

    def tick(self, command: Speeds | None) -> None:
        """Advance the time by one step of the control loop; None: no command has come."""
        if command is not None:
            self._sent.append((self.t + LATENCY_S, command))
            self._commanded_s = self.t
        elif self.t > self._commanded_s + WATCHDOG_S - 1e-9:
            self._sent.append((self.t, Speeds()))
        for _ in range(5):
            dt = TICK_S / 5
            while len(self._sent) > 1 and self._sent[1][0] <= self.t + 1e-9:
                self._sent.popleft()
            wanted = (
                np.array(self._sent[0][1]) if self._sent[0][0] <= self.t + 1e-9 else np.zeros(2)
            )
            self._actual += (wanted - self._actual) * min(dt / LAG_S, 1.0)
            left, right = (self._actual[0] + s * 0.2 * self._actual[1] for s in (-1, 1))
            self.odom = compose2(self.odom, self._arc(self._actual, dt))
            left, right = left * self.wheels[0], right * self.wheels[1]
            true = np.array([(left + right) / 2, (right - left) / 0.4])
            self.truth = compose2(self.truth, self._arc(true, dt))
            self.t += dt
        self._look_down()
        self.path.append(self.truth.copy())
        body = Polygon(ROBOT.footprint.at(self.truth))
        moves = np.abs(self._actual).max() > 0.02
        if moves and any(body.intersects(solid) for solid in self.flat.solids(self.t)):
            self.contacts += 1
        if not self.flat.room.contains(body):
            self.contacts += 1

    @property
    def speed(self) -> float:
        return float(np.abs(self._actual).max())

    @staticmethod
    def _arc(speeds, dt):
        v, w = speeds
        return np.array([v * dt * np.cos(w * dt / 2), v * dt * np.sin(w * dt / 2), w * dt])

    def level_scan(self) -> np.ndarray:
        """Return the points (N, 2) of a level scan, in the base frame."""
        bearings = np.linspace(-np.pi, np.pi, 361)[:-1]
        shapes = [leg for p in self.flat.pieces() for leg in p.legs]
        person = self.flat.person_at(self.t)
        shapes += [person] if person is not None else []
        corners = [np.asarray(self.flat.room.exterior.coords)]
        corners += [np.asarray(s.exterior.coords) for s in shapes]
        a = np.concatenate([c[:-1] for c in corners]) - self.truth[:2]
        b = np.concatenate([c[1:] for c in corners]) - self.truth[:2]
        angles = bearings + self.truth[2]
        d = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        r = ranges_to_sides(d, a, b - a, 0.0)
        r = r + self.rng.normal(0, RANGE_SIGMA, len(r))
        seen = np.isfinite(r)
        return (r[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1))[seen]

    def _look_down(self) -> None:
        """Cast the scan lines of this step; end the tilt cycle at the joint's turning points."""
        for _ in range(LINES_PER_TICK):
            tilt = np.interp(self._line / CYCLE_LINES, [0, 1], TILT)
            self._lines.append(transform2_3(self.odom, self._scan_line(tilt)))
            self._line += self._direction
            if not 0 <= self._line <= CYCLE_LINES:
                self._direction = -self._direction
                # The turning angle varies from cycle to cycle.
                self._line += self._direction * (1 + self.rng.random())
                stamp = self.t - 0.5 * len(self._lines) / LINES_PER_TICK * TICK_S
                sensor = transform2_3(self.odom, LASER[None])[0]
                self._cycle = TopCycle(stamp, np.concatenate(self._lines), sensor)
                self._lines = []
                self._remember(self._cycle)

    def _remember(self, cycle: TopCycle) -> None:
        """Replace the obstacles that a cycle looked at by those that it saw, as clearing does.

        Those of the cycle before the window are forgotten.
        """
        for k, points in enumerate(self.window):
            self.window[k] = points[~self._looks_at(points)]
        self.window.append(cycle.points[cycle.points[:, 2] > CUBE_M])
        points = np.concatenate(self.window)
        x, y, z = np.floor(points / CUBE_M).astype(np.int64).T
        _, first = np.unique((x << 40) + (y << 20) + z, return_index=True)
        self.obstacles, self.obstacles_s = points[first], cycle.stamp_s
        cuboids = self.obstacles.copy()
        cuboids[:, :2] = (np.floor(cuboids[:, :2] / CUBE_M) + 0.5) * CUBE_M
        self._memory.forget_visible(cycle)
        self._memory.add(cuboids, self.odom[:2])

    def _looks_at(self, points: np.ndarray) -> np.ndarray:
        """Return which points (N, 3) in odom are within the beams of a tilt cycle from here."""
        x, y, z = (transform2_3(inverse2(self.odom), points) - LASER).T
        bearing, tilt = np.arctan2(y, np.hypot(x, z)), np.arctan2(-z, x)
        return (np.abs(bearing) < BEARINGS[-1]) & (tilt > TILT[0]) & (tilt < TILT[1])

    def _scan_line(self, tilt: float) -> np.ndarray:
        """Return the points (N, 3) on horizontal surfaces of one scan line, in the base frame."""
        c, s = np.cos(BEARINGS), np.sin(BEARINGS)
        d = np.stack([c * np.cos(tilt), s, -c * np.sin(tilt)], axis=1)
        best = np.full(len(d), np.inf)
        pieces = sorted(self.flat.pieces(), key=lambda p: -p.height)
        tops = [(p.top, p.height) for p in pieces] + [(self.flat.room, 0.0)]
        for top, height in tops:
            r = (height - LASER[2]) / np.minimum(d[:, 2], -1e-6)
            near = np.flatnonzero((r < best) & (r < 6.0))
            hit = LASER + r[near, None] * d[near]
            xy = transform2(self.truth, hit[:, :2])
            hits = near[shapely.contains_xy(top, *xy.T)]
            best[hits] = r[hits]
        ok = np.isfinite(best)
        r = best[ok] + self.rng.normal(0, RANGE_SIGMA, int(ok.sum()))
        return LASER + r[:, None] * d[ok]

    def readings(self) -> Readings:
        """Return the newest measurements of all inputs that are not in `mute`."""
        now = {
            "odom": (self.odom.copy(), self.t),
            "scan": (transform2(self.odom, self.level_scan()), self.t, self.odom[:2].copy()),
            "cycle": (self._cycle, self._memory.points, self.obstacles_s),
            "map": self.map_odom,
        }
        for name in now:
            if name not in self.mute:
                self._last[name] = now[name]
        map_odom = None if "map" in self.mute else self.map_odom
        (pose, pose_s), scan = self._last["odom"], self._last["scan"]
        cycle, cuboids, cuboids_s = self._last["cycle"]
        return Readings(
            self.t, pose, pose_s, map_odom, "it is lost", *scan, cuboids, cuboids_s, cycle, CUBE_M
        )  # fmt: skip

    def true_figures(self) -> tuple[float, float]:
        """Return the true gap, m, and the angle to the nearest edge's normal, rad."""
        body = Polygon(ROBOT.footprint.at(self.truth))
        gap = body.distance(self.flat.target.top)
        origin = Point(self.truth[:2])
        outline = self.flat.target.top.exterior
        if self.flat.is_round:
            middle = np.asarray(self.flat.target.top.centroid.coords)[0]
            way = middle - self.truth[:2]
            error = np.arctan2(way[1], way[0]) - self.truth[2]
        else:
            coords = np.asarray(outline.coords)
            sides = [shapely.LineString(pair) for pair in pairwise(coords)]
            ahead = transform2(self.truth, np.array([[ROBOT.footprint.front + gap, 0.0]]))[0]
            k = int(np.argmin([side.distance(Point(ahead)) for side in sides]))
            way = coords[k + 1] - coords[k]
            error = np.arctan2(way[0], -way[1]) - self.truth[2]
        assert not self.flat.target.top.contains(origin)
        return gap, float((error + np.pi) % (2 * np.pi) - np.pi)


def transform2_3(pose, points):
    """Move points (N, 3) by a planar pose."""
    return np.concatenate([transform2(pose, points[:, :2]), points[:, 2:]], axis=1)


def mapped_target(flat: Flat, rng: Generator | None = None) -> Target:
    """Return the mapped surface, with errors of 5 mm and 0.3 deg if `rng` is given."""
    top = flat.mapped.top
    if rng is not None:
        dx, dy = rng.normal(0, 0.005, 2)
        about = top.centroid
        top = affinity.rotate(top, np.degrees(rng.normal(0, 0.005)), about)
        top = affinity.translate(top, dx, dy)
    outline = np.asarray(shapely.geometry.polygon.orient(top).exterior.coords)[:-1]
    box = np.asarray(shapely.oriented_envelope(top).exterior.coords)
    sides = np.diff(box[:3], axis=0)
    long = sides[int(np.hypot(*sides.T).argmax())]
    pose = np.array([*box[:4].mean(axis=0), np.arctan2(long[1], long[0])])
    return Target(outline, pose, flat.mapped.height, flat.is_round)


def surroundings(flat: Flat) -> Surroundings:
    outlines = [np.asarray(p.top.exterior.coords)[:-1] for p in flat.mapped_others]
    same = [
        o for p, o in zip(flat.mapped_others, outlines)
        if abs(p.height - flat.mapped.height) < 0.03
    ]  # fmt: skip
    return Surroundings(flat.grid(), outlines, same)


def a_goal(flat: Flat, rng: Generator | None = None, **fields) -> Goal:
    values = {"gap": 0.05, "staging": 0.4, "max_distance": 0.9} | fields
    return Goal(mapped_target(flat, rng), **values)


def simple_flat(top: Polygon | None = None, move=(0.0, 0.0, 0.0), start=(-1.8, 0.3, 0.2)) -> Flat:
    """Return a table in the middle of an empty room of 6 m."""
    mapped = piece(top if top is not None else rectangle(1.4, 0.8), 0.72)
    is_round = top is not None and len(top.exterior.coords) > 20
    room = shapely.box(-3.0, -3.0, 3.0, 3.0)
    return Flat(room, mapped.moved(*move), mapped, start=np.array(start), is_round=is_round)


def run(approach, base: SimulatedBase, seconds: float = 180.0, on_tick=lambda base: None):
    """Run an approach to its end; return its outcome."""
    while approach.outcome is None and base.t < seconds:
        on_tick(base)
        base.tick(approach.step(base.readings()))
    for _ in range(20):
        base.tick(Speeds())
    return approach.outcome


def relative(pose, other):
    """Return a planar pose relative to another."""
    return between2(other, pose)


def in_map(base: SimulatedBase, pose):
    return compose2(inverse2(base.map_odom), pose)
