"""A ring of corridors, 100 m long, for loop closures with heading drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tccm_sim.flat import stop_and_scan
from tccm_sim.motion import Waypoint
from tccm_sim.options import Options
from tccm_sim.robots import SEGWAY
from tccm_sim.scene import Scene
from tccm_sim.world import World

Point = tuple[float, float]

LENGTH, WIDTH = 30.0, 20.0  # m, of the loop along the middle of the corridors
HALF = 1.0  # m, half the width of a corridor
HEIGHT = 2.6  # m, of the walls
HEADING_DRIFT = 0.012  # rad/m
SPEED = 0.8  # m/s
PAUSE = 5.4  # s

# Niches of the outer wall per side: (from, to, depth), m along the side. All sides differ.
NICHES: tuple[tuple[tuple[float, float, float], ...], ...] = (
    ((5.0, 6.2, 0.3), (9.0, 11.5, 1.0), (21.0, 22.0, 0.25), (26.5, 28.0, 0.8)),
    ((4.0, 5.0, 0.25), (12.0, 15.0, 1.2)),
    ((3.0, 4.0, 0.3), (8.5, 9.5, 0.25), (17.0, 20.0, 0.9), (27.0, 28.0, 0.3)),
    ((6.0, 7.5, 0.6), (16.0, 17.0, 0.25)),
)

# Furniture: name, centre, size (x, y), height; the tops are surfaces.
FURNITURE = (
    ("bench", (4.2, 0.75), (1.4, 0.40), 0.45),
    ("table in the niche", (9.3, -1.5), (1.6, 0.70), 0.75),
    ("cabinet", (18.0, 0.72), (1.0, 0.45), 0.90),
    ("copier", (31.6, 13.3), (0.7, 1.1), 1.00),
    ("bench at the window", (12.0, 19.3), (0.9, 0.40), 0.45),
    ("print table", (-1.3, 14.25), (0.5, 0.9), 0.72),
)


START = Waypoint(2.0, 0.0, 0.0, PAUSE)
LAP = (
    Waypoint(9.0, 0.0, -1.0, PAUSE),
    Waypoint(16.5, 0.0, 0.6, PAUSE),
    Waypoint(LENGTH - 1.0, 0.0),
    Waypoint(LENGTH, 1.0),
    Waypoint(LENGTH, 12.2, 1.0, PAUSE),
    Waypoint(LENGTH, WIDTH - 1.0),
    Waypoint(LENGTH - 1.0, WIDTH),
    Waypoint(13.5, WIDTH, -2.9, PAUSE),
    Waypoint(1.0, WIDTH),
    Waypoint(0.0, WIDTH - 1.0),
    Waypoint(0.0, 13.8, 2.9, PAUSE),
    Waypoint(0.0, 1.0),
    Waypoint(1.0, 0.0),
)
"""Waypoints of one lap from the start."""


def ring(options: Options) -> World:
    """Return the ring; the robot drives `laps` laps and 8 m more, with six stops."""
    route = [START, *(LAP * options.laps), replace(START, x=3.0), LAP[0], replace(LAP[0], x=10.0)]
    return ring_world(route, options)


def ring_world(route: Sequence[Waypoint], options: Options) -> World:
    """Return the ring with another route of the robot.

    Parameters
    ----------
    route
        Waypoints along the middle of the corridors.
    options
        Variations of the world.
    """
    scene = Scene()
    scene.floor_and_ceiling((-3.0, LENGTH + 3.0), (-3.0, WIDTH + 3.0), HEIGHT)
    _outer_walls(scene)
    _inner_walls(scene)
    for name, (x, y), (dx, dy), height in FURNITURE:
        span_x, span_y = (x - dx / 2, x + dx / 2), (y - dy / 2, y + dy / 2)
        scene.block(name, span_x, span_y, (0.0, height), surface=name)
    rig = replace(SEGWAY, errors=replace(SEGWAY.errors, drift=HEADING_DRIFT))
    return replace(stop_and_scan("ring", scene, route, options, SPEED), rig=rig)


def _outer_walls(scene: Scene) -> None:
    """Add the outer walls, counter-clockwise, with their niches."""
    low, right, top = -HALF, LENGTH + HALF, WIDTH + HALF
    corners = [(low, low), (right, low), (right, top), (low, top), (low, low)]
    for (start, end), niches in zip(pairwise(corners), NICHES):
        for a, b in pairwise(_with_niches(start, end, niches)):
            scene.wall("outer wall", a, b, HEIGHT)


def _with_niches(
    start: Point, end: Point, niches: Sequence[tuple[float, float, float]]
) -> list[Point]:
    """Return the corners of a wall from start to end with niches on its right."""
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    corners = [start]
    for first, last, depth in niches:
        for along, out in ((first, 0.0), (first, depth), (last, depth), (last, 0.0)):
            x = start[0] + along * ux + out * uy
            corners.append((x, start[1] + along * uy - out * ux))
    return [*corners, end]


def _inner_walls(scene: Scene) -> None:
    """Add the walls of the central block, clockwise, with a few pilasters."""
    right, top = LENGTH - HALF, WIDTH - HALF
    corners = [
        (HALF, HALF),
        (HALF, top),
        (right, top),
        (right, HALF),
        (HALF, HALF),
    ]
    for start, end in pairwise(corners):
        scene.wall("inner wall", start, end, HEIGHT)
    for x, y in (
        (7.3, HALF),
        (12.9, HALF),
        (24.1, HALF),
        (right, 6.7),
        (right, 16.4),
    ):
        scene.block("pilaster", (x - 0.15, x + 0.15), (y - 0.15, y + 0.15), (0.0, HEIGHT))
    for x, y in ((21.8, top), (9.4, top), (5.2, top), (HALF, 4.4), (HALF, 9.1)):
        scene.block("pilaster", (x - 0.12, x + 0.12), (y - 0.12, y + 0.12), (0.0, HEIGHT))
