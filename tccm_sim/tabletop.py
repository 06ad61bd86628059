"""Worlds in which the humanoid stands before a table or a shelf and tilts its laser."""

from __future__ import annotations

from collections.abc import Callable
from math import radians

import numpy as np

from tccm_sim.heads import look_around, robot
from tccm_sim.joints import Profile, oscillation
from tccm_sim.motion import stand
from tccm_sim.options import Options
from tccm_sim.rigs import Rig
from tccm_sim.robots import HUMANOID, HUMANOID_WITH_ARM, SEGWAY_WITH_GRIPPER
from tccm_sim.scene import Motion, Scene
from tccm_sim.situations import (
    CYCLE_TIME,
    SITUATION_YAW,
    TABLE_TOP,
    TILT_HIGH,
    TILT_LOW,
    situation_scene,
)
from tccm_sim.world import World

CYCLES = 8  # tilt cycles of a recording without a given duration
NECK_TILT = radians(30.0)  # in both directions, as in the TCCM paper
LOOK_TIME = 5.0  # s, of one look around by a head
START = 0.1  # s, of the first tilt cycle

ARM_MOTION = {
    "arm_1_joint": (2.9, 0.15, 0.40),
    "arm_2_joint": (2.1, -0.10, 0.45),
    "arm_3_joint": (3.7, -0.30, 0.30),
    "arm_4_joint": (1.9, 0.10, 0.40),
    "arm_5_joint": (2.7, -0.60, 0.60),
    "arm_6_joint": (1.7, -0.20, 0.20),
    "arm_7_joint": (2.3, -1.00, 1.00),
}
"""Duration of a move (s) and both ends (rad) by joint; the arm moves over the table. Chosen."""

GRIPPER_MOTION = (2.6, 0.25, 0.50)
"""The same for the gripper, m; it moves up and down over the table's edge. Chosen."""


def situation(name: str) -> Callable[[Options], World]:
    """Return the builder of situation A, B, C or D (``a`` to ``d``)."""

    def build(options: Options) -> World:
        return _stationary(f"situation_{name}", _scene(name, options), options, CYCLES)

    return build


def _scene(name: str, options: Options, yaw: float = 0.0) -> Scene:
    """Return the scene of a situation in a room, its subject turned by a further yaw."""
    return situation_scene(name, options.yaw + yaw, options.pitch, options.translation, room=True)


def walkthrough(options: Options) -> World:
    """Return situation A with a person walking past, objects that come and go, and a stool.

    A box leaves the table, another appears on it, and a stool is carried away.
    """
    scene = _scene("a", options)
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
    return _stationary("walkthrough", scene, options, 13)


def _stationary(name: str, scene: Scene, options: Options, count: int) -> World:
    """Return a world whose robot stands still and tilts its laser between 5 and 65 degrees down.

    A robot with a head looks around instead.
    """
    duration = _duration(options, count)
    if options.robot is not None:
        rig = robot(options.robot)
        window = np.array([[START, duration]])
        joints = look_around(rig, window, options.cycle_period or LOOK_TIME, options.tilt_limits)
        return World(name, scene, rig, stand(duration), joints)
    return _nodding(name, scene, HUMANOID, options, duration, {})


def _duration(options: Options, count: int) -> float:
    """Return the time of a number of tilt cycles, unless the options have another, s."""
    return options.duration or count * (options.cycle_period or CYCLE_TIME) + 2.0 * START


def _nodding(
    name: str,
    scene: Scene,
    rig: Rig,
    options: Options,
    duration: float,
    moves: dict[str, tuple[float, float, float]],
) -> World:
    """Return a world whose robot stands still, tilts its laser and oscillates other joints."""
    limits = options.tilt_limits or (TILT_LOW, TILT_HIGH)
    window, period = [(START, duration)], options.cycle_period or CYCLE_TIME
    joints = {rig.tilt_joint: oscillation(window, period, limits)}
    for joint, (time, *ends) in moves.items():
        joints[joint] = oscillation(window, time, (ends[0], ends[1]), ramp=0.5)
    return World(name, scene, rig, stand(duration), joints)


def arm(options: Options) -> World:
    """Return situation A with a robot that moves an arm of seven joints over the table."""
    duration = options.duration or CYCLES * CYCLE_TIME + 2.0 * START
    return _nodding("arm", _scene("a", options), HUMANOID_WITH_ARM, options, duration, ARM_MOTION)


def gripper(options: Options) -> World:
    """Return situation A with a robot that moves its gripper up and down in front of its laser."""
    duration = options.duration or CYCLES * CYCLE_TIME + 2.0 * START
    moves = {"gripper_lift_joint": GRIPPER_MOTION}
    scene = _scene("a", options)
    return _nodding("gripper", scene, SEGWAY_WITH_GRIPPER, options, duration, moves)


def shelf(options: Options) -> World:
    """Return a shelf with its third drawer open, scanned while waist and neck move."""
    scene, period = _scene("d", options, -SITUATION_YAW), options.cycle_period or CYCLE_TIME
    duration = _duration(options, CYCLES)
    window = [(START, duration)]
    joints = {
        "laser_tilt_joint": oscillation(window, period, (-NECK_TILT, NECK_TILT)),
        "waist_joint": oscillation(window, 2.3, (-0.2, 0.2), ramp=0.5),
        "neck_yaw_joint": oscillation(window, 3.1, (0.15, -0.15), ramp=0.5),
        "neck_pitch_joint": oscillation(window, 4.1, (0.5, 0.95), ramp=0.5),
        "neck_roll_joint": Profile.rest(0.03),
    }
    return World("shelf", scene, HUMANOID, stand(duration), joints)
