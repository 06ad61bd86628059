"""Worlds with little geometry, in which the level scans do not determine the motion.

Walls continue beyond the level laser's range, so that no end of a wall is in sight. The robot
stands still for some seconds before it drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tccm_sim.flat import stop_and_scan
from tccm_sim.motion import Waypoint
from tccm_sim.options import Options
from tccm_sim.scene import Scene
from tccm_sim.world import World

# All chosen; m and s.
FAR = 45.0  # m, beyond the level laser's range of 30 m
HEIGHT = 2.6
HALF = 1.0  # half the width of a corridor
STAND, SPEED = 5.4, 0.6
STANDING_TIME = 20.0  # of a robot that never moves
FRONT = 1.28  # x of the front: 1 m ahead of the level laser
CORRIDOR, WALL = 25.0, 12.0  # length of the drive
HALL_RADIUS, HALL_SIDES = 6.0, 120  # a side is 2 mm inside its circle
PANE, FRAME = 1.5, 0.05  # width of a pane and of the frames between panes
CABIN = 0.85  # half the width of a lift's cabin
RIDE = 8.0  # duration of a ride


def front(options: Options) -> World:
    """Return a robot standing in front of a flat wall, `translation[0]` further than 1 m."""
    scene = _open_ground(FAR)
    x = FRONT + options.translation[0]
    scene.wall("front", (x, FAR), (x, -FAR), HEIGHT)
    return _standing("front", scene, options)


def corridor(options: Options) -> World:
    """Return a corridor with plain walls, along which the robot drives."""
    scene = _open_ground(CORRIDOR + FAR)
    _two_walls(scene, CORRIDOR + FAR)
    return _driving("corridor", scene, [Waypoint(CORRIDOR, 0.0)], options)


def single_wall(options: Options) -> World:
    """Return a single wall on the left, along which the robot drives."""
    scene = _open_ground(WALL + FAR)
    scene.wall("wall", (WALL + FAR, HALF), (-FAR, HALF), HEIGHT)
    return _driving("single_wall", scene, [Waypoint(WALL, 0.0)], options)


def pole(options: Options) -> World:
    """Return a robot standing in the open, with a single pole in range."""
    scene = _open_ground(FAR)
    scene.cylinder("pole", 0.15, HEIGHT, (2.5, 0.8, HEIGHT / 2.0))
    return _standing("pole", scene, options)


def round_hall(options: Options) -> World:
    """Return a round hall, in which the robot turns away from the centre and drives across."""
    scene = _open_ground(HALL_RADIUS + 1.0)
    angles = np.linspace(0.0, 2.0 * np.pi, HALL_SIDES + 1)
    corners = HALL_RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for a, b in pairwise(corners.tolist()):
        scene.wall("wall", (a[0], a[1]), (b[0], b[1]), HEIGHT)
    route = [Waypoint(0.02, 0.0, 2.5, 1.0), Waypoint(-3.0, 2.2, 0.0, 1.0), Waypoint(1.0, 0.5)]
    return _driving("round_hall", scene, route, options)


def glass_corridor(options: Options) -> World:
    """Return a corridor of glass panes in narrow frames, with plain walls a room's depth behind."""
    length = CORRIDOR + FAR
    scene = _open_ground(length)
    _two_walls(scene, length, 4.0 * HALF)
    for side in (-1.0, 1.0):
        y = side * HALF
        scene.block("pane", (-FAR, length), (y - 0.01, y + 0.01), (0.0, HEIGHT), glass=True)
        for x in np.arange(-FAR, length, PANE):
            scene.block("frame", (x, x + FRAME), (y - 0.02, y + 0.02), (0.0, HEIGHT))
    return _driving("glass_corridor", scene, [Waypoint(CORRIDOR, 0.0)], options)


