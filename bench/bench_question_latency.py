"""Round trips of questions over DDS, from a process of its own, while both nodes map.

    python bench/bench_question_latency.py [--surfaces 1000] [--answers 100] [--rate 1.0]

`all_in_one` maps the bundled flat, played by player_node; what it answers from is a drawn map of so
many tables with three objects on each (`bench_questions.scene`), which replaces each solution, so
that it is unpacked and prepared as often as a real one. Printed are the least, the median, the 95th
percentile and the largest round trip of each service, ms, and the processor time of the client in
each, which an asker in C++ does not have. On a busy machine the least tells what an answer takes.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from bench_questions import scene
from geometry_msgs.msg import Point, PointStamped, Pose, PoseStamped, Vector3
from rclpy.node import Node
from std_msgs.msg import Header
from tccm_interfaces.msg import SurfaceFilter
from tccm_interfaces.srv import CheckBox, FindPlacements, FindSurfaces, ListMaps, SaveMap

FLAT = Path(__file__).resolve().parents[1] / "bags" / "flat"
DOMAIN = "77"
MAPS = 5
"""Saved before the first question, so that ~/list_maps has some to read."""

WAIT_S = 300.0

QUIET = ("--log-level", "error")


class Question(NamedTuple):
    """A request for a service of a node."""

    name: str
    service: str
    request: Any


def questions() -> Iterator[Question]:
    """Yield what is asked."""
    near = SurfaceFilter(max_distance=3.0)
    near.near = PointStamped(header=Header(frame_id="map"), point=Point(x=40.0, y=40.0))
    mug = {"size_x": 0.1, "size_y": 0.1, "height": 0.12, "clearance": 0.02, "max_count": 10}
    box = PoseStamped(header=Header(frame_id="base_link"), pose=Pose(position=Point(x=1.0, z=0.5)))
    find, place = "surface_slam/find_surfaces", "surface_slam/find_placements"
    yield Question("find_surfaces, near a point", find, FindSurfaces.Request(filter=near))
    yield Question("find_surfaces, nearest 10", find, FindSurfaces.Request(max_count=10))
    yield Question("find_surfaces, all", find, FindSurfaces.Request())
    yield Question(
        "find_placements, near a point", place, FindPlacements.Request(filter=near, **mug)
    )
    yield Question("find_placements, all", place, FindPlacements.Request(**mug))
    small = Vector3(x=0.2, y=0.2, z=0.2)
    yield Question("check_box", "tccm/check_box", CheckBox.Request(pose=box, size=small))
    yield Question("list_maps", "surface_slam/list_maps", ListMaps.Request())


def serve(surfaces: int, folder: str) -> None:
    """Run both nodes, which save into a folder; what is asked is answered from the drawn map."""
    from tccm_ros.nodes import programs
    from tccm_ros.nodes.all_in_one import main as all_in_one

    drawn = scene(surfaces)
    programs.unpack_scene = lambda _: drawn  # type: ignore[attr-defined]
    sys.argv = [*sys.argv[:1], "--ros-args", "-p", f"save.directory:={folder}", *QUIET]
    all_in_one()


@contextmanager
def running(*words: str) -> Iterator[None]:
    """Have a process run; it is told to stop at the end."""
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def player(rate: float) -> list[str]:
    """Return the words that start a player of the flat."""
    start = "from tccm_ros.nodes.start import player_node; player_node()"
    values = {"bag": FLAT, "rate": rate, "wait_for_subscribers": WAIT_S}
    return [
        "-c",
        start,
        "--ros-args",
        *(w for k, v in values.items() for w in ("-p", f"{k}:={v}")),
        *QUIET,
    ]


class Asker:
    """Asks, one question after the other."""

    def __init__(self) -> None:
        self._node = Node("asker")
        self._clients: dict[str, Any] = {}

    def ask(self, service: str, request: Any) -> Any:
        """Return the answer; RuntimeError where none comes."""
        if service not in self._clients:
            kind = next(k for k in KINDS if isinstance(request, k.Request))
            self._clients[service] = self._node.create_client(kind, service)
            self._clients[service].wait_for_service(WAIT_S)
        asked = self._clients[service].call_async(request)
        rclpy.spin_until_future_complete(self._node, asked, timeout_sec=WAIT_S)
        if not asked.done():
            raise RuntimeError(f"no answer of {service}")
        return asked.result()

    def until(self, is_enough: Callable[[Any], bool], service: str, request: Any) -> None:
        """Ask again and again until an answer is enough."""
        end = time.monotonic() + WAIT_S
        while not is_enough(self.ask(service, request)):
            if time.monotonic() > end:
                raise RuntimeError(f"no good answer of {service}")


KINDS = (CheckBox, FindPlacements, FindSurfaces, ListMaps, SaveMap)


def measured(asker: Asker, question: Question, answers: int) -> tuple[np.ndarray, float]:
    """Return the round trips, ms, and the client's processor time in one, ms.

    RuntimeError where an answer is a refusal.
    """
    trips, begin = [], time.process_time()
    for _ in range(answers):
        sent = time.perf_counter()
        answer = asker.ask(question.service, question.request)
        trips.append(1e3 * (time.perf_counter() - sent))
        if not answer.success:
            raise RuntimeError(f"{question.name}: {answer.message}")
    return np.array(trips), 1e3 * (time.process_time() - begin) / answers


def main() -> None:
    """Ask, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surfaces", type=int, default=1000)
    parser.add_argument("--answers", type=int, default=100)
    parser.add_argument("--rate", type=float, default=1.0, help="of the bag that is mapped")
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.serve:
        serve(words.surfaces, words.serve)
        return
    os.environ |= {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.TemporaryDirectory() as folder:
        nodes = [__file__, "--serve", folder, "--surfaces", str(words.surfaces)]
        with running(*nodes), running(*player(words.rate)):
            ask_all(words.surfaces, words.answers)


def ask_all(surfaces: int, answers: int) -> None:
    """Ask each question so many times, and print how long the answers took."""
    rclpy.init()
    asker = Asker()
    every = FindSurfaces.Request()
    asker.until(lambda a: len(a.surfaces.surfaces) == surfaces, "surface_slam/find_surfaces", every)
    for k in range(MAPS):
        asker.ask("surface_slam/save_named_map", SaveMap.Request(name=f"map{k}", overwrite=True))
    print(f"{'':32}    least   median     95 %     most   client  ms")
    for question in questions():
        trips, own = measured(asker, question, answers)
        figures = (*np.percentile(trips, (0, 50, 95, 100)), own)
        print(f"{question.name:32}" + "".join(f"{ms:9.1f}" for ms in figures))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
