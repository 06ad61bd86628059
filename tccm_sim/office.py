"""An office: ten rooms on a corridor, with door signs, and posters and notices as distractors."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import pi
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_sim.door_plates import STYLES, door_plate, notice
from tccm_sim.flat import chair, stop_and_scan
from tccm_sim.heads import with_colour_camera
from tccm_sim.motion import Waypoint
from tccm_sim.options import Options
from tccm_sim.panels import Panel, on_wall
from tccm_sim.scene import Scene
from tccm_sim.sign_pictures import directory, paper, poster
from tccm_sim.world import Room, World

ROOMS_PER_SIDE = 5
WIDTH, DEPTH, HALF_CORRIDOR = 3.2, 3.6, 1.0  # m, of a room; half of the corridor
HEIGHT, THICKNESS = 2.5, 0.12  # m, of walls
DOOR_AT, DOOR_WIDTH = 1.0, 0.9  # m, middle of a door from its room's left, seen from outside; width
PLATE_HEIGHT, PLATE_WIDTH, PLATE_BESIDE = 1.5, 0.18, 0.25  # m; beside the door's edge
FIRST_NUMBER = 201
LENGTH = ROOMS_PER_SIDE * WIDTH
SPEED, GLANCE, SCAN = 0.6, 0.3, 5.4  # m/s; s, of a stop to look into a room, and of a scan
WORDS = ("Robotics", "Workshop", "J. Moreau", "Archive", "Meeting Room", "Vision", "A. Sato",
         "Electronics", "Students", "Printer")  # fmt: skip


class Door(NamedTuple):
    """A door between the corridor and a room.

    Attributes
    ----------
    number
        Number of the room.
    x
        Position of its middle, m.
    side
        1.0 on the left of the corridor (y > 0), -1.0 on the right.
    """

    number: str
    x: float
    side: float


def doors() -> list[Door]:
    """Return the doors along the corridor, alternately left and right."""
    found: list[Door] = []
    for k in range(ROOMS_PER_SIDE):
        for side in (1.0, -1.0):
            # Seen from the corridor, each room has its door at the same position.
            along = DOOR_AT if side > 0.0 else WIDTH - DOOR_AT
            number = str(FIRST_NUMBER + len(found))
            found.append(Door(number, k * WIDTH + along, side))
    return found


def office_scene(*, alike: bool = False) -> Scene:
    """Return the solids of the office.

    Parameters
    ----------
    alike
        Whether all rooms have the same furniture, so that only signs distinguish them.
    """
    scene = Scene()
    far = HALF_CORRIDOR + THICKNESS + DEPTH
    scene.floor_and_ceiling((-0.2, LENGTH + 0.2), (-far - 0.2, far + 0.2), HEIGHT)
    corners = [(0.0, far), (0.0, -far), (LENGTH, -far), (LENGTH, far), (0.0, far)]
    for start, end in pairwise(corners):
        scene.wall("outer wall", start, end, HEIGHT, THICKNESS)
    for side in (1.0, -1.0):
        own = sorted(door.x for door in doors() if door.side == side)
        edges = [0.0, *(x + s * DOOR_WIDTH / 2 for x in own for s in (-1.0, 1.0)), LENGTH]
        for low, high in zip(edges[::2], edges[1::2]):
            y = side * HALF_CORRIDOR
            start, end = ((high, y), (low, y)) if side > 0.0 else ((low, y), (high, y))
            scene.wall("corridor wall", start, end, HEIGHT, THICKNESS, two_sided=True)
        for k in range(1, ROOMS_PER_SIDE):
            x, near = k * WIDTH - THICKNESS / 2, side * (HALF_CORRIDOR + THICKNESS)
            low, high = sorted((near, side * far))
            scene.wall("inner wall", (x, low), (x, high), HEIGHT, THICKNESS, two_sided=True)
    for n, door in enumerate(doors()):
        _furnish(scene, door, 0 if alike else n)
    return scene


def _furnish(scene: Scene, door: Door, kind: int) -> None:
    """Add a desk with a chair and a cupboard to the room of a door; kinds differ in size."""

    def place(right: float, ahead: float) -> tuple[float, float]:
        """Return a position to the right of the door and ahead, as seen when entering, m."""
        return door.x + door.side * right, door.side * (HALF_CORRIDOR + THICKNESS + ahead)

    yaw = 0.0 if door.side > 0.0 else pi
    size = (1.4 + 0.1 * (kind % 3), 0.7 + 0.05 * (kind % 2))
    desk = place(1.2, DEPTH - 0.45)
    scene.table(f"desk of {door.number}", size, 0.72 + 0.01 * (kind % 4), desk, yaw)
    chair(
        scene, f"chair of {door.number}", place(1.2 - 0.1 * (kind % 3), DEPTH - 1.2), yaw + pi / 2
    )
    x, y = place(-0.65, DEPTH - 0.6 - 0.2 * (kind % 4))
    scene.block("cupboard", (x - 0.2, x + 0.2), (y - 0.4, y + 0.4), (0.0, 1.9))


def office_panels(style: int = 0) -> tuple[Panel, ...]:
    """Return the door signs of the office, and other panels on the walls of its corridor.

    Parameters
    ----------
    style
        Style of the plates, an index of `STYLES`.
    """
    panels = []
    for door, words in zip(doors(), WORDS):
        plate = door_plate(door.number, words, STYLES[style])
        # To the right of the door, seen from outside.
        x = door.x + door.side * (DOOR_WIDTH / 2 + PLATE_BESIDE)
        T = on_wall((x, door.side * HALF_CORRIDOR), PLATE_HEIGHT, (0.0, -door.side))
        anchor = plate.anchor[0] * PLATE_WIDTH, plate.anchor[1] * PLATE_WIDTH
        panels.append(Panel(plate.pixels, T, PLATE_WIDTH, door.number, anchor))
    return (*panels, *_traps())


def _traps() -> list[Panel]:
    """Return posters, notices and lists, some with numbers, that are not door signs."""
    random = np.random.default_rng(9)
    white, red, green = (246, 246, 242), (176, 30, 34), (18, 120, 70)
    boards = [
        (np.asarray(poster(random)), 0.6, 2.3, 1.0, 1.45),
        (notice("EXIT", green, white), 0.36, 2.9, -1.0, 2.05),
        (np.asarray(directory(random)), 0.45, 6.5, -1.0, 1.5),
        (np.asarray(paper(random)), 0.22, 5.7, 1.0, 1.45),
        (notice("FIRE", red, white), 0.25, 8.9, 1.0, 1.7),
        (np.asarray(poster(random)), 0.5, 10.0, -1.0, 1.5),
        (notice("24.12.2025", white, (30, 30, 30)), 0.3, 12.2, 1.0, 1.4),
        (np.asarray(poster(random)), 0.7, 15.3, 1.0, 1.5),
        (notice("201-210", white, (40, 60, 120)), 0.3, 13.5, -1.0, 1.7),
    ]
    return [
        Panel(pixels.copy(), on_wall((x, side * HALF_CORRIDOR), z, (0.0, -side)), width)
        for pixels, width, x, side, z in boards
    ]


def office_rooms() -> tuple[Room, ...]:
    """Return the rooms behind the doors, and the corridor."""
    rooms = []
    for door in doors():
        k = int(door.x // WIDTH)
        low = k * WIDTH + (THICKNESS / 2 if k else 0.0)
        high = (k + 1) * WIDTH - (THICKNESS / 2 if k + 1 < ROOMS_PER_SIDE else 0.0)
        near = door.side * (HALF_CORRIDOR + THICKNESS)
        ys = sorted((near, near + door.side * DEPTH))
        rooms.append(Room(door.number, _rectangle((low, high), (ys[0], ys[1]))))
    corridor = _rectangle((0.0, LENGTH), (-HALF_CORRIDOR, HALF_CORRIDOR))
    return (*rooms, Room("corridor", corridor))


def _rectangle(x: tuple[float, float], y: tuple[float, float]) -> Float64:
    return np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])


def _route(laps: int, visited: int) -> list[Waypoint]:
    """Return the route along the corridor and back, through some rooms, with two scans."""
    start, end = Waypoint(0.6, 0.0, 0.0, 0.5), Waypoint(LENGTH - 0.6, 0.0)
    route = [start]
    for lap in range(laps):
        ahead: list[Waypoint] = []
        for number, door in enumerate(doors()):
            if door.side > 0.0 and lap == 0 and number < 2 * visited:
                pause = SCAN if number in (0, 4) else GLANCE
                inside = door.side * (HALF_CORRIDOR + (1.5 if pause == SCAN else 0.7))
                facing = door.side * (pi / 2 - 0.5)
                ahead += [
                    Waypoint(door.x, 0.0),
                    Waypoint(door.x, inside, facing, pause),
                    Waypoint(door.x, 0.0),
                ]
        route += [*ahead, end, Waypoint(0.6, 0.0)]
    return route


def office_signs(options: Options) -> World:
    """Return the office with a robot that has a level laser, a tilting laser and a camera.

    The camera looks to the left, so on the way back it sees the other side of the corridor. With
    `alike` all rooms have the same furniture.
    """
    scene = office_scene(alike=options.alike)
    route = _route(options.laps, visited=0 if options.alike else ROOMS_PER_SIDE)
    world = stop_and_scan("office_signs", scene, route, options, SPEED)
    rig = with_colour_camera(world.rig)
    return replace(world, rig=rig, panels=office_panels(), rooms=office_rooms())
