"""Write the messages of a simulation to a bag, with the ground truth beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter, Qos
from tccm_ros.records import (
    CameraImage,
    CameraInfo,
    DepthImage,
    Imu,
    JointSample,
    Odometry,
    PointCloud,
    RobotDescription,
    Scan,
)
from tccm_ros.ros.writing import (
    camera_image_message,
    camera_info_message,
    compressed_depth_message,
    imu_message,
    joint_sample_message,
    odometry_message,
    point_cloud_message,
    robot_description_message,
    scan_message,
    transforms_message,
)
from tccm_sim import truth
from tccm_sim.engine import Message, Simulation
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

Progress = Callable[[float], None]

SENSOR = Qos(reliable=False, depth=5)
"""QoS of scans, the sensor data profile of drivers."""

COMPRESSED = "sensor_msgs/msg/CompressedImage"

WRITERS: dict[type, tuple[str, Callable[..., Any]]] = {
    JointSample: ("sensor_msgs/msg/JointState", joint_sample_message),
    Imu: ("sensor_msgs/msg/Imu", imu_message),
    Odometry: ("nav_msgs/msg/Odometry", odometry_message),
    RobotDescription: ("std_msgs/msg/String", robot_description_message),
    CameraInfo: ("sensor_msgs/msg/CameraInfo", camera_info_message),
    CameraImage: (COMPRESSED, camera_image_message),
    DepthImage: (COMPRESSED, compressed_depth_message),
    PointCloud: ("sensor_msgs/msg/PointCloud2", point_cloud_message),
}
"""Message type and writer by type of record."""

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
    types = TypestoreMessages()
    with BagWriter(out, overwrite=overwrite, typestore=types) as bag:
        for topic, msgtype in _sensor_topics(simulation):
            bag.add_topic(topic, msgtype, SENSOR)
        for message in simulation.run() if messages is None else messages:
            msgtype, content = _message(types, message, simulation)
            topic = message.topic + TRANSPORTS.get(type(message.records[0]), "")
            bag.write(topic, msgtype, message.log_ns, content)
            if progress is not None:
                fraction = (message.log_ns - simulation.start_ns) / simulation.duration_ns
                progress(min(fraction, 1.0))
        _write_truth(simulation, bag.folder)
    return Path(out)


def _sensor_topics(simulation: Simulation) -> Iterator[tuple[str, str]]:
    """Yield topics and types of the sensor messages."""
    rig, topics = simulation.rig, simulation.rig.topics
    if rig.tilt is not None:
        yield topics.tilt_scan, "sensor_msgs/msg/LaserScan"
    yield topics.scan, "sensor_msgs/msg/LaserScan"
    if rig.camera is not None:
        yield topics.depth + "/compressedDepth", COMPRESSED
        yield topics.camera_info, "sensor_msgs/msg/CameraInfo"
    if rig.colour_camera is not None:
        yield topics.colour + "/compressed", COMPRESSED
        yield topics.colour_info, "sensor_msgs/msg/CameraInfo"
    if rig.lidar is not None:
        yield topics.points, "sensor_msgs/msg/PointCloud2"
    if rig.gyro is not None:
        yield topics.imu, "sensor_msgs/msg/Imu"


def _message(types: TypestoreMessages, message: Message, simulation: Simulation) -> (
    tuple[str, Any]
):  # fmt: skip
    """Return the type and the content of a simulated message."""
    record = message.records[0]
    if isinstance(record, Scan):
        tilt = simulation.rig.tilt
        is_tilt = message.topic == simulation.rig.topics.tilt_scan
        period = (tilt if tilt is not None and is_tilt else simulation.rig.level).period
        return "sensor_msgs/msg/LaserScan", scan_message(types, record, scan_time=period)
    for kind, (msgtype, write) in WRITERS.items():
        if isinstance(record, kind):
            return msgtype, write(types, record)
    return "tf2_msgs/msg/TFMessage", transforms_message(types, message.transforms)


def _write_truth(simulation: Simulation, folder: Path) -> None:
    for name, content in (
        ("truth.json", truth.surfaces(simulation)),
        ("truth_walls.json", truth.walls(simulation)),
    ):
        (folder / name).write_text(json.dumps(content) + "\n", encoding="utf-8")
    lines = "\n".join(truth.trajectory(simulation))
    (folder / "truth.tum").write_text(lines + "\n", encoding="utf-8")
