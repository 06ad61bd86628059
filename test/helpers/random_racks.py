"""Random racks of boards and a robot that observes them: worlds with their true spaces."""

from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi, sin
from typing import NamedTuple

import numpy as np
from sensor_sight import SKIN, Sight

from tccm_ros.bags.reader import DEFAULT_TOPICS
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.racks.insertions import Hand, InsertionSpace
from tccm_ros.replay.processors import Pipeline
from tccm_ros.replay.run import run_bag
from tccm_sim.engine import Simulation
from tccm_sim.flat import stop_and_scan
from tccm_sim.motion import Waypoint
from tccm_sim.options import Options
from tccm_sim.recording import record
from tccm_sim.rooms import CEILING
from tccm_sim.scene import Scene
from tccm_sim.truth import map_from_world

APPROACH = 0.3  # m, of the hand's straight motion before the front

SENSORS = {
    "laser": {},
    "camera": {"robot": "fetch"},
    "lidar": {"lidar": True, "tilt": False},
}
"""Simulator options by kind of sensor."""

ROOM = (4.6, 4.4)
PAUSE = 5.4


@dataclass(frozen=True)
class TrueSpace:
    """The space between two boards.

    Attributes
    ----------
    T_world_front
        float64 (4, 4), middle of the front edge, x inward, y to the left, z up.
    width, depth, height
        m.
    closed
        The sides of left, right and back with a panel.
    """

    T_world_front: np.ndarray
    width: float
    depth: float
    height: float
    closed: tuple[bool, bool, bool]


@dataclass(frozen=True)
class Rack:
    """A world with a rack, and the true spaces in it from the lowest up."""

    world: object
    spaces: tuple[TrueSpace, ...]
    options: Options


def random_rack(seed: int, sensor: str = "laser", **settings) -> Rack:
    """Return the rack of a seed, for a kind of sensor; `settings` are simulator options."""
    rng = np.random.default_rng(seed)
    scene = Scene()
    scene.room((0.0, ROOM[0]), (0.0, ROOM[1]), CEILING)
    width, depth = rng.uniform(0.6, 1.2), rng.uniform(0.28, 0.45)
    thickness, yaw = rng.uniform(0.018, 0.03), rng.uniform(-0.25, 0.25) + pi / 2
    count = int(rng.integers(2, 7))
    closed = tuple(bool(rng.random() < p) for p in (0.6, 0.6, 0.5))
    front = np.array([ROOM[0] / 2 + rng.uniform(-0.5, 0.5), 2.9])
    tops = rng.uniform(0.33, 0.45) + np.cumsum(np.r_[0.0, rng.uniform(0.26, 0.42, count - 1)])
    place = _Place(scene, front, yaw, width, depth)
    for k, top in enumerate(tops):
        place.box(f"board {k}", (0.0, depth), (-width / 2, width / 2), (top - thickness, top),
                  surface=f"board {k}")  # fmt: skip
    high = tops[-1]
    for is_closed, v, u in (
        (closed[0], (0.0, depth), (width / 2, width / 2 + 0.018)),
        (closed[1], (0.0, depth), (-width / 2 - 0.018, -width / 2)),
        (closed[2], (depth, depth + 0.012), (-width / 2, width / 2)),
    ):
        if is_closed:
            place.box("panel", v, u, (0.0, high))
    for u in (width / 2 - 0.015, -width / 2 + 0.015):  # posts of sides without panels
        if not closed[0 if u > 0 else 1]:
            for v in (0.015, depth - 0.015):
                place.box("post", (v - 0.012, v + 0.012), (u - 0.012, u + 0.012), (0.0, high))
    if rng.random() < 0.3:
        _door(place, rng, tops, width)
    for k, top in enumerate(tops[:-1]):
        free = tops[k + 1] - thickness - top
        for _ in range(int(rng.integers(0, 3))):
            _object(place, rng, top, free)
    spaces = tuple(
        TrueSpace(place.T_world(0.0, 0.0, low), width, depth, up - thickness - low, closed)
        for low, up in pairwise(tops)
    )
    options = Options(**SENSORS[sensor], **settings)
    return Rack(_world(scene, front, yaw, seed, rng, options), spaces, options)


