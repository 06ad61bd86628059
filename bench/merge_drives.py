"""Drives of several robots through one building, and through another with the same walls.

``write_drives(folder, names)`` writes recordings of the flat and of the ring with other starts,
drifts and laser noise, and of a flat with the walls of the first and other furniture.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from math import pi
from pathlib import Path

from tccm_ros.pipeline.sim import flat as flat_module
from tccm_ros.pipeline.sim.flat import flat_scene, stop_and_scan
from tccm_ros.pipeline.sim.motion import Waypoint
from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.recording import simulate
from tccm_ros.pipeline.sim.ring import ring
from tccm_ros.pipeline.sim.scene import Scene
from tccm_ros.pipeline.sim.world import World
from tccm_ros.pipeline.sim.worlds import WORLDS

PAUSE = flat_module.PAUSE

ROUTES = (
    flat_module.ROUTE,
    (
        Waypoint(5.6, 2.9, 0.2, PAUSE),
        Waypoint(6.4, 1.7, -1.2, PAUSE),
        Waypoint(5.5, 2.9),
        Waypoint(4.0, 2.85),
        Waypoint(2.6, 1.7, pi, PAUSE),
        Waypoint(1.5, 2.6, -2.3, PAUSE),
        Waypoint(3.3, 3.2, 2.2, PAUSE),
    ),
    (
        Waypoint(6.4, 4.0, 1.0, PAUSE),
        Waypoint(5.75, 4.3, 2.75, PAUSE),
        Waypoint(6.4, 1.7, -1.2, PAUSE),
        Waypoint(5.6, 2.9, 0.2, PAUSE),
        Waypoint(4.0, 2.85),
        Waypoint(3.0, 1.9, -2.9, PAUSE),
    ),
    (
        Waypoint(3.3, 3.2, 2.2, PAUSE),
        Waypoint(1.5, 2.6, -2.3, PAUSE),
        Waypoint(2.6, 1.7, pi, PAUSE),
        Waypoint(4.1, 2.85),
        Waypoint(5.6, 2.9, 0.2, PAUSE),
        Waypoint(5.75, 4.3, 2.75, PAUSE),
    ),
)
"""Where four robots drive in the flat; the first is the route of the world ``flat``."""

NOISE = (
    {},
    {"heading_drift": 0.006, "sigma": 0.006, "level_sigma": 0.012},
    {"heading_drift": -0.008, "sigma": 0.009},
    {"heading_drift": 0.004, "odometry": 1.5, "level_sigma": 0.015},
)
"""Options of the four robots: drift of the heading, rad/m, and noise of the lasers, m."""


def other_flat_scene() -> Scene:
    """Return a flat with the walls of the flat and other furniture."""
    scene = Scene()
    height, thickness = flat_module.WALL_HEIGHT, flat_module.WALL_THICKNESS
    scene.floor_and_ceiling((-0.2, 9.2), (-0.2, 6.2), height)
    corners = [(0.0, 0.0), (9.0, 0.0), (9.0, 6.0), (0.0, 6.0), (0.0, 0.0)]
    for start, end in pairwise(corners):
        scene.wall("outer wall", start, end, height, thickness)
    x = flat_module.MIDDLE
    for low, high in ((0.0, flat_module.DOOR[0]), (flat_module.DOOR[1], 6.0)):
        scene.wall("inner wall", (x, low), (x, high), height, thickness, two_sided=True)
    scene.table("table", (1.0, 0.7), 0.68, (3.4, 5.2), 0.3)
    scene.block("sideboard", (1.0, 2.6), (5.5, 5.95), (0.0, 0.85), surface="sideboard")
    scene.table("round table", (0.8, 0.8), 0.6, (0.8, 0.9))
    scene.block("bench", (8.4, 8.9), (0.4, 1.8), (0.0, 0.5), surface="bench")
    scene.table("desk", (0.7, 1.4), 0.77, (8.4, 3.6))
    scene.block("cabinet", (6.2, 7.0), (5.5, 5.95), (0.0, 1.0), surface="cabinet")
    return scene


def _flat(number: int, scene: Callable[[], Scene]) -> Callable[[Options], World]:
    def build(options: Options) -> World:
        return stop_and_scan("flat", scene(), ROUTES[number], options)

    return build


def _ring(number: int) -> Callable[[Options], World]:
    """Return a ring in which the robot starts at another of the stops of its route."""

    def build(options: Options) -> World:
        return replace(ring(options), name="ring")

    return build


def write_drives(folder: Path, numbers: Iterable[int] = range(4), kind: str = "flat") -> list[Path]:
    """Write recordings; those that are there are left.

    Parameters
    ----------
    folder
        Of the recordings.
    numbers
        Which of the four robots.
    kind
        ``flat``, ``other`` (other furniture) or ``ring``.
    """
    paths = []
    for number in numbers:
        scene = other_flat_scene if kind == "other" else flat_scene
        WORLDS["drive"] = _flat(number, scene) if kind != "ring" else _ring(number), ""
        path = folder / f"{kind}_{number}"
        if not path.exists():
            simulate("drive", path, seed=10 + number, options=Options(**NOISE[number]))
        paths.append(path)
    return paths


if __name__ == "__main__":
    write_drives(Path(sys.argv[1]), kind=sys.argv[2])
