"""Worlds in which the humanoid stands before a table or a shelf and sweeps its laser."""

from __future__ import annotations

from collections.abc import Callable
from math import radians

import numpy as np

from tccm_ros.pipeline.sim.joints import Profile, sweeps
from tccm_ros.pipeline.sim.motion import stand
from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.robots import HUMANOID
from tccm_ros.pipeline.sim.scene import Motion, Scene
from tccm_ros.pipeline.sim.situations import (
    SWEEP_TIME,
    TABLE_TOP,
    TILT_HIGH,
    TILT_LOW,
    TURN,
    situation_scene,
)
from tccm_ros.pipeline.sim.world import World

__all__ = ["shelf", "situation", "walkthrough"]

SWEEPS = 8  # of a recording, unless it says how long it is
NECK_SWEEP = radians(30.0)  # either way, as in the paper
START = 0.1  # s, of the first sweep


def situation(name: str) -> Callable[[Options], World]:
    """Return the builder of situation A, B, C or D (``a`` to ``d``)."""

    def build(options: Options) -> World:
        scene = situation_scene(name, options.yaw, options.pitch, options.translation, room=True)
        return _standing(f"situation_{name}", scene, options, SWEEPS)

    return build


def walkthrough(options: Options) -> World:
    """Return situation A with a person who walks past, things that come and go, and a stool.

    A box leaves the table, another appears on it, and a stool is carried away.
    """
    scene = situation_scene("a", options.yaw, options.pitch, options.translation, room=True)
    scene.box("box that stays", (0.12, 0.12, 0.12), (0.8, -0.4, TABLE_TOP + 0.06), role="object")
    for name, y, span in (
        ("box that leaves", 0.0, (-np.inf, 8.0)),
        ("box that comes", 0.35, (11.0, np.inf)),
    ):
        place = (1.0, y, TABLE_TOP + 0.08)
        scene.box(name, (0.16, 0.16, 0.16), place, (0.0, 0.0, 0.3), role="object", span=span)
    away = Motion.through([(13.0, 0, 0, 0), (13.5, 0, 0, 0.3), (16.0, 0.2, 2.5, 0.3)])
    gone = (-np.inf, 16.0)
    scene.table("stool", (0.4, 0.4), 0.45, (0.95, 1.1), motion=away, span=gone)
    if options.people:
        scene.person("person", [(3.0, 1.75, -2.3), (7.0, 1.75, 2.3)])
        scene.person("carrier", [(13.0, 1.45, 1.3), (16.0, 1.65, 3.8)])
    return _standing("walkthrough", scene, options, 13)


def _standing(name: str, scene: Scene, options: Options, count: int) -> World:
    """Return a world whose robot stands and sweeps between 5 and 65 degrees down."""
    period = options.sweep_period or SWEEP_TIME
    duration = options.duration or count * period + 2.0 * START
    limits = options.sweep_limits or (TILT_LOW, TILT_HIGH)
    joints = {"laser_tilt_joint": sweeps([(START, duration)], period, limits)}
    return World(name, scene, HUMANOID, stand(duration), joints)


def shelf(options: Options) -> World:
    """Return a shelf with its third drawer open, scanned while waist and neck move."""
    scene = situation_scene("d", options.yaw - TURN, options.pitch, options.translation, room=True)
    period = options.sweep_period or SWEEP_TIME
    duration = options.duration or SWEEPS * period + 2.0 * START
    window = [(START, duration)]
    joints = {
        "laser_tilt_joint": sweeps(window, period, (-NECK_SWEEP, NECK_SWEEP)),
        "waist_joint": sweeps(window, 2.3, (-0.2, 0.2), ramp=0.5),
        "neck_yaw_joint": sweeps(window, 3.1, (0.15, -0.15), ramp=0.5),
        "neck_pitch_joint": sweeps(window, 4.1, (0.5, 0.95), ramp=0.5),
        "neck_roll_joint": Profile.rest(0.03),
    }
    return World("shelf", scene, HUMANOID, stand(duration), joints)
