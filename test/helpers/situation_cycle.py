"""One tilt cycle over a situation of the simulator, without a bag: for tests and benches.

The robot stands at the origin; its laser is 1.52 m above the floor, sees 240 degrees with 569 beams
and tilts from 5 to 65 degrees down in 40 scans.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import radians

import numpy as np
from numpy.typing import NDArray

from tccm_sim.raycast import FACES
from tccm_sim.scene import FrozenScene, Solid
from tccm_sim.situations import CYCLE_TIME, TILT_HIGH, TILT_LOW, situation_scene

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

FLOOR, WALL, SUBJECT, OTHER = 0, 1, 2, 3
"""Labels: `SUBJECT` is the table's top or the shelf's front, `OTHER` any other solid."""

LASER_HEIGHT = 1.52
BEAMS, SCANS = 569, 40
FIELD = radians(240.0)
SCAN_TIME = 0.028 * 240.0 / 360.0  # s, first to last beam: a turn takes 28 ms


@dataclass(frozen=True)
class Cycle:
    """One tilt cycle.

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
        int64 (N,), the solid that each beam hit: `FLOOR`, `WALL`, `SUBJECT` or `OTHER`.
    normal, offset
        The subject's true plane, ``normal . p = offset``: up for a table, towards the robot for a
        shelf.
    laser_height
        Height of the optical centre on the tilt axis, m.
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
    """Return one tilt cycle over a situation.

    Parameters
    ----------
    name
        One of `SITUATIONS`.
    sigma, quantum
        Standard deviation and step of the ranges, m.
    seed
        Seed of the noise.
    yaw, pitch, translation
        Motion of the subject about its own centre, rad and m: a tilted table turns its top towards
        the robot, a tilted shelf its front upwards.
    start
        Time of the first beam, s; the arm of C has its position at that time.
    downwards
        Whether the tilt cycle goes from its first to its second limit.
    room
        Whether side walls, a rear wall and a ceiling close the scene, so that all beams return.
    scans, beams, tilt_limits
        Numbers of scans and beams, and limits of the tilt, rad.

    Returns
    -------
    Cycle
    """
    scene = situation_scene(name, yaw, pitch, translation, room)
    frozen, labels_of = _frozen(name, yaw, pitch, translation, room)
    first = start + CYCLE_TIME / scans * np.arange(scans)
    times = first[:, None] + SCAN_TIME / (beams - 1) * np.arange(beams)
    low, high = tilt_limits if downwards else tilt_limits[::-1]
    tilts = low + (high - low) * (times - start) / CYCLE_TIME
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


@lru_cache(maxsize=64)
def _frozen(
    name: str, yaw: float, pitch: float, translation: Vector, room: bool
) -> tuple[FrozenScene, NDArray[np.int64]]:
    """Return the scene for ray casting, and the label of each code."""
    scene = situation_scene(name, yaw, pitch, translation, room)
    labels = np.full(len(scene.solids) * FACES, OTHER)
    for i, solid in enumerate(scene.solids):
        rows = slice(i * FACES, (i + 1) * FACES)
        if solid.role in ("floor", "wall"):
            labels[rows] = FLOOR if solid.role == "floor" else WALL
        elif solid.name == "subject":
            labels[i * FACES + (5 if name in "ac" else 0)] = SUBJECT
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
