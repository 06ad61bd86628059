"""Situations A to D: one sweep of a laser over a table or a shelf, without a bag.

The robot stands at the origin; its laser is 1.52 m above the floor, sees 240 degrees with 569 beams
and sweeps from 5 to 65 degrees down in 40 scans. Floor and back wall (2.6 m ahead) are in all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import radians

import numpy as np
from numpy.typing import NDArray

from tccm_ros.pipeline.sim.raycast import FACES, TOP_FACE
from tccm_ros.pipeline.sim.rigid import rigid
from tccm_ros.pipeline.sim.scene import FrozenScene, Motion, Scene, Solid

__all__ = ["FLOOR", "OTHER", "SITUATIONS", "SUBJECT", "WALL", "Cycle", "cycle", "situation_scene"]

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

SITUATIONS = ("a", "b", "c", "d")

FLOOR, WALL, SUBJECT, OTHER = 0, 1, 2, 3
"""Labels: `SUBJECT` is the table's top or the shelf's front, `OTHER` all that is not named."""

LASER_HEIGHT = 1.52
BEAMS, SCANS = 569, 40
FIELD = radians(240.0)
TILT_LOW, TILT_HIGH = radians(5.0), radians(65.0)
SWEEP_TIME = 1.575  # s
SCAN_TIME = 0.028 * 240.0 / 360.0  # s, first to last beam: a turn takes 28 ms
WALL_X = 2.6
TABLE = (0.8, 1.2, 0.03)  # depth, width, thickness
TABLE_EDGE, TABLE_TOP = 0.5, 0.700
SHELF = (0.3, 0.9, 1.2)
SHELF_FRONT = 0.600
BOARD = 0.02
TURN = radians(20.0)  # of C and D
ARM_PERIOD = 3.15  # s, of the arm that moves over the table of C


@dataclass(frozen=True)
class Cycle:
    """One sweep.

    Attributes
    ----------
    ranges
        float64 (S, B), m, +inf where nothing was hit.
    bearings
        float64 (B,), rad.
    tilts
        float64 (S, B): tilt (down is positive) when each beam was measured, rad.
    times
        float64 (S, B), s.
    points
        float64 (N, 3), of the beams that hit something, in scan and beam order, in base, m.
    labels
        int64 (N,): `FLOOR`, `WALL`, `SUBJECT` or `OTHER`; what each beam hit.
    normal, offset
        The subject's true plane, ``normal . p = offset``: up for a table, towards the robot for a
        shelf.
    laser_height
        Of the optical centre on the tilt axis, m.
    """

    ranges: Array
    bearings: Array
    tilts: Array
    times: Array
    points: Array
    labels: NDArray[np.int64]
    normal: Array
    offset: float
    laser_height: float = LASER_HEIGHT


def cycle(
    name: str,
    sigma: float = 0.0025,
    seed: int = 0,
    *,
    yaw: float = 0.0,
    pitch: float = 0.0,
    translation: Vector = (0.0, 0.0, 0.0),
    start: float = 0.0,
    downwards: bool = True,
    room: bool = False,
    scans: int = SCANS,
    beams: int = BEAMS,
    tilt_limits: tuple[float, float] = (TILT_LOW, TILT_HIGH),
    quantum: float = 0.0,
) -> Cycle:
    """Return one sweep over a situation.

    Parameters
    ----------
    name
        One of `SITUATIONS`.
    sigma, quantum
        Standard deviation and step of the ranges, m.
    seed
        Of the noise.
    yaw, pitch, translation
        Turn, tilt and shift of the subject about its own centre, rad and m: a tilted table turns
        its top towards the robot, a tilted shelf its front upwards.
    start
        Time of the first beam, s; the arm of C is where it is at that time.
    downwards
        Whether the sweep goes from its first to its second limit.
    room
        Whether side walls, a rear wall and a ceiling close the scene, so that all beams return.
    scans, beams, tilt_limits
        Of the sweep; tilts in rad.

    Returns
    -------
    Cycle
    """
    scene = situation_scene(name, yaw, pitch, translation, room)
    frozen, labels_of = _frozen(name, yaw, pitch, translation, room)
    first = start + SWEEP_TIME / scans * np.arange(scans)
    times = first[:, None] + SCAN_TIME / (beams - 1) * np.arange(beams)
    low, high = tilt_limits if downwards else tilt_limits[::-1]
    tilts = low + (high - low) * (times - start) / SWEEP_TIME
    bearings = np.linspace(-FIELD / 2.0, FIELD / 2.0, beams)
    directions = _directions(bearings, tilts).reshape(-1, 3)
    origins = np.broadcast_to(np.array([0.0, 0.0, LASER_HEIGHT]), directions.shape)
    exact, codes = frozen.cast(origins, directions, times.reshape(-1), 30.0)
    ranges = exact + sigma * np.random.default_rng(seed).standard_normal(len(exact))
    if quantum > 0.0:
        ranges = np.round(ranges / quantum) * quantum
    hit = codes >= 0
    normal, offset = _plane(next(s for s in scene.solids if s.name == "subject"), name in "ac")
    return Cycle(
        ranges.reshape(times.shape),
        bearings,
        tilts,
        times,
        origins[hit] + ranges[hit, None] * directions[hit],
        labels_of[codes[hit]],
        normal,
        offset,
    )


def situation_scene(
    name: str,
    yaw: float = 0.0,
    pitch: float = 0.0,
    translation: Vector = (0.0, 0.0, 0.0),
    room: bool = False,
) -> Scene:
    """Return what stands in a situation; the solids of its subject are named ``subject``."""
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
    turn = yaw + (TURN if name in "cd" else 0.0)
    lean = -pitch if name in "ac" else pitch
    move = rigid(pivot + translation, (0.0, lean, turn)) @ rigid(-pivot)
    for solid in subject.solids:
        scene.solids.append(_placed(solid, move))
    if name == "c":
        _arm(scene)
    scene.floor_and_ceiling((-4.0, 8.0), (-6.0, 6.0), 2.6 if room else None)
    scene.wall("wall", (WALL_X, -6.0), (WALL_X, 6.0), 2.6)
    if room:
        scene.wall("wall", (WALL_X, 2.5), (-4.0, 2.5), 2.6)
        scene.wall("wall", (-4.0, -2.5), (WALL_X, -2.5), 2.6)
        scene.wall("wall", (-2.0, 6.0), (-2.0, -6.0), 2.6)
    return scene


@lru_cache(maxsize=64)
def _frozen(
    name: str, yaw: float, pitch: float, translation: Vector, room: bool
) -> tuple[FrozenScene, NDArray[np.int64]]:
    """Return the scene for rays, and the label of each code."""
    scene = situation_scene(name, yaw, pitch, translation, room)
    labels = np.full(len(scene.solids) * FACES, OTHER)
    for i, solid in enumerate(scene.solids):
        rows = slice(i * FACES, (i + 1) * FACES)
        if solid.role in ("floor", "wall"):
            labels[rows] = FLOOR if solid.role == "floor" else WALL
        elif solid.name == "subject":
            labels[i * FACES + (TOP_FACE if name in "ac" else 0)] = SUBJECT
    return scene.freeze(), labels


def _directions(bearings: Array, tilts: Array) -> Array:
    """Return unit directions in base, float64 (S, B, 3): tilting turns x downwards."""
    x, y = np.cos(bearings), np.sin(bearings)
    return np.stack([x * np.cos(tilts), np.broadcast_to(y, tilts.shape), -x * np.sin(tilts)], -1)


def _plane(solid: Solid, is_table: bool) -> tuple[Array, float]:
    """Return the plane of a subject: the top of its box, or its face towards the robot."""
    axis, side = (2, 1.0) if is_table else (0, -1.0)
    normal = side * solid.T_world_solid[:3, axis]
    return normal, float(normal @ solid.T_world_solid[:3, 3] + solid.half[axis])


def _placed(solid: Solid, move: Array) -> Solid:
    """Return a solid moved by T_world_subject."""
    place = move @ solid.T_world_solid
    return Solid(
        solid.shape, place, solid.half, solid.name, solid.surface, solid.role, solid.motion
    )


def _table(scene: Scene, with_objects: bool) -> None:
    """A table, 1.2 m wide; in C with three boxes on it."""
    center = (TABLE_EDGE + TABLE[0] / 2.0, 0.0)
    scene.table("subject", (TABLE[0], TABLE[1]), TABLE_TOP, center, board=TABLE[2], surface="table")
    if not with_objects:
        return
    for x, y, size, turn in (
        (0.75, 0.32, 0.08, 0.3),
        (1.05, 0.05, 0.14, -0.2),
        (0.9, -0.35, 0.20, 0.5),
    ):
        place = (x, y, TABLE_TOP + size / 2.0)
        scene.box("box", (size, size, size), place, (0.0, 0.0, turn), role="object")


def _arm(scene: Scene) -> None:
    """Two cylinders that swing over the table: a forearm and an upper arm."""
    keys = [(k * ARM_PERIOD / 2.0, 0.0, 0.25 * (-1.0) ** k, 0.0) for k in range(200)]
    motion = Motion.through(keys)
    lean = radians(80.0)
    scene.cylinder("arm", 0.04, 0.40, (0.55, -0.1, 0.95), (0.0, lean, 0.3), motion=motion)
    scene.cylinder("arm", 0.05, 0.35, (0.22, -0.2, 1.05), (0.0, radians(60.0), 0.3), motion=motion)


def _shelf(scene: Scene, is_open: bool) -> None:
    """A shelf of four drawers; in D the third is open, and the others have knobs."""
    depth, width, height = SHELF
    front = SHELF_FRONT
    if not is_open:
        body = (front + depth / 2.0, 0.0, height / 2.0)
        scene.box("subject", (depth, width, height), body, surface="shelf")
        return
    third = (height / 4.0, height / 2.0)  # counted from above
    half = width / 2.0
    # One front face: the body around the drawer's opening is three boxes of one plane.
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
    """A drawer, pulled out so that its front board starts at x = `front`, with two things in it."""
    depth, half = SHELF[0] - BOARD, SHELF[1] / 2.0 - BOARD - 0.005
    low, high = limits[0] + 0.005, limits[1] - 0.005
    top = high - 0.06  # sides are lower than the front
    scene.block("drawer", (front, front + BOARD), (-half, half), (low, high))
    bottom = (low, low + BOARD)
    scene.block("drawer", (front, front + depth), (-half, half), bottom, surface="drawer")
    for y in (-half, half - BOARD):
        scene.block("drawer", (front, front + depth), (y, y + BOARD), (low, top))
    scene.block("drawer", (front + depth - BOARD, front + depth), (-half, half), (low, top))
    floor = low + BOARD
    scene.box("box", (0.1, 0.12, 0.1), (front + 0.12, 0.15, floor + 0.05), role="object")
    scene.cylinder("can", 0.035, 0.12, (front + 0.1, -0.2, floor + 0.06), role="object")
