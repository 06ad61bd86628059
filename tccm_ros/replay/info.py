"""`tccm info`: the topics of a bag, and the inputs that a replay of it would lack."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tccm_ros.bags.depth_topics import (
    INFO,
    calibration_topic,
    depth_topics,
    first_message,
    unreadable_topics,
)
from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader, TopicInfo
from tccm_ros.bags.topics import (
    TopicChoice,
    choose_topics,
    laser_is_base,
    robot_is_described,
)
from tccm_ros.config import Config
from tccm_ros.errors import FrameError, MessageError, TopicError
from tccm_ros.records import DepthImage, PointCloud
from tccm_ros.robot import MountKind, Robot
from tccm_ros.sensors.camera_rays import has_known_lens
from tccm_ros.sensors.depth_image import camera_info_topic, is_rectified
from tccm_ros.sensors.depth_messages import camera_info_from_message

CONSEQUENCES = {
    "tilt_scan": "no surfaces",
    "scan": "no walls, the poses are those of odometry",
    "joint_states": "tf must give the pose of the tilting laser",
    "odom": "from tf, or the base is assumed not to move",
    "robot_description": "tf or rig parameters must give the poses of the lasers",
    "tf": "",
    "tf_static": "",
}
"""What follows where an input is missing, by role."""

OF_FRAMES = ("odom", "robot_description", "tf", "tf_static")
"""Roles that tell of frames; a level laser without any of them is the base."""


@dataclass(frozen=True, slots=True)
class BagInfo:
    """Topics of a bag, and the inputs of a replay that it lacks.

    Attributes
    ----------
    path
        The bag.
    duration
        s.
    topics
        In the order of their names.
    notes
        One line for each input of a replay that is missing or cannot be used, for each topic that a
        replay takes by its type, and for what it cannot choose between.
    """

    path: Path
    duration: float
    topics: list[TopicInfo]
    notes: list[str]

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain data."""
        topics = [{"name": t.name, "type": t.msgtype, "count": t.count} for t in self.topics]
        return {"duration": self.duration, "topics": topics, "notes": self.notes}

    def text(self) -> str:
        """Return a table for a terminal."""
        width = max((len(topic.name) for topic in self.topics), default=0)
        rows = [f"{t.name:<{width}}  {t.count:>8}  {t.msgtype}" for t in self.topics]
        return "\n".join([f"{self.path}: {self.duration:.1f} s", *rows, *self.notes])


def bag_info(path: Path | str) -> BagInfo:
    """Read the topics of a bag.

    Messages are read only where a topic has another name than usual, and only those of the first
    seconds; of images and their calibrations the first.

    Raises
    ------
    BagError
        If the bag is missing, empty or damaged.
    """
    with BagReader(path) as reader:
        return BagInfo(Path(path), reader.duration, reader.topics(), _notes(reader))


def _notes(reader: BagReader) -> list[str]:
    """Return a line for each missing input and each topic taken, and the remappings to try."""
    config = Config()
    try:
        choice = choose_topics(reader, config)
    except TopicError as error:
        choice = choose_topics(reader, _without_search(config))
        doubt = [str(error).removeprefix(f"{reader.path}: ")]
    else:
        doubt = []
    counts = choice.counts
    has_points = any(
        counts[stream.role]
        for stream in choice.streams
        if stream.mount is MountKind.ANY and not stream.is_occasional
    )
    is_bare = counts["scan"] > 0 and not any(counts[role] for role in OF_FRAMES)
    notes = [laser_is_base(choice.topics["scan"])] if is_bare else []
    for role, consequence in CONSEQUENCES.items():
        if is_bare and role in OF_FRAMES:
            continue
        if consequence and not counts[role] and not (has_points and role == "tilt_scan"):
            notes.append(f"no {DEFAULT_TOPICS[role]}: {consequence}")
    if has_points and not counts["scan"]:
        kinds = {s.record: s for s in choice.streams if counts[s.role]}
        source = "points" if PointCloud in kinds else "depth"
        notes.append(f"--set sensors.level_from={source} makes level scans for walls")
    notes += _faults_of_cameras(reader, choice)
    images = {choice.topics[s.role] for s in choice.streams if s.record is DepthImage}
    notes += unreadable_topics(reader, images)
    notes += [*choice.notes, *doubt]
    order = [*DEFAULT_TOPICS, *choice.topics]
    remaps = {role: choice.topics[role] for role in sorted(choice.found_roles, key=order.index)}
    if remaps:
        notes.append("try " + " ".join(f"--remap {role}:={t}" for role, t in remaps.items()))
    return notes


def _without_search(config: Config) -> Config:
    """Return a configuration with which no topic is looked for by its type but odometry's."""
    made = config.model_copy(deep=True)
    made.sensors.depth_images = made.sensors.point_clouds = ()
    made.sensors.level_from = "depth"  # a level laser is not looked for
    return made


def _faults_of_cameras(reader: BagReader, choice: TopicChoice) -> list[str]:
    """Return why depth images could not be used: calibration, size, or place on the robot."""
    notes, robot = [], Robot(Config(), choice.streams)
    described = robot_is_described(reader, choice.topics, robot)
    for image in depth_topics(reader):
        info = calibration_topic(reader, image)
        message = None if info is None else first_message(reader, info, INFO)
        if message is None:
            beside = camera_info_topic(image.topic)
            notes.append(f"{image.topic}: no {beside}: its images cannot be used")
            continue
        try:
            camera = camera_info_from_message(message)
        except MessageError as error:
            notes.append(f"{info}: {error}")
            continue
        if not (is_rectified(image.topic) or has_known_lens(camera)):
            notes.append(
                f"{info}: distortion model '{camera.model[:40]}' is not known, expected "
                "plumb_bob or rational_polynomial; take rectified images"
            )
        if image.size is not None and image.size != camera.image_size:
            (a, b), (c, d) = image.size, camera.image_size
            notes.append(f"{image.topic} has {a} x {b} pixels, {info} says {c} x {d}")
        mounts = [s.mount for s in robot.sensors.values() if s.stream.mount is MountKind.ANY]
        try:
            if described and mounts:
                mounts[0].find(image.frame_id, final=True)
        except FrameError as error:
            notes.append(f"{image.topic}: {error}")
    return notes
