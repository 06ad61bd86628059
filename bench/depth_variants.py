"""Variants of a recording of a depth camera, to see what a map owes to one recording.

    python bench/depth_variants.py BAG OUT {mirrored,halved,coarse,noisy}

mirrored: left and right exchanged, in images and poses; halved: every second image; coarse: every
second pixel; noisy: Gaussian noise of 1.5 mm + 2.5 mm/m2 z2 on each depth. BAG has 16UC1 images,
/odom, and /joint_states with the head's roll as third joint, as the recordings of real rooms.
truth.json and up.npz beside it, for the score of real rooms, are written as well.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_JAZZY)
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"


def pixels(image: Any) -> np.ndarray:
    return np.frombuffer(bytes(image.data), np.uint16).reshape(image.height, image.width)


def set_pixels(image: Any, depth: np.ndarray) -> None:
    image.height, image.width = depth.shape
    image.step = 2 * image.width
    image.data = np.ascontiguousarray(depth, np.uint16).view(np.uint8).reshape(-1)


def mirror(message: Any) -> None:
    kind = message.__msgtype__
    if kind == IMAGE:
        set_pixels(message, pixels(message)[:, ::-1])
    elif kind == INFO:
        for matrix in ("k", "p"):
            changed = getattr(message, matrix).copy()
            changed[2] = message.width - 1 - changed[2]
            setattr(message, matrix, changed)
    elif kind == "nav_msgs/msg/Odometry":
        pose, twist = message.pose.pose, message.twist.twist
        pose.position.y, pose.orientation.z = -pose.position.y, -pose.orientation.z
        twist.linear.y, twist.angular.z = -twist.linear.y, -twist.angular.z
    elif kind == "sensor_msgs/msg/JointState":
        message.position = message.position * [1.0, 1.0, -1.0]


def coarsen(message: Any) -> None:
    if message.__msgtype__ == IMAGE:
        set_pixels(message, pixels(message)[::2, ::2])
    elif message.__msgtype__ == INFO:
        message.k, message.p = message.k / 2.0, message.p / 2.0
        message.k[8] = message.p[10] = 1.0
        message.height, message.width = (message.height + 1) // 2, (message.width + 1) // 2


def add_noise(message: Any, rng: np.random.Generator) -> None:
    if message.__msgtype__ == IMAGE:
        depth = pixels(message).astype(float)
        sigma = 1.5 + 2.5 * (0.001 * depth) ** 2
        noisy = np.where(depth > 0.0, depth + sigma * rng.normal(size=depth.shape), 0.0)
        set_pixels(message, noisy.clip(0.0, 65535.0))


def variant(bag: Path, kind: str) -> Iterator[tuple[Any, int, Any]]:
    """Yield connection, log time and message of the variant."""
    rng, stamps = np.random.default_rng(0), {}
    with Reader(bag) as reader:
        for connection, time, raw in reader.messages():
            message = TYPES.deserialize_cdr(raw, connection.msgtype)
            if kind == "mirrored":
                mirror(message)
            elif kind == "coarse":
                coarsen(message)
            elif kind == "noisy":
                add_noise(message, rng)
            elif connection.msgtype in (IMAGE, INFO):
                stamp = message.header.stamp.sec, message.header.stamp.nanosec
                if stamps.setdefault(stamp, len(stamps)) % 2:
                    continue
            yield connection, time, message


def write_truth(bag: Path, out: Path, is_mirrored: bool) -> None:
    """Write the truth files of the score of real rooms, if there are any."""
    if not (bag / "truth.json").exists():
        return
    sign = np.array([1.0, -1.0 if is_mirrored else 1.0])
    truth = json.loads((bag / "truth.json").read_text())
    for surface in truth["surfaces"]:
        ring = np.array(surface["boundary"])
        surface["boundary"] = (ring * sign)[:: int(sign[1])].tolist()
    (out / "truth.json").write_text(json.dumps(truth))
    clouds = np.load(bag / "up.npz")
    np.savez(out / "up.npz", **{name: clouds[name] * [*sign, 1.0] for name in clouds})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("kind", choices=("mirrored", "halved", "coarse", "noisy"))
    arguments = parser.parse_args()
    shutil.rmtree(arguments.out, ignore_errors=True)
    writer = Writer(arguments.out, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    topics: dict[str, Any] = {}
    with writer:
        for connection, time, message in variant(arguments.bag, arguments.kind):
            topic, kind = connection.topic, connection.msgtype
            if topic not in topics:
                topics[topic] = writer.add_connection(
                    topic, kind, typestore=TYPES,
                    offered_qos_profiles=connection.ext.offered_qos_profiles,
                )  # fmt: skip
            writer.write(topics[topic], time, TYPES.serialize_cdr(message, kind))
    write_truth(arguments.bag, arguments.out, arguments.kind == "mirrored")


if __name__ == "__main__":
    main()
