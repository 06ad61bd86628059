"""Bags of flats at random for `soak.py day`: later and later stamps, people, and what goes wrong.

    python bench/soak_flats.py DIR --seed 3 --fault "level laser silent" --later 600 --laps 2

A fault happens while the robot stands at a stop in the middle of its drive, so that the truth after
it is known exactly: what the file `truth.json` lists is in the frame of the drive's first pose, and
`origin.json` says which pose the map begins at instead, and when.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from random_flats import random_flat

from tccm_sim.engine import Message, Simulation
from tccm_sim.options import Options
from tccm_sim.recording import record
from tccm_sim.truth import map_from_world
from tccm_sim.world import World

FAULTS = (
    "none",
    "level laser silent",
    "tccm_node restarts",
    "clock steps back by 5 s",
    "slam_node restarts",
    "tilting laser silent",
)
"""What happens in the middle of a drive; the nodes are restarted by who plays it."""

SILENT_NS = 6_000_000_000
STEP_NS = -5_000_000_000
NICENESS = 10
"""The nodes come first: a bag is made while another one is driven."""


def people(world: World) -> None:
    """Let a person walk past before the robot at every third stop."""
    stops = world.drive.stops
    for number, (start, end) in enumerate(stops.tolist()[1::3]):
        x, y, yaw = world.drive.states[np.searchsorted(world.drive.times, start), :3]
        c, s = np.cos(yaw), np.sin(yaw)
        walk = [
            (time, x + 1.2 * c - side * s, y + 1.2 * s + side * c)
            for time, side in ((start, -1.0), (end, 1.0))
        ]
        world.scene.person(f"person {number}", walk)


def middle_of(world: World) -> float:
    """Return a time 2 s after the robot began a stop in the middle of its drive, s."""
    stops = world.drive.stops
    return float(stops[len(stops) // 2, 0]) + 2.0


def later(record: Any, shift_ns: int) -> Any:
    """Return a record with a later stamp; the robot description has none."""
    has_stamp = hasattr(record, "stamp_ns")
    return replace(record, stamp_ns=record.stamp_ns + shift_ns) if has_stamp else record


def with_fault(
    messages: Iterable[Message], fault: str, middle_ns: int, later_ns: int
) -> Iterator[Message]:
    """Yield the messages `later_ns` later, and with the fault from `middle_ns` on."""
    silent = {"level laser silent": "/scan", "tilting laser silent": "/tilt_scan"}.get(fault)
    step_ns = STEP_NS if fault.startswith("clock") else 0
    for message in messages:
        since_ns = message.log_ns - middle_ns
        if message.topic == silent and 0 <= since_ns < SILENT_NS:
            continue
        shift_ns = later_ns + (step_ns if since_ns >= 0 else 0)
        records = tuple(later(r, shift_ns) for r in message.records)
        yield Message(message.log_ns + later_ns, message.topic, records)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--laps", type=int, default=2)
    parser.add_argument("--later", type=float, default=0.0, help="of the stamps, s")
    parser.add_argument("--fault", choices=FAULTS, default=FAULTS[0])
    arguments = parser.parse_args()
    os.nice(NICENESS)
    options = Options(always=True, cycle_period=3.1, laps=arguments.laps)
    world = random_flat(arguments.seed, options)
    people(world)
    simulation = Simulation(world, arguments.seed, options)
    middle_s, later_ns = middle_of(world), round(arguments.later * 1e9)
    middle_ns = simulation.start_ns + round(middle_s * 1e9)
    sent: Counter[str] = Counter()

    def counted() -> Iterator[Message]:
        for message in with_fault(simulation.run(), arguments.fault, middle_ns, later_ns):
            sent[message.topic] += 1
            yield message

    record(simulation, arguments.out, messages=counted())
    begins_anew = arguments.fault.startswith("clock")
    step_ns = STEP_NS if begins_anew else 0
    since_ns = middle_ns + later_ns + step_ns if begins_anew else 0
    path = arguments.out / "truth.tum"
    path.write_text("".join(_later_rows(path.read_text(), later_ns + step_ns, since_ns)))
    about = {
        "seed": arguments.seed,
        "fault": arguments.fault,
        "middle_s": middle_s,
        "duration_s": world.duration,
        "sent": dict(sent),
        "T_truth_map": _origin(simulation, middle_s if begins_anew else 0.0).tolist(),
    }
    (arguments.out / "about.json").write_text(json.dumps(about))


def _later_rows(text: str, later_ns: int, since_ns: int) -> Iterator[str]:
    """Yield rows of a TUM file with later stamps, those after `since_ns` alone."""
    for line in text.splitlines():
        stamp, rest = line.split(" ", 1)
        seconds, fraction = stamp.split(".")
        stamp_ns = int(seconds) * 10**9 + int(fraction) + later_ns
        if stamp_ns >= since_ns:
            yield f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {rest}\n"


def _origin(simulation: Simulation, time_s: float) -> np.ndarray:
    """Return T_truth_map of a map that begins at a time, float64 (4, 4): yaw, x and y alone."""
    T = map_from_world(simulation) @ simulation.true_poses(np.array([time_s]))[0]
    yaw = np.arctan2(T[1, 0], T[0, 0])
    level = np.eye(4)
    level[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    level[:2, 3] = T[:2, 3]
    return level


if __name__ == "__main__":
    main()
