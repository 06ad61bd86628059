"""`tccm info`: the topics of a bag, and the inputs missing for a replay."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from tccm_ros.bags.depth_topics import (
    INFO,
    calibration_topic,
    depth_topics,
    first_message,
    unreadable_topics,
)
from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader, TopicInfo
from tccm_ros.bags.topics import (
    MAX_READ_NS,
    OF_FRAMES,
    TopicChoice,
    choose_topics,
    robot_is_described,
    sensor_is_base,
    with_level_scans,
)
from tccm_ros.calibrate.beam_timing import read_beam_timing
from tccm_ros.calibrate.joint_timing import joint_timing
from tccm_ros.calibrate.level_geometry import level_scans_help
from tccm_ros.config import Config
from tccm_ros.errors import FrameError, MessageError, TccmError, UrdfError
from tccm_ros.records import DepthImage, PointCloud
from tccm_ros.records.building import frame_name
from tccm_ros.robot import MountKind, Robot, Stream
from tccm_ros.robot.urdf import read_urdf
from tccm_ros.sensors.camera_rays import has_known_lens
from tccm_ros.sensors.depth_image import camera_info_topic, is_rectified
from tccm_ros.sensors.depth_messages import camera_info_from_message

Estimate = TypeVar("Estimate")

CONSEQUENCES = {
    "tilt_scan": "no surfaces",
    "scan": "no walls, the poses are those of odometry",
    "joint_states": "tf must give the pose of the tilting laser",
    "odom": "from tf, or the base is assumed not to move",
    "robot_description": "tf or rig parameters must give the poses of the lasers",
    "tf": "",
    "tf_static": "",
}
"""Consequence of a missing input, by role."""


@dataclass(frozen=True, slots=True)
class BagInfo:
    """Topics of a bag, and notes about a replay of it.

    Attributes
    ----------
    path
        The bag.
    duration
        Duration, s.
    topics
        Topics, by name.
    notes
        One line for each input of a replay that is missing or unusable, for each topic assigned by
        type, and for each ambiguous choice.
    """

    path: Path
    duration: float
    topics: list[TopicInfo]
    notes: list[str]

    def to_json(self) -> dict[str, Any]:
        """Return the information as plain data."""
        topics = [{"name": t.name, "type": t.msgtype, "count": t.count} for t in self.topics]
        return {"duration": self.duration, "topics": topics, "notes": self.notes}

    def text(self) -> str:
        """Return the information as a table for a terminal."""
        width = max((len(topic.name) for topic in self.topics), default=0)
        rows = [f"{t.name:<{width}}  {t.count:>8}  {t.msgtype}" for t in self.topics]
        return "\n".join([f"{self.path}: {self.duration:.1f} s", *rows, *self.notes])


def bag_info(path: Path | str) -> BagInfo:
    """Read the topics of a bag.

    Messages are read only if a topic has an unusual name, and then only those of the first seconds;
    of images and calibrations only the first. Level scans and odometry of the first two minutes are
    read to estimate the times of the beams, and the first tilt cycles to compare the stamps of a
    tilting laser and its joint.

    Raises
    ------
    BagError
        If the bag is missing, empty or damaged.
    """
    with BagReader(path) as reader:
        notes = _notes(reader)
        duration, topics = reader.duration, reader.topics()
    return BagInfo(Path(path), duration, topics, [*_beam_notes(path), *notes])


def _or_none(estimate: Callable[[], Estimate]) -> Estimate | None:
    """Return an estimate; None after an error, which other notes or the replay report."""
    with suppress(TccmError):
        return estimate()
    return None


def _beam_notes(path: Path | str) -> list[str]:
    """Return advice if the level laser's beams were measured at other times than stamped."""
    timing = _or_none(lambda: read_beam_timing(path))
    return [timing.text()] if timing is not None and timing.is_significant else []


def _joint_notes(reader: BagReader, choice: TopicChoice, config: Config) -> list[str]:
    """Return a line if the stamps of the tilting laser and its joint contradict each other."""
    reader.add_readers(choice.readers)
    timing = _or_none(lambda: joint_timing(reader, choice, config))
    if timing is None or not timing.is_significant:
        return []
    return [f"{timing.text()}; a replay corrects that, nodes need it as a parameter"]


def _level_notes(path: Path | str, source: Literal["points", "depth"]) -> list[str]:
    """Return advice to make level scans of points or depths, if these reveal the robot's motion."""
    helps = _or_none(lambda: level_scans_help(path, source))
    return [f"--set sensors.level_from={source} makes level scans for walls"] if helps else []