def seat_below_table(sensor: str = "laser", *, has_apron: bool = False) -> Rack:
    """Return a table with a seat half below it, which is no rack.

    An apron is a board across its front, 13 cm down from the top.
    """
    rng, scene = np.random.default_rng(0), Scene()
    scene.room((0.0, ROOM[0]), (0.0, ROOM[1]), CEILING)
    front, options = np.array([ROOM[0] / 2, 2.6]), Options(**SENSORS[sensor])
    place = _Place(scene, front, pi / 2, 1.1, 0.8)
    place.box("table", (0.0, 0.8), (-0.55, 0.55), (0.70, 0.73), surface="table")
    place.box("seat", (-0.1, 0.32), (-0.35, 0.08), (0.42, 0.45), surface="seat")
    if has_apron:
        place.box("apron", (0.0, 0.02), (-0.5, 0.5), (0.60, 0.70))
    for u in (-0.52, 0.52):
        for v in (0.03, 0.77):
            place.box("leg", (v - 0.02, v + 0.02), (u - 0.02, u + 0.02), (0.0, 0.70))
    return Rack(_world(scene, front, pi / 2, 0, rng, options), (), options)


def cupboard_over_counter(low: float, sensor: str = "laser") -> Rack:
    """Return a counter before a wall, with a cupboard on the wall over a part of it."""
    rng, scene = np.random.default_rng(0), Scene()
    scene.room((0.0, ROOM[0]), (0.0, ROOM[1]), CEILING)
    front, options = np.array([ROOM[0] / 2, ROOM[1] - 0.6]), Options(**SENSORS[sensor])
    place = _Place(scene, front, pi / 2, 1.6, 0.6)
    place.box("counter", (0.0, 0.6), (-0.8, 0.8), (0.0, 0.9), surface="counter")
    place.box("cupboard", (0.25, 0.6), (-0.4, 0.5), (low, 2.2))
    space = TrueSpace(place.T_world(0.25, 0.05, 0.9), 0.9, 0.35, low - 0.9, (False, False, True))
    return Rack(_world(scene, front, pi / 2, 0, rng, options), (space,), options)


def set_back_shelf(setback: float, sensor: str = "laser") -> Rack:
    """Return a shelf on posts, whose upper boards end `setback` (m) behind its lowest one."""
    rng, scene = np.random.default_rng(0), Scene()
    scene.room((0.0, ROOM[0]), (0.0, ROOM[1]), CEILING)
    front, options = np.array([ROOM[0] / 2, 2.9]), Options(**SENSORS[sensor])
    width, depth, thickness, tops = 0.9, 0.42, 0.02, (0.40, 0.74, 1.06)
    place = _Place(scene, front, pi / 2, width, depth)
    for k, top in enumerate(tops):
        place.box(f"board {k}", (setback if k else 0.0, depth), (-width / 2, width / 2),
                  (top - thickness, top), surface=f"board {k}")  # fmt: skip
    for u in (width / 2 - 0.015, -width / 2 + 0.015):
        for v in (setback + 0.015, depth - 0.015):
            place.box("post", (v - 0.012, v + 0.012), (u - 0.012, u + 0.012), (0.0, tops[-1]))
    spaces = tuple(
        TrueSpace(place.T_world(setback, 0.0, low), width, depth - setback, up - thickness - low,
                  (False, False, False))
        for low, up in pairwise(tops)
    )  # fmt: skip
    return Rack(_world(scene, front, pi / 2, 0, rng, options), spaces, options)


class _Place:
    """A rack's own axes: v inward from the front, u to the left, z up."""

    def __init__(self, scene, front, yaw, width, depth):
        self.scene, self.front, self.yaw = scene, front, yaw
        self.width, self.depth = width, depth

    def T_world(self, v, u, z):
        c, s = cos(self.yaw), sin(self.yaw)
        T = np.eye(4)
        T[:2, :2] = [[c, -s], [s, c]]
        T[:3, 3] = [self.front[0] + c * v - s * u, self.front[1] + s * v + c * u, z]
        return T

    def box(self, name, v, u, z, angle=0.0, **traits):
        spans = np.array([v, u, z])
        middle = self.T_world(*spans.mean(axis=1))[:3, 3]
        size = spans[:, 1] - spans[:, 0]
        self.scene.box(name, size, middle, (0.0, 0.0, self.yaw + angle), **traits)


def _door(place, rng, tops, width):
    """Add an open door before the lowest space, hinged on the left."""
    angle, leaf = rng.uniform(1.2, 2.0), 0.5 * width
    hinge = np.array([0.0, width / 2])
    along = np.array([-sin(angle), -cos(angle)])
    middle = hinge + 0.5 * leaf * along + [-0.01, 0.0]
    half = np.array([0.5 * leaf, 0.008])
    place.box(
        "door",
        (middle[0] - half[0], middle[0] + half[0]),
        (middle[1] - half[1], middle[1] + half[1]),
        (tops[0], tops[1]),
        angle=float(np.arctan2(along[1], along[0])),
    )


