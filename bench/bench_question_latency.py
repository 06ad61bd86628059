"""Round trips of questions over DDS, from a process of its own, while both nodes map.

    python bench/bench_question_latency.py [--surfaces 1000] [--answers 100] [--rate 1.0]

`all_in_one` maps the bundled flat, played by player_node; what it answers from is a drawn map of so
many tables with three objects on each (`bench_questions.scene`), which replaces each solution, so
that it is unpacked and prepared as often as a real one. Beside each question is asked a
std_srvs/Trigger of a node in a third process that does nothing else: what rclpy takes on this
machine at this moment. Printed are the least, the median, the 95th percentile and the largest round
trip of each service, the median of Trigger between them, and the processor time of the client in
an answer, all in ms. On a busy machine the least tells what an answer takes.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from bench_questions import scene
from geometry_msgs.msg import Point, PointStamped, Pose, PoseStamped, Vector3
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from tccm_interfaces.msg import SurfaceFilter
from tccm_interfaces.srv import CheckBox, FindPlacements, FindSurfaces, ListMaps, SaveMap

FLAT = Path(__file__).resolve().parents[1] / "bags" / "flat"
DOMAIN = os.environ.get("ROS_DOMAIN_ID", "77")
MAPS = 5
"""Saved before the first question, so that ~/list_maps has some to read."""

WAIT_S = 300.0

QUIET = ("--log-level", "error")


class Question(NamedTuple):
    """A request for a service of a node."""

    name: str
    service: str
    request: Any


NOTHING = Question("nothing", "idle/nothing", Trigger.Request())
"""What is asked between the questions."""


def questions() -> Iterator[Question]:
    """Yield what is asked; the last one takes long."""
    near = SurfaceFilter(max_distance=3.0)
    near.near = PointStamped(header=Header(frame_id="map"), point=Point(x=40.0, y=40.0))
    mug = {"size_x": 0.1, "size_y": 0.1, "height": 0.12, "clearance": 0.02, "max_count": 10}
    box = PoseStamped(header=Header(frame_id="base_link"), pose=Pose(position=Point(x=1.0, z=0.5)))
    find, place = "surface_slam/find_surfaces", "surface_slam/find_placements"
    yield Question("find_surfaces, near a point", find, FindSurfaces.Request(filter=near))
    yield Question("find_surfaces, nearest 10", find, FindSurfaces.Request(max_count=10))
    yield Question(
        "find_placements, near a point", place, FindPlacements.Request(filter=near, **mug)
    )
    yield Question("find_placements, all", place, FindPlacements.Request(**mug))
    small = Vector3(x=0.2, y=0.2, z=0.2)
    yield Question("check_box", "tccm/check_box", CheckBox.Request(pose=box, size=small))
    yield Question("list_maps", "surface_slam/list_maps", ListMaps.Request())
    yield Question("find_surfaces, all", find, FindSurfaces.Request())


def serve(surfaces: int, folder: str) -> None:
    """Run both nodes, which save into a folder; what is asked is answered from the drawn map."""
    from tccm_ros.nodes.all_in_one import main as all_in_one
    from tccm_ros.nodes.services import client_api

    drawn = scene(surfaces)
    client_api.unpack_scene = lambda _: drawn  # type: ignore[attr-defined]
    sys.argv = [*sys.argv[:1], "--ros-args", "-p", f"save.directory:={folder}", *QUIET]
    all_in_one()


def serve_nothing() -> None:
    """Run a node whose one service does nothing."""

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        return response

    rclpy.init()
    node = Node("idle")
    node.create_service(Trigger, NOTHING.service, answer)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


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
    """Asks, one question after the other.

    It spins step by step: each `spin_until_future_complete` of rclpy 7.1 leaves tasks behind that
    the next one has to do first, and the tenth question in a row takes longer than the first.
    """

    def __init__(self) -> None:
        self._node = Node("asker")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._clients: dict[str, Any] = {}

    def ask(self, service: str, request: Any) -> Any:
        """Return the answer; RuntimeError where none comes."""
        if service not in self._clients:
            kind = next(k for k in KINDS if isinstance(request, k.Request))
            self._clients[service] = self._node.create_client(kind, service)
            self._clients[service].wait_for_service(WAIT_S)
        asked = self._clients[service].call_async(request)
        end = time.monotonic() + WAIT_S
        while not asked.done():
            if time.monotonic() > end:
                raise RuntimeError(f"no answer of {service}")
            self._executor.spin_once(WAIT_S)
        return asked.result()

    def until(self, is_enough: Callable[[Any], bool], service: str, request: Any) -> None:
        """Ask again and again until an answer is enough."""
        end = time.monotonic() + WAIT_S
        while not is_enough(self.ask(service, request)):
            if time.monotonic() > end:
                raise RuntimeError(f"no good answer of {service}")


KINDS = (CheckBox, FindPlacements, FindSurfaces, ListMaps, SaveMap, Trigger)


def round_trip(asker: Asker, question: Question) -> tuple[float, float]:
    """Return the time of a round trip and the client's processor time in it, ms.

    RuntimeError where the answer is a refusal.
    """
    sent, begin = time.perf_counter(), time.process_time()
    answer = asker.ask(question.service, question.request)
    taken = 1e3 * (time.perf_counter() - sent), 1e3 * (time.process_time() - begin)
    if not answer.success:
        raise RuntimeError(f"{question.name}: {answer.message}")
    return taken


def main() -> None:
    """Ask, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surfaces", type=int, default=1000)
    parser.add_argument("--answers", type=int, default=100)
    parser.add_argument("--rate", type=float, default=1.0, help="of the bag that is mapped")
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    parser.add_argument("--serve-nothing", action="store_true", help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.serve:
        serve(words.surfaces, words.serve)
        return
    if words.serve_nothing:
        serve_nothing()
        return
    os.environ |= {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.TemporaryDirectory() as folder:
        nodes = [__file__, "--serve", folder, "--surfaces", str(words.surfaces)]
        idle = [__file__, "--serve-nothing"]
        with running(*idle), running(*nodes), running(*player(words.rate)):
            ask_all(words.surfaces, words.answers)


def ask_alternately(
    asker: Asker, asked: Sequence[Question], answers: int
) -> dict[str, list[tuple[float, float, float]]]:
    """Ask one question after the other, and nothing between two of them.

    Return of each answer the round trip, that of nothing, and the client's processor time, ms.
    """
    taken: dict[str, list[tuple[float, float, float]]] = {question.name: [] for question in asked}
    for _ in range(answers):
        for question in asked:
            trip, own = round_trip(asker, question)
            taken[question.name].append((trip, round_trip(asker, NOTHING)[0], own))
    return taken


def ask_all(surfaces: int, answers: int) -> None:
    """Ask each question so many times, and print how long the answers took."""
    rclpy.init()
    asker = Asker()
    every = FindSurfaces.Request()
    asker.until(lambda a: len(a.surfaces.surfaces) == surfaces, "surface_slam/find_surfaces", every)
    for k in range(MAPS):
        asker.ask("surface_slam/save_named_map", SaveMap.Request(name=f"map{k}", overwrite=True))
    short, long = list(questions())[:-1], list(questions())[-1:]
    taken = ask_alternately(asker, short, answers) | ask_alternately(asker, long, answers)
    print(f"{'':32}    least   median     95 %     most  Trigger   client  ms")
    for name, figures in taken.items():
        trips, nothing, own = np.array(figures).T
        row = (*np.percentile(trips, (0, 50, 95, 100)), np.median(nothing), own.mean())
        print(f"{name:32}" + "".join(f"{ms:9.1f}" for ms in row))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
