"""Rooms at random whose furniture changes while the robot is elsewhere.

``random_rooms(seed, options)`` has two rooms, as the simulator's world `changing`. The robot is
in the first, the second, the first, the second and the first again. Meanwhile each piece of the
first stays, is moved within the room, carried to the other room, carried out, or lifted or lowered
in its place, and another one comes. The same seed gives the same rooms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import pi

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from shapely import Polygon, box
from shapely.affinity import rotate, translate

from tccm_ros.geometry import transform
from tccm_ros.scene.changes import ChangeKind
from tccm_sim.engine import Simulation
from tccm_sim.flat import stop_and_scan
from tccm_sim.motion import Waypoint, drive
from tccm_sim.options import Options
from tccm_sim.rooms import CEILING
from tccm_sim.scene import Motion, Scene, Traits
from tccm_sim.truth import map_from_world
from tccm_sim.world import World

__all__ = ["Piece", "in_map", "random_rooms"]

Array = NDArray[np.float64]

WALL, DOOR = -2.6, 0.7
"""x of the wall between the rooms, and half the width of the opening in it, m."""

CYCLE, PAUSE = 4.0, 12.6
"""Tilt cycle and stop, s: three views of each stop, and an event is told by the second."""

JUMP = 0.01
"""Furniture is moved within this, s, while the robot is on its way."""

FRONT, BACK, SIDE = 1.2, 2.8, 2.2
"""Middles of pieces are so far before the first stop, and at most so far beside it, m."""

OTHER_ROOM = (-6.2, -1.0), (-6.2, 1.0)
"""Middles of what is carried to the other room, m."""

GAP, TRIALS = 0.15, 200
"""Min distance of pieces at any time, m, and how often a place is looked for."""

SIZES = [(0.45, 0.45), (0.6, 0.6), (0.55, 0.95), (0.7, 1.2), (0.5, 0.75), (0.65, 0.8), (0.4, 1.1)]
"""Depths and widths of pieces, m. In a sequence each is there once."""

LOW, RISE, SPREAD = 0.45, 0.12, 0.06
"""Height of a piece in front, m, what it gains per metre behind, and what chance adds: a piece
hides none behind it."""

LIFT = (0.03, 0.1)
"""Pieces are lifted or lowered by so much, m."""

STEP, YAW = (0.15, 0.4), 0.3
"""Pieces are moved by so much, m, or by more, as far before the stop as they were; and rotated by
up to so much, rad. Scan lines are up to 0.12 m from each other at the farthest of them."""

FATES = {
    "stays": (ChangeKind.APPEARED,),
    "moved a little": (ChangeKind.APPEARED, ChangeKind.MOVED),
    "moved": (ChangeKind.APPEARED, ChangeKind.MOVED),
    "lifted or lowered": (ChangeKind.APPEARED, ChangeKind.MOVED),
    "to the other room": (ChangeKind.APPEARED, ChangeKind.GONE, ChangeKind.MOVED),
    "carried out": (ChangeKind.APPEARED, ChangeKind.GONE),
    "comes": (ChangeKind.APPEARED,),
}
"""What may happen to a piece, and its events. What is carried to the other room is gone first."""


@dataclass(frozen=True)
class Piece:
    """A piece of furniture.

    Attributes
    ----------
    name
        Of its surface in the truth.
    fate
        Of `FATES`.
    first, last
        float64 (3,), middle of its top before and after, m.
    """

    name: str
    fate: str
    first: Array
    last: Array

    @property
    def kinds(self) -> tuple[ChangeKind, ...]:
        """Its true events, in order."""
        return FATES[self.fate]


def in_map(pieces: list[Piece], simulation: Simulation) -> list[Piece]:
    """Return pieces whose places are those in map."""
    T = map_from_world(simulation)
    return [Piece(p.name, p.fate, *transform(T, np.stack([p.first, p.last]))) for p in pieces]


def random_rooms(seed: int, options: Options) -> tuple[World, list[Piece]]:
    """Return the two rooms of a seed, and what stands in the first, with places in world."""
    rng = np.random.default_rng(seed)
    other = Waypoint(-5.0, 0.0, pi, PAUSE)
    first, again, last = (Waypoint(*rng.uniform(-0.1, 0.1, 2), 0.0, PAUSE) for _ in range(3))
    route = [first, other, again, other, last]
    stops = drive(route, options.base_tilt).stops
    scene = Scene()
    scene.room((-7.4, 4.5), (-2.8, 2.8), CEILING)
    for low, high in ((-2.8, -DOOR), (DOOR, 2.8)):
        scene.wall("inner wall", (WALL, low), (WALL, high), CEILING, 0.1, two_sided=True)
    furniture = _Furniture(scene, rng, (float(stops[1:3].mean()), float(stops[3:5].mean())))
    sizes = rng.permutation(SIZES).tolist()
    for size, fate in zip(sizes, rng.permutation(list(FATES)).tolist()):
        furniture.add(size, fate)
    changed = options.model_copy(update={"cycle_period": CYCLE})
    return stop_and_scan(f"changing rooms {seed}", scene, route, changed), furniture.pieces


@dataclass
class _Furniture:
    """Pieces in the first room, with what they cover at any time.

    Attributes
    ----------
    scene, rng
        Where they are added, and what chooses.
    times
        When furniture is moved, s.
    pieces, covered
        What was added.
    """

    scene: Scene
    rng: Generator
    times: tuple[float, float]
    pieces: list[Piece] = field(default_factory=list)
    covered: list[Polygon] = field(default_factory=list)

    def add(self, size: tuple[float, float], fate: str) -> None:
        """Add a piece, where there is room for it."""
        rng = self.rng
        place = self._find_place(size, 0.0, lambda: rng.uniform((FRONT, -SIDE), (BACK, SIDE)))
        offset = None if place is None else self._offset(size, fate, place)
        if place is None or offset is None:
            return
        height = LOW + RISE * (place[0] - FRONT) + rng.uniform(0.0, SPREAD)
        first = np.array([*place, height])
        # What is carried to the other room is first missed, then found there.
        time = self.times[0] if fate == "to the other room" else float(rng.choice(self.times))
        name = f"{fate} {len(self.pieces)}"
        self._build(name, (*size, height), place, _traits(fate, time, offset))
        self.pieces.append(Piece(name, fate, first, first + offset[:3]))

    def _offset(self, size: tuple[float, float], fate: str, place: Array) -> Array | None:
        """Return how a piece is moved: x, y, z, m, and yaw, rad; None: there is no room."""
        rng = self.rng
        if fate == "lifted or lowered":
            return np.array([0.0, 0.0, rng.uniform(*LIFT) * rng.choice([-1.0, 1.0]), 0.0])
        if fate == "to the other room":
            return np.array([*(rng.permutation(OTHER_ROOM)[0] - place), 0.0, 0.0])
        if not fate.startswith("moved"):
            return np.zeros(4)

        def choose() -> Array:
            if fate == "moved":
                aside = rng.uniform(STEP[1], 2.0 * SIDE) * rng.choice([-1.0, 1.0])
                return np.array([place[0] + rng.uniform(-0.2, 0.2), place[1] + aside])
            angle = rng.uniform(-pi, pi)
            step = rng.uniform(*STEP) * np.array([np.cos(angle), np.sin(angle)])
            return np.asarray(place + step)

        yaw = rng.uniform(-YAW, YAW)
        own = self.covered.pop()
        there = self._find_place(size, yaw, choose)
        self.covered.append(own)
        return None if there is None else np.array([*(there - place), 0.0, yaw])

    def _find_place(
        self, size: tuple[float, float], yaw: float, choose: Callable[[], Array]
    ) -> Array | None:
        """Find a middle off all other pieces, and cover it; None: no room."""
        for _ in range(TRIALS):
            middle = choose()
            half = 0.5 * np.array(size)
            outline = translate(rotate(box(*-half, *half), yaw, use_radians=True), *middle)
            inside = FRONT - 0.2 <= middle[0] <= BACK + 0.2 and abs(middle[1]) <= SIDE
            if inside and all(outline.distance(other) >= GAP for other in self.covered):
                self.covered.append(outline)
                return middle
        return None

    def _build(self, name: str, size: tuple[float, ...], place: Array, traits: Traits) -> None:
        """Add a block, or a board on one leg."""
        height = size[2]
        board = 0.03 if self.rng.random() < 0.5 else height
        center = (*place, height - board / 2.0)
        self.scene.box(name, (*size[:2], board), center, surface=name, **traits)
        if board < height:
            leg = height - board
            self.scene.cylinder(name, 0.05, leg, (*place, leg / 2.0), **traits)


def _traits(fate: str, time: float, offset: Array) -> Traits:
    """Return motion and span of a piece to which its fate comes at a time, s."""
    if fate == "comes":
        return {"span": (time, np.inf)}
    if fate == "carried out":
        return {"span": (-np.inf, time)}
    if not offset.any():
        return {}
    return {"motion": Motion.through([(time, *np.zeros(4)), (time + JUMP, *offset)])}
