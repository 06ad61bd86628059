"""Detections of objects at their true positions, as messages and in copies of bags."""

import json
from pathlib import Path

import numpy as np

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.geometry import inverse, pose_from_quaternion, transform
from tccm_ros.ros.types import header_message, pose_message

TYPES = TypestoreMessages()
VISION = "vision_msgs/msg/"
ARRAY = VISION + "Detection3DArray"


def detection(types, center, results, size=(0.1, 0.1, 0.1), frame_id=""):
    """Return a Detection3D; `results` are (class, score)."""
    T = np.eye(4)
    T[:3, 3] = center
    x, y, z = map(float, size)
    return types.make(
        VISION + "Detection3D",
        header=header_message(types, 0, frame_id),
        results=[
            types.make(
                VISION + "ObjectHypothesisWithPose",
                hypothesis=types.make(VISION + "ObjectHypothesis", class_id=c, score=s),
            )
            for c, s in results
        ],
        bbox=types.make(
            VISION + "BoundingBox3D",
            center=pose_message(types, T),
            size=types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
        ),
    )


def array_message(types, stamp_ns, frame_id, detections):
    header = header_message(types, stamp_ns, frame_id)
    return types.make(ARRAY, header=header, detections=list(detections))


def true_objects(bag: Path) -> dict[str, np.ndarray]:
    """Return the middles of a bundled bag's objects in the world, by name."""
    truth = json.loads((bag / "truth.json").read_text())
    return {item["name"]: np.array(item["center"]) for item in truth["objects"]}


def true_poses(bag: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps in ns and T_world_base (N, 4, 4)."""
    rows = [line.split() for line in (bag / "truth.tum").read_text().splitlines()]
    stamps = [int(s) * 10**9 + int(n) for s, n in (row[0].split(".") for row in rows)]
    numbers = np.array([row[1:] for row in rows], float)
    return np.array(stamps), np.array([pose_from_quaternion(r[:3], r[3:]) for r in numbers])


def write_with_detections(bag: Path, path: Path, messages, topic="/detections") -> Path:
    """Copy a bag with further messages [(log time, message)] of detections."""
    added = sorted(messages, key=lambda item: item[0])
    with BagReader(bag) as reader, BagWriter(path) as writer:
        kinds = {info.name: info.msgtype for info in reader.topics()}
        for message in reader.messages(list(kinds)):
            while added and added[0][0] <= message.log_ns:
                log_ns, extra = added.pop(0)
                writer.write(topic, ARRAY, log_ns, extra)
            writer.write(message.topic, kinds[message.topic], message.log_ns, message.data)
        for log_ns, extra in added:
            writer.write(topic, ARRAY, log_ns, extra)
    return path


def seen_from_base(bag: Path, classes, every=25, frame_id="base_footprint"):
    """Yield detection messages of a perfect recogniser in the base frame.

    Parameters
    ----------
    bag
        A bundled bag with its truth.
    classes
        (class, score) pairs by the name of the object.
    every
        Number of true poses for each message.
    frame_id
        Frame of the base.
    """
    objects = true_objects(bag)
    for stamp_ns, T in zip(*(values[::every] for values in true_poses(bag))):
        found = [
            detection(TYPES, transform(inverse(T), objects[name][None])[0], results)
            for name, results in classes.items()
        ]
        yield int(stamp_ns), array_message(TYPES, int(stamp_ns), frame_id, found)
