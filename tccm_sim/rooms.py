"""Rooms: for an upside-down laser, for calibration, with moving furniture, and for load tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi, radians

import numpy as np

from tccm_ros.arrays import Float64
from tccm_sim.flat import flat_scene, repeated, stop_and_scan
from tccm_sim.joints import oscillation
from tccm_sim.motion import Drive, Waypoint, drive
from tccm_sim.options import Options
from tccm_sim.robots import UPSIDE_DOWN
from tccm_sim.scene import Motion, Scene
from tccm_sim.world import World

CEILING = 2.6  # m, its height
RAMP = radians(4.0)  # slope of the ramp of `room`
ROOM_SPEED = 0.5  # m/s, of the robot in the calibration room
LOOK_UP, LOOK_DOWN = 0.25, -1.0  # rad; positive is up on this robot


def upside_down(options: Options) -> World:
    """Return a small room with a table, scanned continuously by a laser mounted upside down."""
    scene = Scene()
    scene.room((-1.5, 3.8), (-2.0, 2.2), CEILING)
    scene.table("table", (0.8, 1.4), 0.72, (2.0, 0.1), 0.15)
    scene.box("parcel", (0.2, 0.15, 0.12), (2.1, 0.35, 0.78), (0.0, 0.0, 0.5), role="object")
    scene.block("cabinet", (0.6, 1.6), (-2.0, -1.6), (0.0, 0.95), surface="cabinet")
    scene.block("pillar", (3.3, 3.6), (1.5, 1.8), (0.0, CEILING))
    route = [
        Waypoint(0.0, 0.0, 0.1, 4.0),
        Waypoint(0.9, 0.35, -0.1, 3.0),
        Waypoint(0.5, -0.6, -0.5, 3.0),
    ]
    path = drive(repeated(route, options.laps), options.base_tilt, speed=0.35)
    end = float(path.times[-1])
    limits = options.tilt_limits or (LOOK_UP, LOOK_DOWN)
    joints = {"nod_joint": oscillation([(0.2, end)], options.cycle_period or 2.0, limits)}
    return World("upside_down", scene, UPSIDE_DOWN, path, joints)


def room(options: Options) -> World:
    """Return a room with floor, ceiling and walls for calibration, with clutter and a ramp."""
    scene = Scene()
    scene.room((-3.0, 5.0), (-3.0, 3.0), CEILING)
    scene.table("table", (0.8, 1.2), 0.74, (2.6, 1.2), 0.2)
    _clutter(scene, options.clutter)
    if options.ramp:
        length = 2.0
        rise = length * np.sin(RAMP) / 2.0
        place = (3.9, -1.8, rise - 0.05 * np.cos(RAMP))
        scene.box("ramp", (length, 1.6, 0.1), place, (0.0, -RAMP, 0.0))
    limits = options.tilt_limits or (-0.9, 1.0)
    pause = 2.0 * (options.cycle_period or 4.0) + 0.4
    route = repeated(
        [
            Waypoint(0.0, 0.0, 0.0, pause),
            Waypoint(0.6, 0.5, 1.9, pause),
            Waypoint(-0.4, 0.3, -2.2, pause),
        ],
        options.laps,
    )
    if options.people:
        scene.person("person", _before(route, drive(route, options.base_tilt, ROOM_SPEED).stops))
    changed = options.model_copy(
        update={"tilt_limits": limits, "cycle_period": options.cycle_period or 4.0}
    )
    return stop_and_scan("room", scene, route, changed, ROOM_SPEED)


def _before(route: Sequence[Waypoint], stops: Float64) -> list[tuple[float, ...]]:
    """Return (time, x, y) of a person who walks past in front of the robot at each stop."""
    keys: list[tuple[float, ...]] = []
    for stop, (start, end) in zip(route, stops.tolist(), strict=True):
        heading = stop.heading or 0.0
        c, s = np.cos(heading), np.sin(heading)
        for time, side in ((start, -1.2), (end, 1.2)):
            keys.append((time, stop.x + 1.7 * c - side * s, stop.y + 1.7 * s + side * c))
    return keys


def _clutter(scene: Scene, count: int) -> None:
    """Add boxes of 0.1 to 0.5 m at positions distributed by the golden angle."""
    for i in range(count):
        radius, angle = 1.3 + 1.6 * ((i * 0.618034) % 1.0), 2.399963 * i
        size = 0.1 + 0.4 * ((i * 0.7548777) % 1.0)
        place = (1.0 + radius * np.cos(angle), 0.9 * radius * np.sin(angle), size / 2.0)
        scene.box("clutter", (size, 0.7 * size, size), place, (0.0, 0.0, 1.3 * i))


def moved(options: Options) -> World:
    """Return a room that is scanned twice, with changes of its furniture in between.

    The robot stops in front of the furniture, turns away, and stops there again. A person then
    hides the cupboard.
    """
    front, back = Waypoint(0.0, 0.0, 0.0, 5.4), Waypoint(-1.2, 0.1, pi, 5.4)
    route = [front, back, replace(front, x=0.1, y=-0.1)]
    path = drive(repeated(route, options.laps), options.base_tilt)
    scene = Scene()
    scene.room((-2.5, 4.5), (-2.8, 2.8), CEILING)
    change = float(path.stops[1].mean())
    shift = Motion.through([(change, 0, 0, 0), (change + 1.0, 0.6, 0.9, 0)])
    scene.table("moved table", (0.7, 1.0), 0.70, (1.8, -0.3), motion=shift)
    scene.table("stool", (0.45, 0.45), 0.48, (1.2, 1.6), span=(-np.inf, change))
    scene.block("cupboard", (2.2, 3.2), (-2.8, -2.3), (0.0, 0.85), surface="cupboard")
    crate = (2.0, -1.1, 0.2)
    scene.box("crate", (0.5, 0.4, 0.4), crate, surface="crate", span=(change, np.inf))
    if options.people:
        start = float(path.stops[2, 0])
        scene.person("person", [(start, 0.95, -0.9), (start + 5.4, 1.0, -0.95)])
    return stop_and_scan("moved", scene, repeated(route, options.laps), options)


def load(options: Options) -> World:
    """Return 20 s of the heaviest input: 1,081 beams at 40 Hz tilting, 361 at 12.5 Hz level."""
    corners = [(5.6, 1.3), (6.6, 1.3), (6.6, 4.2), (5.7, 4.2), (5.6, 1.4)]
    route = [Waypoint(5.6, 2.6, -pi / 2, 0.5), *(Waypoint(x, y) for x, y in corners)]
    changed = options.model_copy(
        update={"always": True, "cycle_period": options.cycle_period or 1.5}
    )
    world = stop_and_scan("load", flat_scene(), repeated(route, options.laps), changed)
    return replace(world, drive=_shortened(world.drive, 20.0 * options.laps))


def _shortened(path: Drive, duration: float) -> Drive:
    """Return the beginning of a drive."""
    count = int(np.searchsorted(path.times, duration)) + 1
    return replace(path, times=path.times[:count], states=path.states[:count])
