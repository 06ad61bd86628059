"""Rooms of random flats against the truth: intersection over union, and how long it takes.

Usage: python bench/bench_rooms.py [SEEDS]

Each flat is driven through once with a level laser; walls and grid are those of the map that comes
of it. Of each true room the found room that fits best counts; a found room counts once.
"""

from __future__ import annotations

import argparse
from time import process_time

import numpy as np
from random_flats import random_flat
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.replay.processors import Pipeline
from tccm_ros.rooms.segmentation import find_rooms
from tccm_ros.slam.occupancy import occupancy_grid
from tccm_sim.engine import Simulation
from tccm_sim.options import Options
from tccm_sim.truth import map_from_world


def mapped_rooms(simulation: Simulation) -> tuple[list[Float64], float]:
    """Return the rooms of the map of a drive, and the time that finding them took, s."""
    pipeline = Pipeline(Config(), expects_odometry=True)
    topics = simulation.rig.topics
    roles = {topics.scan: "scan", topics.odom: "odom", topics.joint_states: "joint_states",
             "/robot_description": "robot_description"}  # fmt: skip
    for message in simulation.run():
        if message.topic in roles:
            for record in message.records:
                pipeline.add(roles[message.topic], record)
    pipeline.finish()
    solution = pipeline.solve()
    grid = occupancy_grid(pipeline.slam.saved(solution).walls)
    assert grid is not None
    walls = [wall.endpoints for wall in solution.graph.walls]
    start = process_time()
    return find_rooms(walls, grid), process_time() - start


def overlaps(simulation: Simulation, rooms: list[Float64]) -> list[float]:
    """Return the intersection over union of each true room with the found room that fits best."""
    T = map_from_world(simulation)
    left = [Polygon(room) for room in rooms]
    found = []
    for room in simulation.world.rooms:
        true = Polygon(room.boundary @ T[:2, :2].T + T[:2, 3])
        values = [true.intersection(p).area / true.union(p).area for p in left]
        found.append(max(values, default=0.0))
        if values:
            left.pop(int(np.argmax(values)))
    return found


def main() -> None:
    """Print a line for each flat, and the mean of all rooms."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("seeds", type=int, nargs="?", default=20, help="number of flats")
    every, times, extra = [], [], 0
    for seed in range(parser.parse_args().seeds):
        options = Options(tilt=False)
        simulation = Simulation(random_flat(seed, options), seed, options)
        rooms, seconds = mapped_rooms(simulation)
        values = overlaps(simulation, rooms)
        every += values
        times.append(seconds)
        extra += max(len(rooms) - len(values), 0)
        text = " ".join(f"{value:.3f}" for value in values)
        print(f"flat {seed}: {text}, {len(rooms)} found, {1e3 * seconds:.0f} ms", flush=True)
    print(
        f"{len(every)} rooms: mean IoU {np.mean(every):.3f}, worst {min(every):.3f}, "
        f"{extra} rooms too many, median {1e3 * np.median(times):.0f} ms"
    )


if __name__ == "__main__":
    main()
