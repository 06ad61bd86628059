"""Flats with furniture at random, to evaluate the surface map over more than one layout.

``random_flat(seed, options)`` is a world like those of ``tccm_sim``: two or three
rooms in a row, furniture along the walls and in the middle, a robot that stops two or three times
in each room and comes back. The same seed gives the same flat.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import pi

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tccm_sim.flat import chair, shelves, stop_and_scan
from tccm_sim.motion import Waypoint
from tccm_sim.options import Options
from tccm_sim.scene import Scene
from tccm_sim.world import Room as TrueRoom
from tccm_sim.world import World

__all__ = ["random_flat"]

HEIGHT, THICKNESS = 2.5, 0.12
PAUSE = 5.4
CLEAR = 0.45
"""Half the width of what the robot needs along its route, m."""
GAP = 0.12
"""Min distance of pieces of furniture, m."""

Box = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max."""


@dataclass
class Room:
    """A room: its walls, the robot's lane through it (y), and what stands there."""

    x: tuple[float, float]
    y: tuple[float, float]
    lane: float
    taken: list[Box] = field(default_factory=list)

    def is_free(self, box: Box) -> bool:
        """Tell whether a piece can stand there: inside, off the lane and off the others."""
        inside = (
            self.x[0] - 1e-9 <= box[0] and box[2] <= self.x[1] + 1e-9
            and self.y[0] - 1e-9 <= box[1] and box[3] <= self.y[1] + 1e-9
        )  # fmt: skip
        off_lane = box[1] > self.lane + CLEAR or box[3] < self.lane - CLEAR
        return inside and off_lane and not any(_overlap(box, other, GAP) for other in self.taken)


def _overlap(a: Box, b: Box, gap: float) -> bool:
    return (
        a[0] < b[2] + gap and b[0] < a[2] + gap and a[1] < b[3] + gap and b[1] < a[3] + gap
    )  # fmt: skip


ALL_STOPS = slice(None)


def random_flat(seed: int, options: Options | None = None, *, stops: slice = ALL_STOPS) -> World:
    """Return the flat of a seed; the options vary the robot, as in ``tccm simulate``.

    The robot makes only the `stops` of its route.
    """
    rng = np.random.default_rng(seed)
    scene = Scene()
    rooms = _rooms(scene, rng)
    for number, room in enumerate(rooms):
        _furnish(scene, room, f"room {number + 1}", rng)
    options = options or Options()
    route = _route(rooms, rng)[stops]
    route += route[1:] * (options.laps - 1)
    world = stop_and_scan(f"random flat {seed}", scene, route, options)
    return replace(world, rooms=tuple(map(_true_room, range(1, len(rooms) + 1), rooms)))


def _true_room(number: int, room: Room) -> TrueRoom:
    """Return a room as the world tells it."""
    corners = [(x, y) for x in room.x for y in room.y]
    return TrueRoom(f"room {number}", np.array(corners)[[0, 2, 3, 1]])


def _rooms(scene: Scene, rng: Generator) -> list[Room]:
    """Add floor, ceiling and walls; doors are in line, and so is the lane."""
    count, depth = int(rng.integers(2, 4)), rng.uniform(4.2, 5.6)
    widths = rng.uniform(3.4, 4.8, count)
    ends = np.concatenate([[0.0], np.cumsum(widths)])
    lane = rng.uniform(0.42, 0.58) * depth
    scene.floor_and_ceiling((-0.2, ends[-1] + 0.2), (-0.2, depth + 0.2), HEIGHT)
    corners = [(0.0, 0.0), (ends[-1], 0.0), (ends[-1], depth), (0.0, depth), (0.0, 0.0)]
    for start, end in pairwise(corners):
        scene.wall("outer wall", start, end, HEIGHT, THICKNESS)
    for x in ends[1:-1]:
        for low, high in ((0.0, lane - 0.5), (lane + 0.5, depth)):
            scene.wall("inner wall", (x, low), (x, high), HEIGHT, THICKNESS, two_sided=True)
    return [
        Room((a + (THICKNESS if a > 0 else 0.0), b), (0.0, depth), lane)
        for a, b in zip(ends[:-1].tolist(), ends[1:].tolist())
    ]


def _route(rooms: list[Room], rng: Generator) -> list[Waypoint]:
    """Stop two or three times in each room, with headings that differ, and come back."""
    route: list[Waypoint] = []
    for room in rooms:
        for x in np.linspace(room.x[0] + 0.9, room.x[1] - 0.9, int(rng.integers(2, 4))):
            up = 1.0 if rng.random() < 0.5 else -1.0
            if route and route[-1].heading is not None:
                up = -np.sign(np.sin(route[-1].heading))
            heading = up * rng.uniform(0.35, 0.65) * pi
            route.append(Waypoint(float(x), room.lane + rng.uniform(-0.1, 0.1), heading, PAUSE))
    back = rooms[0]
    middle = float(np.mean(back.x))
    return [*route, Waypoint(middle, back.lane, pi * rng.uniform(-0.6, 0.6), PAUSE)]


