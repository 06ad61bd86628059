"""Write the messages of a simulation to a bag, with the ground truth beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from tccm_ros.bags.writer import BagWriter, Qos
from tccm_ros.records import CameraImage, CameraInfo, DepthImage, Imu, PointCloud, Scan
from tccm_sim import truth
from tccm_sim.engine import Message, Simulation
from tccm_sim.messages import WRITERS, write_records
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

Progress = Callable[[float], None]

SENSOR = Qos(reliable=False, depth=5)
"""QoS of scans, the sensor data profile of drivers."""

TRANSPORTS = {DepthImage: "/compressedDepth", CameraImage: "/compressed"}
"""Topic suffixes of image_transport for compressed images."""


def run(name: str, *, seed: int = 0, options: Options | None = None) -> Iterator[Message]:
    """Yield the messages of a world's robot in order, without a bag.

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
        If there is no world of that name.
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
    """Simulate a world and write a bag with its truth, byte-identical for the same seed.

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
        Whether to replace an existing bag.
    progress
        Called with the completed fraction, 0 to 1.

    Returns
    -------
    Path
        `out`.

    Raises
    ------
    ConfigError
        If there is no world of that name.
    OutputError
        If `out` exists already or cannot be written.
    """
    simulation = Simulation(build_world(name, options), seed, options)
    return record(simulation, out, overwrite=overwrite, progress=progress)


def record(
    simulation: Simulation,
    out: Path | str,
    *,
    messages: Iterable[Message] | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Write the bag of a simulation with its truth.

    Parameters
    ----------
    simulation
        Simulation to record.
    out, overwrite, progress
        As in `simulate`.
    messages
        Messages to write instead of the simulation's own, for example with faults.

    Returns
    -------
    Path
        `out`.

    Raises
    ------
    OutputError
        If `out` exists already or cannot be written.
    """
    rig = simulation.rig
    periods = {rig.topics.scan: rig.level.period}
    if rig.tilt is not None:
        periods[rig.topics.tilt_scan] = rig.tilt.period
    with BagWriter(out, overwrite=overwrite) as bag:
        for topic, kind in _sensor_topics(simulation):
            bag.add_topic(topic + TRANSPORTS.get(kind, ""), WRITERS[kind][0], SENSOR)
        for message in simulation.run() if messages is None else messages:
            kind = type(message.records[0])
            topic = message.topic + TRANSPORTS.get(kind, "")
            fields = {"scan_time": periods[message.topic]} if kind is Scan else {}
            write_records(bag, topic, message.log_ns, *message.records, **fields)
            if progress is not None:
                fraction = (message.log_ns - simulation.start_ns) / simulation.duration_ns
                progress(min(fraction, 1.0))
        _write_truth(simulation, bag.folder)
    return Path(out)


def _sensor_topics(simulation: Simulation) -> Iterator[tuple[str, type]]:
    """Yield topics and records of the sensors."""
    rig, topics = simulation.rig, simulation.rig.topics
    if rig.tilt is not None:
        yield topics.tilt_scan, Scan
    yield topics.scan, Scan
    if rig.camera is not None:
        yield topics.depth, DepthImage
        yield topics.camera_info, CameraInfo
    if rig.colour_camera is not None:
        yield topics.colour, CameraImage
        yield topics.colour_info, CameraInfo
    if rig.lidar is not None:
        yield topics.points, PointCloud
    if rig.imu is not None:
        yield topics.imu, Imu


def _write_truth(simulation: Simulation, folder: Path) -> None:
    for name, content in (
        ("truth.json", truth.surfaces(simulation)),
        ("truth_walls.json", truth.walls(simulation)),
    ):
        (folder / name).write_text(json.dumps(content) + "\n", encoding="utf-8")
    lines = "\n".join(truth.trajectory(simulation))
    (folder / "truth.tum").write_text(lines + "\n", encoding="utf-8")
