"""Drives of four robots through one building, and through another with the same walls.

Usage: python bench/merge_drives.py FOLDER [BUILDING ...]

``write_drives(folder, building)`` writes recordings with other starts, drifts and laser noise.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import pi
from pathlib import Path

from tccm_sim import flat as flat_module
from tccm_sim.engine import Simulation
from tccm_sim.flat import flat_scene, stop_and_scan
from tccm_sim.motion import Waypoint
from tccm_sim.options import Options
from tccm_sim.recording import record
from tccm_sim.ring import LAP, START, ring_world
from tccm_sim.scene import Scene
from tccm_sim.world import World

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

FIRST_STOPS = (0, 5, 8, 11)
"""Where in the ring's round the four robots begin."""

NOISE = (
    Options(),
    Options(heading_drift=0.006, sigma=0.006, level_sigma=0.012),
    Options(heading_drift=-0.008, sigma=0.009),
    Options(heading_drift=0.004, odometry=1.5, level_sigma=0.015),
)
"""Of the four robots: drift of the heading, rad/m, and noise of the lasers, m."""


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


def _ring_route(robot: int) -> Sequence[Waypoint]:
    """Return a round that begins at another of the stops and goes on past the next."""
    first = FIRST_STOPS[robot]
    round_trip = [START, *LAP]
    begun = [*round_trip[first:], *round_trip[:first]]
    end = begun[1]
    return [*begun, begun[0], end]


def _flat(scene: Callable[[], Scene]) -> Callable[[int], World]:
    return lambda robot: stop_and_scan("flat", scene(), ROUTES[robot], NOISE[robot])


BUILDINGS: dict[str, Callable[[int], World]] = {
    "flat": _flat(flat_scene),
    "other": _flat(other_flat_scene),
    "ring": lambda robot: ring_world(_ring_route(robot), NOISE[robot]),
}
"""Worlds by robot; ``other`` has the walls of the flat and other furniture."""


def write_drives(folder: Path, building: str, robots: Sequence[int] = range(4)) -> list[Path]:
    """Write recordings; those that are there are left.

    Parameters
    ----------
    folder
        Of the recordings.
    building
        One of `BUILDINGS`.
    robots
        Which of the four.
    """
    paths = [folder / f"{building}_{robot}" for robot in robots]
    for robot, path in zip(robots, paths):
        if not path.exists():
            world = BUILDINGS[building](robot)
            record(Simulation(world, 10 + robot, NOISE[robot]), path)
    return paths


def main() -> None:
    """Write the drives of some buildings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("buildings", nargs="*", default=list(BUILDINGS))
    arguments = parser.parse_args()
    for building in arguments.buildings:
        write_drives(arguments.folder, building)


if __name__ == "__main__":
    main()