def _furnish(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    """Put a choice of furniture along the walls y = low and y = high, as far as there is room."""
    pieces = [_counter, _table, _shelf, _sideboard, _bench, _ledge, _side_table, _table, _cabinet]
    for piece in rng.permutation(len(pieces)).tolist():
        pieces[piece](scene, room, name, rng)


def _find_place(
    room: Room, rng: Generator, size: tuple[float, float], *, at_wall: bool
) -> tuple[NDArray[np.float64], float] | None:
    """Find a place for a footprint: (its middle, direction away from the wall); None: no room."""
    for _ in range(40):
        side = 1.0 if rng.random() < 0.5 else -1.0
        x = rng.uniform(room.x[0] + size[0] / 2, room.x[1] - size[0] / 2)
        off = 0.0 if at_wall else rng.uniform(0.1, 0.7)
        wall = room.y[0] if side > 0 else room.y[1]
        y = wall + side * (off + size[1] / 2)
        box = (x - size[0] / 2, y - size[1] / 2, x + size[0] / 2, y + size[1] / 2)
        if room.is_free(box):
            room.taken.append(box)
            return np.array([x, y]), side
    return None


def _block(
    scene: Scene, name: str, middle: NDArray[np.float64], size: tuple[float, float],
    z: tuple[float, float], surface: str,
) -> None:  # fmt: skip
    x, y = middle
    spans = (x - size[0] / 2, x + size[0] / 2), (y - size[1] / 2, y + size[1] / 2)
    scene.block(name, *spans, z, surface=surface)


def _objects(
    scene: Scene, middle: NDArray[np.float64], size: tuple[float, float], top: float,
    count: int, rng: Generator,
) -> None:  # fmt: skip
    """Put boxes and cylinders on a top, at a distance from each other."""
    placed: list[NDArray[np.float64]] = []
    for _ in range(20 * count):
        if len(placed) == count:
            return
        at = middle + (rng.random(2) - 0.5) * (np.array(size) - 0.2)
        if all(np.hypot(*(at - other)) > 0.24 for other in placed):
            placed.append(at)
            edge, height = rng.uniform(0.07, 0.16), rng.uniform(0.07, 0.25)
            center = (float(at[0]), float(at[1]), top + height / 2)
            if rng.random() < 0.5:
                scene.cylinder("thing", edge / 2, height, center, role="object")
            else:
                rpy = (0.0, 0.0, float(rng.uniform(0, pi)))
                scene.box("thing", (edge, 0.8 * edge, height), center, rpy, role="object")


def _counter(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    size, top = (rng.uniform(1.2, 2.2), 0.6), rng.uniform(0.86, 0.95)
    found = _find_place(room, rng, size, at_wall=True)
    if found:
        _block(scene, "counter", found[0], size, (0.0, top), f"counter of {name}")
        _objects(scene, found[0], size, top, int(rng.integers(1, 4)), rng)


def _table(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    size, yaw = (rng.uniform(0.9, 1.5), rng.uniform(0.6, 0.85)), rng.uniform(-0.2, 0.2)
    around = (size[0] + 0.3, size[1] + 0.35)
    found = _find_place(room, rng, around, at_wall=False)
    if found is None:
        return
    top, (x, y) = rng.uniform(0.70, 0.76), found[0].tolist()
    label = f"table {len(room.taken)} of {name}"
    scene.table(label, size, top, (x, y), yaw)
    _objects(scene, found[0], (0.8 * size[0], 0.7 * size[1]), top, int(rng.integers(0, 4)), rng)
    ahead = (x + rng.uniform(-0.2, 0.2), y + found[1] * (around[1] / 2 + 0.3))
    box = (ahead[0] - 0.25, ahead[1] - 0.25, ahead[0] + 0.25, ahead[1] + 0.25)
    if room.is_free(box):
        room.taken.append(box)
        chair(scene, f"chair at {label}", ahead, -found[1] * pi / 2 + rng.uniform(-0.3, 0.3))


def _shelf(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    size = (rng.uniform(0.8, 1.2), rng.uniform(0.30, 0.42))
    found = _find_place(room, rng, size, at_wall=True)
    if found:
        (x, y), first, step = found[0], rng.uniform(0.36, 0.45), rng.uniform(0.36, 0.42)
        spans = (x - size[0] / 2, x + size[0] / 2), (y - size[1] / 2, y + size[1] / 2)
        heights = [first + k * step for k in range(3)]
        shelves(scene, f"shelf of {name}", *spans, heights, (1, 0))


def _sideboard(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    size, top = (rng.uniform(1.0, 1.6), rng.uniform(0.40, 0.48)), rng.uniform(0.70, 0.85)
    found = _find_place(room, rng, size, at_wall=True)
    if found:
        _block(scene, "sideboard", found[0], size, (0.0, top), f"sideboard of {name}")
        _objects(scene, found[0], size, top, int(rng.integers(3, 8)), rng)


def _bench(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    size, top = (rng.uniform(0.9, 1.5), rng.uniform(0.38, 0.5)), rng.uniform(0.42, 0.48)
    found = _find_place(room, rng, size, at_wall=True)
    if found:
        _block(scene, "bench", found[0], size, (0.0, top), f"bench of {name}")


def _ledge(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    size, top = (rng.uniform(0.7, 1.1), rng.uniform(0.16, 0.22)), rng.uniform(0.95, 1.1)
    found = _find_place(room, rng, size, at_wall=True)
    if found:
        _block(scene, "ledge", found[0], size, (top - 0.05, top), f"ledge of {name}")


def _side_table(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    edge, top = rng.uniform(0.40, 0.55), rng.uniform(0.45, 0.56)
    found = _find_place(room, rng, (edge + 0.05, edge + 0.05), at_wall=False)
    if found:
        x, y = found[0].tolist()
        scene.table(f"side table of {name}", (edge, edge), top, (x, y), rng.uniform(-0.1, 0.1))


def _cabinet(scene: Scene, room: Room, name: str, rng: Generator) -> None:
    """A cabinet too high to see onto."""
    found = _find_place(room, rng, (0.6, 0.6), at_wall=True)
    if found:
        _block(scene, "cabinet", found[0], (0.6, 0.6), (0.0, 1.9), "")
