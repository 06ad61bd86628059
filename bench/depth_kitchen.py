"""The simulator's kitchen, seen by a depth camera of 640 x 480 pixels on the head of a Fetch.

The robot stands and looks around; what it sees repeats with the movement of its head, every `LOOP`
seconds. So much is simulated, and a longer recording repeats it with later stamps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.records import DepthImage
from tccm_sim.engine import Simulation
from tccm_sim.heads import XTION, look_around, robot
from tccm_sim.motion import Drive
from tccm_sim.options import Options
from tccm_sim.world import World
from tccm_sim.worlds import build_world

LOOP = 2.0
"""Time in which the head nods once and pans twice, s."""

STANDS = {"at the worktop": (1.2, 1.25, -np.pi / 2), "in the room": (3.4, 2.0, 2.6)}
"""x, y in m and yaw in rad of the base: 0.65 m before the worktop; before the kitchen table."""

DEPTH, INFO, SCAN = "depth/image_rect_raw", "depth/camera_info", "scan"
"""Topics, as the nodes have them."""


class Sample(NamedTuple):
    """A record, when it is published, and on which topic."""

    log_ns: int
    topic: str
    record: Any


def kitchen(stand: str, rate: float) -> Simulation:
    """Return the simulation of one loop.

    Parameters
    ----------
    stand
        One of `STANDS`.
    rate
        Images per second.
    """
    scene = build_world("rgbd_kitchen", Options()).scene
    rig = robot("fetch")
    camera = replace(XTION, width=640, height=480, focal=570.0, period=1.0 / rate)
    topics = replace(rig.topics, depth=f"/{DEPTH}", scan=f"/{SCAN}")
    rig = replace(rig, camera=camera, topics=topics)
    times = np.array([0.0, LOOP])
    states = np.array([[*STANDS[stand], 0.0, 0.0]] * 2)
    joints = look_around(rig, times[None], LOOP)
    drive = Drive(times, states, times[None])
    return Simulation(World("kitchen", scene, rig, drive, joints))


def samples(stand: str, rate: float, seconds: float) -> Iterator[Sample]:
    """Yield a recording that repeats one loop, in the order of publication."""
    simulation, loop_ns = kitchen(stand, rate), round(LOOP * 1e9)
    once = [
        Sample(published.log_ns, published.topic.lstrip("/"), record)
        for published in simulation.run()
        for record in published.records
    ]
    once.sort(key=lambda sample: sample.log_ns)
    end_ns = simulation.start_ns + round(seconds * 1e9)
    for k in range(int(np.ceil(seconds / LOOP))):
        for log_ns, topic, record in once:
            if log_ns + k * loop_ns < end_ns and not (k and topic == "robot_description"):
                yield Sample(log_ns + k * loop_ns, topic, _later(record, k * loop_ns))


def _later(record: Any, shift_ns: int) -> Any:
    if not shift_ns or not hasattr(record, "stamp_ns"):
        return record
    changes: dict[str, Any] = {"stamp_ns": record.stamp_ns + shift_ns}
    if isinstance(record, DepthImage):
        changes["camera"] = None
    return replace(record, **changes)