def _notes(reader: BagReader) -> list[str]:
    """Return a line for each missing input and each assigned topic, and a suggested command."""
    config = Config()
    choice = choose_topics(reader, config, may_doubt=True)
    counts = choice.counts
    has_points = any(
        counts[stream.role]
        for stream in choice.streams
        if stream.mount is MountKind.ANY and not stream.is_occasional
    )
    is_alone = with_level_scans(config, choice) is not config
    notes = _places_of_sensors(reader, choice)
    notes += [
        sensor_is_base(choice.topics[stream.role], stream.record)
        for stream in choice.streams
        if choice.is_bare and counts[stream.role] and (stream.can_be_base or is_alone)
    ]
    is_bare = choice.is_bare and (counts["scan"] > 0 or is_alone)
    for role, consequence in CONSEQUENCES.items():
        if (is_bare and role in OF_FRAMES) or role in choice.doubts:
            continue
        if role == "joint_states" and not counts["tilt_scan"]:
            continue
        if consequence and not counts[role] and not (has_points and role == "tilt_scan"):
            notes.append(f"no {DEFAULT_TOPICS[role]}: {consequence}")
    if has_points and not counts["scan"] and not is_bare and "scan" not in choice.doubts:
        kinds = {s.record: s for s in choice.streams if counts[s.role]}
        notes += _level_notes(reader.path, "points" if PointCloud in kinds else "depth")
    notes += _faults_of_description(reader, choice.topics["robot_description"])
    notes += _faults_of_cameras(reader)
    images = {choice.topics[s.role] for s in choice.streams if s.record is DepthImage}
    notes += _joint_notes(reader, choice, config)
    said = "\n".join(notes)
    notes += [line for line in unreadable_topics(reader, images) if line not in said]
    notes += [*choice.notes, *choice.doubt_lines()]
    order = [*DEFAULT_TOPICS, *choice.topics]
    taken = {role: choice.topics[role] for role in choice.found_roles}
    taken |= {role: candidates[0] for role, candidates in choice.doubts.items()}
    remaps = [f"--remap {role}:={taken[role]}" for role in sorted(taken, key=order.index)]
    if any(counts[stream.role] for stream in choice.streams) or choice.doubts:
        notes.append(" ".join(["try tccm replay", reader.path, "--out map", *remaps]))
    return notes


def _places_of_sensors(reader: BagReader, choice: TopicChoice) -> list[str]:
    """Return a line for each sensor: its frame, and its base or the reason for having none."""
    notes, robot = [], Robot(Config(), choice.streams)
    described = robot_is_described(reader, choice.topics, robot)
    is_part = choice.counts["tf"] > 0 and reader.duration > MAX_READ_NS * 1e-9
    extent = f" (by the first {MAX_READ_NS * 1e-9:g} s of /tf)" if is_part else ""
    for stream in choice.streams:
        topic = choice.topics[stream.role]
        if not choice.counts[stream.role] or stream.is_occasional:
            continue
        message = first_message(reader, topic, stream.reader.message_type)
        if message is None:
            notes.append(f"{topic}: its first message is damaged")
            continue
        frame = frame_name(message.header.frame_id)
        mount = robot.sensors[stream.role].mount
        try:
            if described or stream.can_be_base:
                mount.find(frame, final=True)
        except FrameError as error:
            notes.append(f"{topic}: {error}{extent}")
            continue
        base = f"on base '{mount.base}'" if mount.base else "on no known base"
        notes.append(f"{stream.role}: {topic} in frame '{frame}' {base}")
        notes += [f"{topic}: {fault} (its first message)" for fault in _faults_of(stream, message)]
    return notes


def _faults_of(stream: Stream, message: Any) -> list[str]:
    """Return why a message of a sensor is dropped, or the remark on it."""
    try:
        records = stream.reader.of_message(message)
    except MessageError as error:
        return [str(error)]
    found = (stream.rejection_reason(record) or stream.remark(record) for record in records)
    return [fault for fault in found if fault is not None]


def _faults_of_description(reader: BagReader, topic: str) -> list[str]:
    """Return the faults of the robot description, or the reason why it cannot be read."""
    message = first_message(reader, topic, "std_msgs/msg/String")
    if message is None:
        return []
    try:
        faults = read_urdf(message.data).faults
    except UrdfError as error:
        return [f"{topic}: {error}"]
    return [f"{topic}: {fault}" for fault in faults]


def _faults_of_cameras(reader: BagReader) -> list[str]:
    """Return the reasons why depth images cannot be used: calibration or size."""
    notes = []
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
    return notes
