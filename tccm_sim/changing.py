"""Two rooms whose furniture is moved, carried away and lowered while the robot looks elsewhere."""

from __future__ import annotations

from math import pi

import numpy as np

from tccm_sim.flat import stop_and_scan
from tccm_sim.motion import Waypoint, drive
from tccm_sim.options import Options
from tccm_sim.rooms import CEILING
from tccm_sim.scene import Motion, Scene
from tccm_sim.world import World

WALL = -2.6  # m, x of the wall between the rooms
DOOR = 0.7  # m, half the width of the opening in it
PAUSE = 12.6  # s, of each stop: three tilt cycles
CYCLE = 4.0  # s
STEP = 0.01  # s, duration of a jump of furniture


def changing(options: Options) -> World:
    """Return two rooms that the robot visits in turn; the laser scans while it stands.

    Before the third stop a table with a cup is moved within its room, a stool is removed, a crate
    is added, and a desk is moved to the other room. Before the fifth, a side table is moved by 0.3
    m, and a bench is lowered by 4 cm. Another cup appears during the third stop; the first is
    removed before the fifth.
    """
    first, second = Waypoint(0.0, 0.0, 0.0, PAUSE), Waypoint(-5.0, 0.0, pi, PAUSE)
    route = [first, second, Waypoint(0.05, -0.1, 0.0, PAUSE), second, first]
    stops = drive(route, options.base_tilt).stops
    early, late = float(stops[1:3].mean()), float(stops[3:5].mean())
    scene = Scene()
    _rooms(scene)
    _room_with_tables(scene, early, late, float(stops[2].mean()))
    scene.block("counter", (-7.4, -6.8), (-2.6, -0.6), (0.0, 0.9), surface="counter")
    changed = options.model_copy(update={"cycle_period": options.cycle_period or CYCLE})
    return stop_and_scan("changing", scene, route, changed)


def _rooms(scene: Scene) -> None:
    scene.room((-7.4, 4.5), (-2.8, 2.8), CEILING)
    for low, high in ((-2.8, -DOOR), (DOOR, 2.8)):
        scene.wall("inner wall", (WALL, low), (WALL, high), CEILING, 0.1, two_sided=True)


def _room_with_tables(scene: Scene, early: float, late: float, third: float) -> None:
    """Add the furniture in front of the robot at its first stop; times in s."""
    scene.table("table", (0.7, 1.0), 0.70, (1.8, -0.3), motion=_jump(early, 0.5, 0.7, yaw=0.2))
    scene.table("stool", (0.45, 0.45), 0.48, (1.2, 1.2), span=(-np.inf, early))
    crate = (1.6, -1.1, 0.2)
    scene.box("crate", (0.5, 0.4, 0.4), crate, surface="crate", span=(early, np.inf))
    scene.table("desk", (1.2, 0.6), 0.75, (1.9, 2.2), motion=_jump(early, -8.1, -0.6))
    scene.table("side table", (0.6, 0.6), 0.55, (1.1, -2.0), motion=_jump(late, 0.0, 0.3))
    scene.table("bench", (0.6, 0.9), 0.62, (2.5, -1.9), motion=_jump(late, 0.0, 0.0, -0.04))
    for name, y, span in (
        ("cup that comes", 0.2, (third, np.inf)),
        ("cup that leaves", 0.6, (early, late)),
    ):
        scene.cylinder(name, 0.05, 0.14, (2.2, y, 0.77), role="object", span=span)


def _jump(time: float, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Motion:
    """Return a jump to another pose, m and rad, at a time at which it is out of sight."""
    return Motion.through([(time, 0.0, 0.0, 0.0, 0.0), (time + STEP, x, y, z, yaw)])
