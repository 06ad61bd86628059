"""Write the messages of a simulation to a bag, and the ground truth beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter, Qos
from tccm_ros.pipeline.sim import truth
from tccm_ros.pipeline.sim.engine import Message, Simulation
from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.worlds import build_world
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan
from tccm_ros.ros.writing import (
    joint_sample_message,
    odometry_message,
    robot_description_message,
    scan_message,
    transforms_message,
)

Progress = Callable[[float], None]

SENSOR = Qos(reliable=False, depth=5)
"""QoS of scans: sensor data, as drivers offer it."""


def run(name: str, *, seed: int = 0, options: Options | None = None) -> Iterator[Message]:
    """Yield the messages of the robot of a world, in order, without a bag.

    Parameters
    ----------
    name
        One of `WORLDS`.
    seed
        Seed of all noise.
    options
        Variations of the world.

    Raises
    ------
    ConfigError
        For a name that no world has.
    """
    yield from Simulation(build_world(name, options), seed, options).run()


def simulate(
    name: str,
    out: Path | str,
    *,
    seed: int = 0,
    options: Options | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Simulate a world and write a bag with its truth; the same seed gives the same bytes.

    Parameters
    ----------
    name
        One of `WORLDS`.
    out
        Folder of the bag: ``<name>.mcap``, ``metadata.yaml``, ``truth.json`` (surfaces),
        ``truth.tum`` (trajectory of the base in map) and ``truth_walls.json``.
    seed
        Seed of all noise.
    options
        Variations of the world.
    overwrite
        Whether an existing bag is replaced.
    progress
        Called with the fraction that is done, 0 to 1.

    Returns
    -------
    Path
        `out`.

    Raises
    ------
    ConfigError
        For a name that no world has.
    OutputError
        Where `out` exists already or cannot be written.
    """
    simulation = Simulation(build_world(name, options), seed, options)
    types = TypestoreMessages()
    with BagWriter(out, overwrite=overwrite, typestore=types) as bag:
        topics = simulation.rig.topics
        for topic in (topics.tilt_scan, topics.scan):
            bag.add_topic(topic, "sensor_msgs/msg/LaserScan", SENSOR)
        for message in simulation.run():
            msgtype, content = _message(types, message, simulation)
            bag.write(message.topic, msgtype, message.log_ns, content)
            if progress is not None:
                fraction = (message.log_ns - simulation.start_ns) / simulation.duration_ns
                progress(min(fraction, 1.0))
        _write_truth(simulation, bag.folder)
    return Path(out)


def _message(types: TypestoreMessages, message: Message, simulation: Simulation) -> (
    tuple[str, Any]
):  # fmt: skip
    """Return the type and the content of a simulated message."""
    record = message.records[0]
    if isinstance(record, Scan):
        is_tilt = message.topic == simulation.rig.topics.tilt_scan
        period = (simulation.rig.tilt if is_tilt else simulation.rig.level).period
        return "sensor_msgs/msg/LaserScan", scan_message(types, record, scan_time=period)
    if isinstance(record, JointSample):
        return "sensor_msgs/msg/JointState", joint_sample_message(types, record)
    if isinstance(record, Odometry):
        return "nav_msgs/msg/Odometry", odometry_message(types, record)
    if isinstance(record, RobotDescription):
        return "std_msgs/msg/String", robot_description_message(types, record)
    return "tf2_msgs/msg/TFMessage", transforms_message(types, message.transforms)


def _write_truth(simulation: Simulation, folder: Path) -> None:
    for name, content in (
        ("truth.json", truth.surfaces(simulation)),
        ("truth_walls.json", truth.walls(simulation)),
    ):
        (folder / name).write_text(json.dumps(content) + "\n", encoding="utf-8")
    lines = "\n".join(truth.trajectory(simulation))
    (folder / "truth.tum").write_text(lines + "\n", encoding="utf-8")