def _object(place, rng, top, free):
    """Add an object to a board; it may touch another one."""
    edge, height = rng.uniform(0.06, 0.14), min(rng.uniform(0.08, 0.22), free - 0.03)
    v = rng.uniform(0.09, max(place.depth - 0.09, 0.1))
    u = rng.uniform(-0.5, 0.5) * (place.width - 0.3)
    place.box("thing", (v - edge / 2, v + edge / 2), (u - edge / 2, u + edge / 2),
              (top, top + height), role="object")  # fmt: skip


def _world(scene, front, yaw, seed, rng, options):
    """Return the world in which the robot stops at three places before the rack."""
    route = []
    for side in rng.permutation([-0.5, 0.0, 0.5]):
        far = rng.uniform(1.15, 1.5)
        angle = yaw + pi + side
        x, y = front + far * np.array([cos(angle), sin(angle)])
        route.append(Waypoint(float(x), float(y), float(angle + pi), PAUSE))
    return stop_and_scan(f"rack {seed}", scene, route, options)


def mapped(rack: Rack, seed: int, folder, config=None):
    """Return the outcome of a replay of a rack's recording, and T_map_world, float64 (4, 4)."""
    simulation = Simulation(rack.world, seed, rack.options)
    bag = record(simulation, folder, overwrite=True)
    return run_bag(bag, config or Config()), map_from_world(simulation)


class Mapped(NamedTuple):
    """The processor of a map at its end, and the map."""

    slam: SurfaceSlam
    solution: SurfaceSolution


def mapped_by_laser(rack: Rack, seed: int):
    """Return the map of a rack without a bag, and T_map_world, float64 (4, 4)."""
    simulation = Simulation(rack.world, seed, rack.options)
    roles = {topic: role for role, topic in DEFAULT_TOPICS.items()}
    pipeline = Pipeline(Config(), expects_odometry=True)
    for message in simulation.run():
        for each in message.records:
            pipeline.add(roles[message.topic], each)
    pipeline.finish()
    return Mapped(pipeline.slam, pipeline.solve()), map_from_world(simulation)


def same_space(found, spaces, T_map_world):
    """Return the true space at a compartment's place, or None."""
    for space in spaces:
        T = inverse(T_map_world @ space.T_world_front) @ found.T_map_front
        is_here = abs(T[2, 3]) < 0.02 and np.abs(T[:2, 3]).max() < 0.1 and T[0, 0] > 0.95
        if is_here and abs(found.height - space.height) < 0.05:
            return space
    return None


class Doors(NamedTuple):
    """Counts of open doors before compartments: found ones, true ones, and parts that are none."""

    found: int
    true: int
    false: int


DOOR_MIDDLE = 0.05
"""Maximum distance of the middle of a part from that of a door, m: only a part of it is before the
compartment. A part that is further from each leaf is none."""


def open_doors(rack, compartments, T_map_world):
    """Return the counts of open doors: those whose middles are before the front."""
    solids = [s for s in rack.world.scene.solids if s.name == "door"]
    doors = [T_map_world @ s.T_world_solid for s in solids]
    found = true = false = 0
    for space in compartments:
        T = inverse(space.T_map_front)
        places = [(T @ door)[:3, 3] for door in doors]
        before = [
            (x, y) for x, y, z in places
            if x < 0.0 and abs(y) < 0.5 * space.width and 0.0 < z < space.height
        ]  # fmt: skip
        middles = np.array([part.T_map_part[:3, 3] for part in space.open_parts]).reshape(-1, 3)
        parts = transform(T, middles)[:, :2]
        near = np.array([[np.hypot(*(a - b)) < DOOR_MIDDLE for b in before] for a in parts])
        near = near.reshape(len(parts), len(before))
        found += int(near.any(axis=0).sum())
        true += len(before)
        in_world = transform(inverse(T_map_world), middles)
        false += int((~inside(solids, in_world, grown=DOOR_MIDDLE)).sum())
    return Doors(found, true, false)


class Insertions(NamedTuple):
    """Counts of random insertions: free and visible ones, those of them that are offered, offered
    ones that intersect a solid, and sample points in offered ones."""

    free: int
    offered: int
    cut: int
    points: int


CLEARANCE = 0.02
"""Clearance around swept boxes, m: the default of `PlacementRequest`."""

VISIBLE = 0.97
"""Minimum fraction of visible points of a visible swept box."""

FRONT, CEILING_SEEN = 0.3, 0.5
"""Minimum fractions of visible points of the front of a space that was looked into (a door may hide
half of it), and of the front or the lower side of the board above it."""


