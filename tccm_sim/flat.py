"""A flat: a kitchen and a living room with furniture, and a drive of the Segway robot."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import numpy as np

from tccm_ros.arrays import Float64
from tccm_sim.heads import look_around, robot
from tccm_sim.joints import Profile, oscillation
from tccm_sim.motion import Waypoint, drive
from tccm_sim.options import Options
from tccm_sim.robots import SEGWAY
from tccm_sim.scene import Scene
from tccm_sim.world import World

Span = tuple[float, float]

WALL_HEIGHT = 2.5
WALL_THICKNESS = 0.12
TILT_LIMITS = (-0.45, 1.0)  # rad, positive is down
CYCLE_TIME = 5.0  # s, of a tilt cycle
PAUSE = 5.4  # s, of a stop
DOOR = (2.35, 3.35)  # y of the doorway between the rooms
MIDDLE = 4.5  # x of the wall between the rooms

PANS = (0.0, 0.0, -0.35, 0.0, -0.3)  # rad, of the pan joint at the first stops; then 0
PAN_TIME = 1.0  # s

ROUTE = (
    Waypoint(2.6, 1.7, pi, PAUSE),
    Waypoint(1.5, 2.6, -2.3, PAUSE),
    Waypoint(3.3, 3.2, 2.2, PAUSE),
    Waypoint(4.1, 2.85),
    Waypoint(5.6, 2.9, 0.2, PAUSE),
    Waypoint(6.4, 1.7, -1.2, PAUSE),
    Waypoint(6.4, 4.0, 1.0, PAUSE),
    Waypoint(5.75, 4.3, 2.75, PAUSE),
    Waypoint(5.5, 2.9),
    Waypoint(4.0, 2.85),
    Waypoint(3.0, 1.9, -2.9, PAUSE),
)

KITCHEN_ROUTE = (
    Waypoint(2.6, 1.9, pi, PAUSE),
    Waypoint(1.7, 2.5, -2.2, PAUSE),
    Waypoint(1.6, 3.0, 1.2, PAUSE),
    Waypoint(2.9, 3.2, 2.3, PAUSE),
    Waypoint(3.2, 4.2, 1.4, PAUSE),
    Waypoint(2.4, 2.0, -2.0, PAUSE),
)


def flat(options: Options) -> World:
    """Return the flat; `laps` is the number of times the route is driven."""
    route = repeated(ROUTE, options.laps)
    scene = flat_scene()
    if options.people:
        # Passes the sideboard during the first scan of the living room.
        scene.person("person", [(42.0, 5.2, 1.0), (47.5, 7.7, 1.1)])
    return stop_and_scan("flat", scene, route, options, pans=PANS)


def stop_and_scan(
    name: str,
    scene: Scene,
    route: Sequence[Waypoint],
    options: Options,
    speed: float = 0.5,
    pans: Sequence[float] = (),
) -> World:
    """Return a world in which the Segway scans one or more tilt cycles at each stop.

    A robot with a head looks around instead, with one nod and two pans per tilt cycle.

    Parameters
    ----------
    name
        Name of the world.
    scene
        Its solids.
    route
        Waypoints; the robot scans at those with a pause.
    options
        Variations of the world.
    speed
        Maximum speed, m/s.
    pans
        Positions of the pan joint at the first stops, rad; 0 at the others.
    """
    path = drive(route, options.base_tilt, speed)
    period = options.cycle_period or CYCLE_TIME
    if options.always:
        windows = np.array([[0.05, path.times[-1] - 0.05]])
    else:
        windows = path.stops[path.stops[:, 1] - path.stops[:, 0] >= period + 0.1]
    if options.robot is not None:
        rig = robot(options.robot)
        joints = look_around(rig, windows, period, options.tilt_limits)
        return World(name, scene, rig, path, joints, windows)
    limits = options.tilt_limits or TILT_LIMITS
    tilt = oscillation(windows + np.array([0.05, 0.0]), period, limits)
    joints = {"ptu_tilt_joint": tilt, "ptu_pan_joint": _pan(path.stops[:, 0], pans)}
    return World(name, scene, SEGWAY, path, joints, windows)


def repeated(route: Sequence[Waypoint], laps: int) -> list[Waypoint]:
    """Return a route repeated for a number of laps."""
    return [*route, *(list(route[1:]) * (laps - 1))]


def _pan(starts: Float64, pans: Sequence[float]) -> Profile:
    """Return the moves of the pan joint, which end before each stop."""
    moves, here = [], 0.0
    for number, start in enumerate(starts):
        there = pans[number] if number < len(pans) else 0.0
        if there != here:
            end = start - 0.1
            moves.append((end - PAN_TIME, end, here, there))
        here = there
    return Profile(np.array(moves), 0.5) if moves else Profile.rest(here)


def rgbd_kitchen(options: Options) -> World:
    """Return the kitchen of the flat, with a robot that has a depth camera on its head."""
    scene = Scene()
    scene.room((0.0, MIDDLE), (0.0, 6.0), WALL_HEIGHT, "wall", WALL_THICKNESS)
    _kitchen(scene)
    changed = options.model_copy(update={"robot": options.robot or "fetch"})
    route = repeated(KITCHEN_ROUTE, options.laps)
    return stop_and_scan("rgbd_kitchen", scene, route, changed)


def flat_scene() -> Scene:
    """Return the solids of the flat: 9 m x 6 m, kitchen on the left, living room on the right."""
    scene = Scene()
    scene.room((0.0, 9.0), (0.0, 6.0), WALL_HEIGHT, "outer wall", WALL_THICKNESS)
    for low, high in ((0.0, DOOR[0]), (DOOR[1], 6.0)):
        scene.wall(
            "inner wall", (MIDDLE, low), (MIDDLE, high), WALL_HEIGHT, WALL_THICKNESS, two_sided=True
        )
    _kitchen(scene)
    _living_room(scene)
    return scene


def _kitchen(scene: Scene) -> None:
    counter, top = "counter", 0.90
    for x, y in (((0.0, 2.4), (0.0, 0.6)), ((0.0, 0.6), (0.6, 2.1))):
        scene.block(counter, x, y, (0.0, top), surface=counter)
    scene.block("stove", (1.3, 1.9), (0.05, 0.55), (top, top + 0.05), surface="stove")
    scene.cylinder("kettle", 0.08, 0.22, (0.35, 0.30, top + 0.11), role="object")
    scene.box("toaster", (0.28, 0.16, 0.19), (0.30, 1.30, top + 0.095), (0, 0, 1.4), role="object")
    scene.cylinder("pot", 0.10, 0.14, (1.45, 0.30, top + 0.12), role="object")
    scene.block("fridge", (0.0, 0.62), (5.3, 5.95), (0.0, 1.75))

    scene.table("kitchen table", (1.4, 0.8), 0.74, (2.0, 4.45), 0.12)
    for center, size in (((1.7, 4.4), 0.10), ((2.4, 4.6), 0.09)):
        scene.cylinder("bowl", size, 0.07, (*center, 0.74 + 0.035), role="object")
    scene.box("cereals", (0.19, 0.07, 0.29), (2.05, 4.35, 0.74 + 0.145), (0, 0, 0.8), role="object")
    chair(scene, "chair at the table", (1.75, 3.62), pi / 2 + 0.2)
    chair(scene, "chair at the wall", (3.85, 4.6), pi + 0.1)
    shelves(scene, "kitchen shelf", (3.0, 4.0), (5.62, 6.0), (0.38, 0.76, 1.14), (1, 0))
    scene.block("crate", (0.08, 0.48), (2.7, 3.05), (0.0, 0.32), surface="crate")


def _living_room(scene: Scene) -> None:
    _sofa(scene)
    scene.table("coffee table", (0.55, 1.0), 0.42, (7.4, 3.0), 0.1)
    scene.cylinder("mug", 0.04, 0.10, (7.35, 3.2, 0.42 + 0.05), role="object")
    sideboard, top = "sideboard", 0.80
    scene.block(sideboard, (5.9, 7.5), (0.0, 0.45), (0.0, top), surface=sideboard)
    _full_of_objects(scene, (5.95, 7.45), (0.05, 0.40), top)
    scene.block("ledge", (8.0, 8.8), (0.0, 0.2), (0.99, 1.05), surface="ledge")
    scene.table("desk", (1.5, 0.7), 0.73, (7.3, 5.65))
    scene.box("screen", (0.50, 0.05, 0.34), (7.35, 5.85, 0.73 + 0.19), role="object")
    scene.box("keyboard", (0.42, 0.14, 0.02), (7.30, 5.50, 0.73 + 0.01), role="object")
    chair(scene, "desk chair", (6.75, 4.95), -pi / 2 + 0.5)
    wall = MIDDLE + WALL_THICKNESS
    shelves(scene, "book shelf", (wall, wall + 0.34), (4.6, 5.5), (0.42, 0.82, 1.20), (0, 1))
    scene.table("side table", (0.45, 0.45), 0.52, (8.6, 4.55), 0.05)
    scene.cylinder("lamp", 0.07, 0.28, (8.65, 4.6, 0.52 + 0.14), role="object")


def _sofa(scene: Scene) -> None:
    """Add a sofa against the east wall; its arm rests do not count as surfaces."""
    low, high = 2.1, 3.9
    scene.block("sofa seat", (8.05, 8.75), (low, high), (0.05, 0.44), surface="sofa seat")
    scene.block(
        "sofa back", (8.75, 8.97), (low - 0.12, high + 0.12), (0.0, 0.84), surface="sofa back"
    )
    for y in ((low - 0.12, low), (high, high + 0.12)):
        scene.block("sofa arm", (8.05, 8.75), y, (0.0, 0.60))


def _full_of_objects(scene: Scene, x: Span, y: Span, top: float) -> None:
    """Add a dozen objects that hide much of a sideboard."""
    sizes = ((0.10, 0.16), (0.14, 0.10), (0.08, 0.24), (0.12, 0.12), (0.16, 0.08), (0.09, 0.20))
    for i in range(12):
        size, height = sizes[i % 6]
        along = x[0] + (x[1] - x[0]) * (i + 0.5) / 12.0
        across = y[0] + (y[1] - y[0]) * (0.3 if i % 2 else 0.68)
        place = (along, across, top + height / 2.0)
        if i % 3:
            scene.box("thing", (size, size, height), place, (0.0, 0.0, 0.4 * i), role="object")
        else:
            scene.cylinder("thing", size / 2.0, height, place, role="object")


def chair(scene: Scene, name: str, center: tuple[float, float], yaw: float) -> None:
    """Add a chair: a seat at 0.46 m, four legs, a back.

    Parameters
    ----------
    scene
        Scene to extend.
    name
        Name of its solids and its surface.
    center
        x, y of the seat, m.
    yaw
        Viewing direction of a person on it, rad.
    """
    scene.table(name, (0.44, 0.44), 0.46, center, yaw, board=0.04)
    x, y = center[0] - 0.21 * np.cos(yaw), center[1] - 0.21 * np.sin(yaw)
    scene.box(name, (0.03, 0.42, 0.45), (x, y, 0.46 + 0.225), (0.0, 0.0, yaw))


def shelves(
    scene: Scene, name: str, x: Span, y: Span, heights: Sequence[float], sides: tuple[int, int]
) -> None:
    """Add a set of shelves: a board per height between two sides.

    Parameters
    ----------
    scene
        Scene to extend.
    name
        Name of its solids; its surfaces are ``<name> 1`` and so on.
    x, y
        Limits of the boards, m.
    heights
        Tops of the boards, ascending, m.
    sides
        (1, 0) for sides at the ends of x, (0, 1) for sides at the ends of y.
    """
    board = 0.02
    for number, height in enumerate(heights, 1):
        scene.block(name, x, y, (height - board, height), surface=f"{name} {number}")
    limits = (0.0, heights[-1])
    if sides[0]:
        for at in (x[0] - board, x[1]):
            scene.block(name, (at, at + board), y, limits)
    else:
        for at in (y[0] - board, y[1]):
            scene.block(name, x, (at, at + board), limits)
