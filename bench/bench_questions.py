"""Processor time of answers about maps of 1,000 surfaces and 3,000 objects, without DDS.

    python bench/bench_questions.py [--surfaces 1000]

Surfaces are tables of 0.6 to 1.8 m, three objects on each. Printed are the median and the largest
of 20 answers, in ms of processor time, and what a solution costs before it can answer.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from rclpy.serialization import serialize_message

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.nodes.interfaces import service_class
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.services.surface_services import SceneQueries
from tccm_ros.records import Surface, SurfaceShape, SurfaceSighting
from tccm_ros.ros.surface_messages import SURFACE, surface_message
from tccm_ros.scene.queries import SurfaceFilter
from tccm_ros.scene.scene import KnownSurface, Scene
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.tabletop.placements import PlacementRequest

ANSWERS = 20
MUG = PlacementRequest(0.1, 0.1, 0.12, 0.02, 10)


def scene(count: int) -> Scene:
    """Return a scene of tables in a grid of 3 m, with three objects on each."""
    rng, types = np.random.default_rng(1), TypestoreMessages()
    known, objects = [], []
    for k in range(count):
        corner, size = np.array(divmod(k, 32)) * 3.0, rng.uniform(0.6, 1.8, 2)
        xy = corner + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size
        ring = np.column_stack([xy, np.full(4, 0.74)])
        surface = Surface(
            k, "table", 0.9, 0.74, np.array([0.0, 0.0, 1.0]), 0.74, float(size.prod()),
            ring.mean(axis=0), ring, (), 1000, 0.002, 1, 2, (SurfaceSighting(1, 0, 1000),),
            shape=SurfaceShape.RECTANGLE, area_seen=float(size.prod()), boundary_seen=ring,
        )  # fmt: skip
        message = bytes(types.serialize(SURFACE, surface_message(types, 1, "map", surface, 0.0)))
        known.append(KnownSurface(surface, 2, message))
        for j, at in enumerate(corner + size * rng.uniform(0.1, 0.9, (3, 2))):
            box, center = np.array([0.1, 0.1, 0.12]), np.array([*at, 0.8])
            objects.append(SceneObject(3 * k + j, k, center, box, 0.3, views=3))
    return Scene(1, "map", 0.0, tuple(objects), None, tuple(known))


def find_surfaces(asked: SceneQueries, wanted: SurfaceFilter) -> bytes:
    """Answer find_surfaces as slam_node does, and serialise the answer."""
    found = asked.queries.find_surfaces(wanted)
    answer = service_class("FindSurfaces").Response()
    answer.surfaces.surfaces = asked.messages(found)
    answer.objects = asked.object_messages(found)
    return bytes(serialize_message(answer))


def milliseconds(ask: Callable[[], object], answers: int = ANSWERS) -> tuple[float, float]:
    """Return the median and the largest processor time of a question, ms."""
    taken = []
    for _ in range(answers):
        begin = time.process_time()
        ask()
        taken.append(1e3 * (time.process_time() - begin))
    return float(np.median(taken)), max(taken)


def main() -> None:
    """Ask, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surfaces", type=int, default=1000)
    drawn, types = scene(parser.parse_args().surfaces), RosidlMessages()
    prepared, _ = milliseconds(lambda: SceneQueries(drawn, types), 3)
    asked = SceneQueries(drawn, types)
    near = SurfaceFilter(near=(40.0, 40.0), max_distance=3.0)
    questions = {
        "find_surfaces, near a point": lambda: find_surfaces(asked, near),
        "find_surfaces, all": lambda: find_surfaces(asked, SurfaceFilter()),
        "find_placements, near a point": lambda: asked.queries.find_placements(near, MUG),
        "find_placements, all": lambda: asked.queries.find_placements(SurfaceFilter(), MUG),
    }
    print(f"{'before answers':32} {prepared:8.1f} ms")
    for name, ask in questions.items():
        median, largest = milliseconds(ask)
        print(f"{name:32} {median:8.1f} ms, at most {largest:.1f} ms")


if __name__ == "__main__":
    main()
