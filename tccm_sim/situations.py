"""Situations A to D: a table or a shelf in front of a robot that stands at the origin.

All have a floor and a back wall 2.6 m ahead; the laser tilts from 5 to 65 degrees down.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np

from tccm_sim.rigid import rigid
from tccm_sim.scene import Motion, Scene

Vector = tuple[float, float, float]

SITUATIONS = ("a", "b", "c", "d")

# Chosen, unless noted otherwise; the paper names the situations but not their sizes.
TILT_LOW, TILT_HIGH = radians(5.0), radians(65.0)
CYCLE_TIME = 1.575  # s, of a tilt cycle
WALL_X = 2.6  # m
TABLE = (0.8, 1.2, 0.03)  # m: depth, width, thickness
TABLE_EDGE, TABLE_TOP = 0.5, 0.700  # m: x of the near edge, height, as in Table I of the paper
SHELF = (0.3, 0.9, 1.2)  # m: depth, width, height
SHELF_FRONT = 0.600  # m: x of the front, as in Table I of the paper
BOARD = 0.02  # m, thickness
SITUATION_YAW = radians(20.0)  # of C and D
ARM_PERIOD = 3.15  # s, of the arm that moves over the table of C


def situation_scene(
    name: str,
    yaw: float = 0.0,
    pitch: float = 0.0,
    translation: Vector = (0.0, 0.0, 0.0),
    room: bool = False,
) -> Scene:
    """Return the scene of a situation; the solids of its subject are named ``subject``.

    Parameters
    ----------
    name
        One of `SITUATIONS`.
    yaw, pitch, translation
        Pose of the subject relative to its default, rad and m.
    room
        Whether to add side walls, a rear wall and a ceiling.
    """
    if name not in SITUATIONS:
        raise ValueError(f"no situation '{name}'; there are {', '.join(SITUATIONS)}")
    scene = Scene()
    subject = Scene()
    if name in "ac":
        _table(subject, with_objects=name == "c")
        pivot = np.array([TABLE_EDGE + TABLE[0] / 2.0, 0.0, TABLE_TOP])
    else:
        _shelf(subject, is_open=name == "d")
        pivot = np.array([SHELF_FRONT, 0.0, SHELF[2] / 2.0])
    total_yaw = yaw + (SITUATION_YAW if name in "cd" else 0.0)
    rotation_y = -pitch if name in "ac" else pitch
    move = rigid(pivot + translation, (0.0, rotation_y, total_yaw)) @ rigid(-pivot)
    for solid in subject.solids:
        scene.solids.append(replace(solid, T_world_solid=move @ solid.T_world_solid))
    if name == "c":
        _arm(scene)
    scene.floor_and_ceiling((-4.0, 8.0), (-6.0, 6.0), 2.6 if room else None)
    scene.wall("wall", (WALL_X, -6.0), (WALL_X, 6.0), 2.6)
    if room:
        scene.wall("wall", (WALL_X, 2.5), (-4.0, 2.5), 2.6)
        scene.wall("wall", (-4.0, -2.5), (WALL_X, -2.5), 2.6)
        scene.wall("wall", (-2.0, 6.0), (-2.0, -6.0), 2.6)
    return scene


def _table(scene: Scene, with_objects: bool) -> None:
    """Add a table 1.2 m wide, in C with three boxes on it."""
    center = (TABLE_EDGE + TABLE[0] / 2.0, 0.0)
    scene.table("subject", (TABLE[0], TABLE[1]), TABLE_TOP, center, board=TABLE[2], surface="table")
    if not with_objects:
        return
    for x, y, size, box_yaw in (
        (0.75, 0.32, 0.08, 0.3),
        (1.05, 0.05, 0.14, -0.2),
        (0.9, -0.35, 0.20, 0.5),
    ):
        place = (x, y, TABLE_TOP + size / 2.0)
        scene.box("box", (size, size, size), place, (0.0, 0.0, box_yaw), role="object")


def _arm(scene: Scene) -> None:
    """Add two cylinders that swing over the table: a forearm and an upper arm."""
    keys = [(k * ARM_PERIOD / 2.0, 0.0, 0.25 * (-1.0) ** k, 0.0) for k in range(200)]
    motion = Motion.through(keys)
    pitch = radians(80.0)
    scene.cylinder("arm", 0.04, 0.40, (0.55, -0.1, 0.95), (0.0, pitch, 0.3), motion=motion)
    scene.cylinder("arm", 0.05, 0.35, (0.22, -0.2, 1.05), (0.0, radians(60.0), 0.3), motion=motion)


def _shelf(scene: Scene, is_open: bool) -> None:
    """Add a shelf of four drawers; in D the third is open, and the others have knobs."""
    depth, width, height = SHELF
    front = SHELF_FRONT
    if not is_open:
        body = (front + depth / 2.0, 0.0, height / 2.0)
        scene.box("subject", (depth, width, height), body, surface="shelf")
        return
    third = (height / 4.0, height / 2.0)  # counted from the top
    half = width / 2.0
    # One front face: the body around the open drawer is three coplanar boxes.
    across = (-half, half)
    scene.block("subject", (front, front + depth), across, (third[1], height), surface="shelf")
    scene.block("subject", (front, front + depth), across, (0.0, third[0]))
    scene.block("shelf", (front + depth - BOARD, front + depth), (-half, half), third)
    for side in (-1.0, 1.0):
        outer, inner = side * half, side * (half - BOARD)
        scene.block("shelf", (front, front + depth), (min(outer, inner), max(outer, inner)), third)
    _drawer(scene, front - 0.25, third)
    for z in (0.15, 0.75, 1.05):
        knob = (front - 0.015, 0.0, z)
        scene.cylinder("knob", 0.015, 0.03, knob, (0.0, np.pi / 2.0, 0.0))


def _drawer(scene: Scene, front: float, limits: tuple[float, float]) -> None:
    """Add a drawer with its front board at x = `front`, with two objects in it."""
    depth, half = SHELF[0] - BOARD, SHELF[1] / 2.0 - BOARD - 0.005
    low, high = limits[0] + 0.005, limits[1] - 0.005
    top = high - 0.06  # the sides are lower than the front
    scene.block("drawer", (front, front + BOARD), (-half, half), (low, high))
    bottom = (low, low + BOARD)
    scene.block("drawer", (front, front + depth), (-half, half), bottom, surface="drawer")
    for y in (-half, half - BOARD):
        scene.block("drawer", (front, front + depth), (y, y + BOARD), (low, top))
    scene.block("drawer", (front + depth - BOARD, front + depth), (-half, half), (low, top))
    floor = low + BOARD
    scene.box("box", (0.1, 0.12, 0.1), (front + 0.12, 0.15, floor + 0.05), role="object")
    scene.cylinder("can", 0.035, 0.12, (front + 0.1, -0.2, floor + 0.06), role="object")