def lift(options: Options) -> World:
    """Return two floors and a lift: the robot drives in, turns, rides, and drives out.

    The corridor of the second floor runs across that of the first. The cabin's door is closed while
    the lift rides.
    """
    scene = _open_ground(20.0)
    into = [Waypoint(-4.0, 0.0, 0.0, STAND), Waypoint(0.1, 0.0, np.pi, RIDE)]
    world = _route("lift", scene, [*into, Waypoint(-3.0, 0.0, 1.0, 1.0)], options)
    start, end = world.drive.stops[1].tolist()
    middle = 0.5 * (start + end)
    low, door, back = -CABIN, -CABIN - 0.1, CABIN
    for a, b in pairwise([(low, -CABIN), (back, -CABIN), (back, CABIN), (low, CABIN)]):
        scene.wall("cabin", a, b, HEIGHT, 0.05)
    closed = (start + 0.5, end - 0.5)
    scene.block("door", (door, low), (-CABIN, CABIN), (0.0, HEIGHT), span=closed)
    before, after = (-np.inf, middle), (middle, np.inf)
    # First floor: a corridor straight to the door. Second floor: a corridor along the lift's front.
    for y in (-1.0, 1.0):
        _block_wall(scene, (-9.0, door), (1.0, 1.1), y, before)
    scene.block("wall", (-9.1, -9.0), (-1.1, 1.1), (0.0, HEIGHT), span=before)
    scene.block("pillar", (-6.3, -6.0), (0.7, 1.0), (0.0, HEIGHT), span=before)
    for y in (-1.0, 1.0):
        _block_wall(scene, (door, door + 0.1), (CABIN, 12.0), y, after)
    scene.block("wall", (-4.6, -4.5), (-12.0, 12.0), (0.0, HEIGHT), span=after)
    scene.block("cabinet", (-4.5, -4.1), (2.0, 3.1), (0.0, HEIGHT), span=after)
    for y in (-1.0, 1.0):
        _block_wall(scene, (-4.6, door), (11.9 + 0.1 * y, 12.1 + 0.1 * y), y, after)
    return world


def turning(options: Options) -> World:
    """Return a robot that turns twice on the spot in a plain corridor."""
    scene = _open_ground(FAR)
    _two_walls(scene, FAR)
    headings = np.linspace(0.0, 4.0 * np.pi, 9)[1:]
    headings_only = [Waypoint(0.0, 0.0, float(np.angle(np.exp(1j * h))), 0.5) for h in headings]
    return _driving("turning", scene, headings_only, options)


def _open_ground(end: float) -> Scene:
    scene = Scene()
    scene.floor_and_ceiling((-FAR, end), (-FAR, FAR), HEIGHT)
    return scene


def _two_walls(scene: Scene, end: float, half: float = HALF) -> None:
    """Add the walls of a corridor along x, up to `end` and equally far behind the robot."""
    scene.wall("wall", (end, half), (-FAR, half), HEIGHT)
    scene.wall("wall", (-FAR, -half), (end, -half), HEIGHT)


def _block_wall(
    scene: Scene,
    x: tuple[float, float],
    y: tuple[float, float],
    side: float,
    span: tuple[float, float],
) -> None:
    """Add a wall with limits `y` on one side of the x axis, existing for a span of time."""
    low, high = sorted((side * y[0], side * y[1]))
    scene.block("wall", x, (low, high), (0.0, HEIGHT), span=span)


def _standing(name: str, scene: Scene, options: Options) -> World:
    route = [Waypoint(0.0, 0.0, 0.0, options.duration or STANDING_TIME), Waypoint(0.0, 0.0, 0.0)]
    return _route(name, scene, route, options)


def _driving(name: str, scene: Scene, route: Sequence[Waypoint], options: Options) -> World:
    return _route(name, scene, [Waypoint(0.0, 0.0, 0.0, STAND), *route], options)


def _route(name: str, scene: Scene, route: Sequence[Waypoint], options: Options) -> World:
    last = replace(route[-1], pause=route[-1].pause or 1.0)
    return stop_and_scan(name, scene, [*route[:-1], last], options, SPEED)