def insertions(rack, outcome, T_map_world, count, seed):
    """Return the counts of random insertions, compared with the solids.

    An insertion is free if its box with `CLEARANCE` around it intersects no solid. It is visible if
    nearly all of it is visible from the sensor positions; the others are not evaluated.
    """
    rng = np.random.default_rng(seed)
    frozen, tally = rack.world.scene.freeze(), np.zeros(4, int)
    sight = Sight(rack.world, rack.options, seed, outcome, T_map_world)
    for found in outcome.solution.compartments:
        true = same_space(found, rack.spaces, T_map_world)
        if true is None:
            continue
        space = InsertionSpace(found)
        T_world_found = inverse(T_map_world) @ found.T_map_front
        for _ in range(count):
            size, hand = rng.uniform(0.05, [0.15, 0.15, 0.2]), Hand(*rng.uniform(0.05, 0.13, 2))
            low, high = 0.5 * size[:2] + CLEARANCE, [true.depth, 0.5 * true.width]
            middle = rng.uniform([low[0], low[1] - high[1]], np.subtract(high, low))
            high = max(size[2], hand.height) + CLEARANCE
            if high > true.height:
                continue
            room = _swept(rng, middle, size, hand, CLEARANCE, 2000)
            room = transform(true.T_world_front, room)
            is_free = not inside(frozen.solids, room).any()
            is_free = is_free and sight.sees(room[:60]).mean() >= VISIBLE
            at = transform(inverse(T_world_found) @ true.T_world_front, [[*middle, 0.0]])[0, :2]
            grown = size + np.array([2.0, 2.0, 1.0]) * CLEARANCE
            wide = Hand(hand.width + 2 * CLEARANCE, hand.height + CLEARANCE)
            is_offered = _is_offered(space, at, grown, wide)
            tally[0] += is_free
            tally[1] += is_free and is_offered
            if is_offered:
                points = transform(T_world_found, _swept(rng, at, size, hand, 0.0, 300))
                tally[2] += inside(frozen.solids, points).any()
                tally[3] += len(points)
    return Insertions(*tally.tolist())


def looked_into(rack, outcome, T_map_world, seed):
    """Return of which spaces the front, and the board above it, were visible, a list of bool."""
    rng = np.random.default_rng(seed)
    sight = Sight(rack.world, rack.options, seed, outcome, T_map_world)

    def fraction(space, x, z):
        y = rng.uniform(-0.5, 0.5, 400) * space.width
        points = np.column_stack(np.broadcast_arrays(x, y, z))
        return sight.sees(transform(space.T_world_front, points)).mean()

    def is_visible(space):
        x, z = rng.uniform(0.0, (space.depth, space.height), (400, 2)).T
        above = fraction(space, -SKIN, space.height + SKIN), fraction(space, x, space.height)
        return bool(fraction(space, -SKIN, z) >= FRONT and max(above) >= CEILING_SEEN)

    return [is_visible(space) for space in rack.spaces]


def cuts(rack, space, T_map_world, place, request, count=2000):
    """Return the number of sample points of a placement's swept box in a solid."""
    rng, T = np.random.default_rng(0), space.T_map_front
    middle = transform(inverse(T), place.position[None])[0, :2]
    along = abs(np.cos(place.yaw) * T[0, 0] + np.sin(place.yaw) * T[1, 0]) > 0.5
    sides = (request.size_x, request.size_y) if along else (request.size_y, request.size_x)
    hand = Hand(request.hand_width, request.hand_height)
    points = _swept(rng, middle, (*sides, request.height), hand, 0.0, count)
    return int(inside(rack.world.scene.solids, transform(inverse(T_map_world) @ T, points)).sum())


def _is_offered(space, middle, size, hand):
    """Return whether a compartment's free space contains an insertion."""
    height, (x, y) = max(size[2], hand.height), middle
    is_on = x >= 0.5 * size[0] and abs(y) + 0.5 * size[1] <= 0.5 * space.compartment.width
    if not is_on or height > space.compartment.height:
        return False
    depth = space.depth_at(y, max(size[1], hand.width), space.depths(height))
    return depth >= x + 0.5 * size[0]


def _swept(rng, middle, size, hand, margin, count):
    """Return points (count, 3) in a swept box, 3 mm over the board, in the frame of a front."""
    width, height = max(size[1], hand.width) + 2 * margin, max(size[2], hand.height) + margin
    x = rng.uniform(-APPROACH, middle[0] + 0.5 * size[0] + margin, count)
    y = middle[1] + rng.uniform(-0.5, 0.5, count) * width
    return np.column_stack([x, y, rng.uniform(0.003, height, count)])


def inside(solids, points, grown=0.0):
    """Return which points (N, 3) in the world are in a solid grown by a length, bool (N,)."""
    found = np.zeros(len(points), bool)
    for solid in solids:
        local = np.abs(transform(inverse(solid.T_world_solid), points))
        found |= (local < np.array(solid.half) + grown).all(axis=1)
    return found
