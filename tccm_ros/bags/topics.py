"""Assign the topics of a bag to roles: by name, else by type.

If a sensor's topic is not in the bag, topics of its type are candidates. A single candidate is
taken and reported; several are an error with advice.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from tccm_ros.bags.depth_topics import (
    DepthTopic,
    calibration_topic,
    depth_topics,
    first_message,
    first_messages,
)
from tccm_ros.bags.offered_qos import LATCHED
from tccm_ros.bags.reader import CDR, DEFAULT_TOPICS, BagReader, remap_topics
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.config import Config
from tccm_ros.errors import FrameError, MessageError, TccmError, TopicError, UrdfError
from tccm_ros.records import CameraImage, DepthImage, PointCloud, Scan
from tccm_ros.records.building import frame_name
from tccm_ros.robot import MountKind, Robot, Stream
from tccm_ros.ros.reading import READERS
from tccm_ros.sensors.camera_image import (
    CHANNELS,
    COMPRESSED_PICTURE_READER,
    PICTURE_READER,
    camera_stream,
)
from tccm_ros.sensors.cloud_messages import CLOUD_READER, point_cloud_from_message
from tccm_ros.sensors.compressed_depth import is_depth_format
from tccm_ros.sensors.depth_image import camera_info_topic, depth_reader
from tccm_ros.sensors.depth_messages import (
    CAMERA_INFO_READER,
    COMPRESSED_READER,
    IMAGE_READER,
)
from tccm_ros.sensors.laser_scan import TILT_SCAN, scan_stream
from tccm_ros.sensors.registry import default_streams

MAX_READ_NS = 5_000_000_000
"""Part of a bag that is read to find the laser moved by a joint, ns. Chosen: a few tilt cycles."""

ROBOT_ROLES = ("odom", "joint_states")
"""Roles of the robot itself: assigned by type if there is exactly one topic of that type."""

OF_FRAMES = ("odom", "robot_description", "tf", "tf_static")
"""Roles that define frames: without any of them, a level laser or a lidar is the base."""

LASER = READERS["scan"].message_type

SETTINGS = {
    (Scan, MountKind.TILTING): "sensors.tilt_scans",
    (DepthImage, MountKind.ANY): "sensors.depth_images",
    (PointCloud, MountKind.ANY): "sensors.point_clouds",
}
"""Setting with the topics, by kind of sensor."""


@dataclass(slots=True)
class TopicChoice:
    """The topics of a replay.

    Attributes
    ----------
    topics
        Topics by role, including those that are not in the bag.
    streams
        Streams of the sensors, with readers for the types of their topics.
    found, found_roles
        One line for each topic assigned by its type, and its role.
    named
        Roles whose topic the user set.
    counts
        Number of readable messages, by role.
    unread
        Number of messages that cannot be read, by reason.
    doubts
        Candidate topics by role, if there are several.
    """

    topics: dict[str, str]
    streams: tuple[Stream, ...]
    found: list[str] = field(default_factory=list)
    found_roles: list[str] = field(default_factory=list)
    named: frozenset[str] = frozenset()
    counts: dict[str, int] = field(default_factory=dict)
    unread: Counter[str] = field(default_factory=Counter)
    doubts: dict[str, list[str]] = field(default_factory=dict)

    @property
    def notes(self) -> list[str]:
        """Lines for a user: topics assigned by type, and messages that cannot be read."""
        unread = (f"{why}: {n} messages are not read" for why, n in self.unread.items())
        return [*self.found, *unread]

    def doubt_lines(self) -> list[str]:
        """Return a line for each role with several candidate topics."""
        lines = []
        for role, candidates in self.doubts.items():
            names = " or ".join(f"--remap {role}:={topic}" for topic in candidates)
            stream = next(stream for stream in self.streams if stream.role == role)
            setting = SETTINGS.get((stream.record, stream.mount))
            off = f", or --set {setting}=[] to use none" if setting else ""
            lines.append(
                f"no topic {self.topics[role]}, and several could be meant; use {names}{off}"
            )
        return lines

    @property
    def is_bare(self) -> bool:
        """Whether the bag has no readable frames or odometry."""
        return not any(self.counts[role] for role in OF_FRAMES)

    @property
    def readers(self) -> dict[str, MessageReader]:
        """Readers of the streams and their companions, by role."""
        readers = {stream.role: stream.reader for stream in self.streams}
        for stream in self.streams:
            if stream.companion is not None:
                readers[stream.companion.role] = stream.companion.reader
        return readers


def choose_topics(
    reader: BagReader, config: Config, remap: Sequence[str] = (), *, may_doubt: bool = False
) -> TopicChoice:
    """Return the topics of a replay.

    Parameters
    ----------
    reader
        The bag.
    config
        Group `sensors`, which names the topics.
    remap
        Remappings such as ``scan:=/base_scan``.
    may_doubt
        Whether several candidates go into `TopicChoice.doubts` instead of raising an error.

    Raises
    ------
    TopicError
        If a remapping is invalid, or a role has several candidates.
    """
    streams = default_streams(config)
    defaults = {role: DEFAULT_TOPICS[role] for role in _robot_inputs()}
    for stream in streams:
        defaults[stream.role] = _absolute(stream.role)
        if stream.companion is not None:
            defaults[stream.companion.role] = _absolute(stream.companion.role)
    topics = remap_topics(remap, defaults)
    given = {entry.partition(":=")[0].strip().lstrip("/") for entry in remap}
    named = frozenset(role for role, topic in topics.items() if topic != defaults[role]) | given
    choice = TopicChoice(topics, streams, named=named)
    for stream in streams:  # use the calibration next to the image that the user set
        companion = stream.companion
        if companion is not None and stream.role in named and companion.role not in named:
            topics[companion.role] = camera_info_topic(topics[stream.role])
    search = _Search(reader, choice)
    search.find_robot()
    search.find_lasers(config)
    search.find_depth_images(config)
    search.find_clouds(config)
    search.find_pictures(config)
    for doubt in () if may_doubt else choice.doubt_lines():
        raise TopicError(f"{reader.path}: {doubt}")
    choice.streams = tuple(search.with_reader(stream) for stream in streams)
    _count_messages(reader, choice)
    return choice


def _count_messages(reader: BagReader, choice: TopicChoice) -> None:
    """Count the readable and unreadable messages of each role."""
    readers = {**READERS, **choice.readers}
    for role, topic in choice.topics.items():
        choice.counts[role] = 0
        for info in reader.topics():
            if info.name != topic or not info.count:
                continue
            why = info.why_not_read(readers[role].message_type)
            if why:
                choice.unread[why] += info.count
            else:
                choice.counts[role] += info.count


def picture_topics(reader: BagReader) -> list[str]:
    """Return the topics of pictures in a bag.

    Compressed pictures of a camera are returned only if it has no uncompressed ones.
    """
    plain, compressed = [], []
    kinds = PICTURE_READER.message_type, COMPRESSED_PICTURE_READER.message_type
    for topic, message in first_messages(reader, *kinds):
        if topic.msgtype == PICTURE_READER.message_type:
            if str(message.encoding) in CHANNELS:
                plain.append(topic.name)
        else:
            text = str(message.format)
            if not is_depth_format(text, message.data) and ("jpeg" in text or "png" in text):
                compressed.append(topic.name)
    return plain + [name for name in compressed if name.removesuffix("/compressed") not in plain]


class _Search:
    """Finds topics by type and enters them into a choice."""

    def __init__(self, reader: BagReader, choice: TopicChoice) -> None:
        self._reader = reader
        self._choice = choice
        self._names: dict[str, list[str]] = defaultdict(list)
        """Topics with readable messages, by type."""
        for info in reader.topics():
            if info.count and info.encoding == CDR:
                self._names[info.msgtype].append(info.name)
        self._depth: list[DepthTopic] = []

    def with_reader(self, stream: Stream) -> Stream:
        """Return a stream with a reader for the type of its topic."""
        topic = self._choice.topics[stream.role]
        kinds = [kind for kind in _types_of(stream) if topic in self._names[kind]]
        if stream.companion is None or not kinds:
            return stream
        compressed = kinds[0] == COMPRESSED_READER.message_type
        if stream.record is CameraImage:
            return replace(stream, reader=camera_stream(stream.role, compressed=compressed).reader)
        return replace(stream, reader=depth_reader(topic, compressed=compressed))

    def _accepted(self, role: str) -> tuple[str, ...]:
        """Return the types of messages that a role can read."""
        for stream in self._choice.streams:
            if stream.role == role:
                return _types_of(stream)
        return ((self._choice.readers.get(role) or READERS[role]).message_type,)

    def _is_absent(self, role: str) -> bool:
        topic = self._choice.topics[role]
        return role not in self._choice.named and not any(
            topic in self._names[kind] for kind in self._accepted(role)
        )

    def _free(self, msgtype: str) -> list[str]:
        """Return the topics of a type that are not assigned to a role for this type."""
        topics = self._choice.topics
        taken = {topic for role, topic in topics.items() if msgtype in self._accepted(role)}
        return [name for name in self._names[msgtype] if name not in taken]

    def _take(self, role: str, topic: str, what: str) -> None:
        self._choice.topics[role] = topic
        self._choice.found.append(f"{topic} is taken for {role}: {what}")
        self._choice.found_roles.append(role)

    def _take_only(self, role: str, candidates: Sequence[str], what: str) -> None:
        """Assign the only candidate; record several as doubts."""
        if len(candidates) > 1:
            self._choice.doubts[role] = list(candidates)
        elif candidates:
            self._take(role, candidates[0], what)

    def find_robot(self) -> None:
        """Assign odometry and joint states if there is exactly one topic of each type."""
        for role in ROBOT_ROLES:
            free = self._free(READERS[role].message_type) if self._is_absent(role) else []
            if len(free) == 1:
                self._take(role, free[0], "the only one of its type")

    def find_lasers(self, config: Config) -> None:
        """Assign a laser moved by a joint, and one that is not moved."""
        tilting = config.sensors.tilt_scans[:1]
        level = ["scan"] if config.sensors.level_from == "none" else []
        roles = [role for role in (*tilting, *level) if self._is_absent(role)]
        lasers = self._free(LASER)
        if not roles or not lasers:
            return
        moved = tilting_lasers(self._reader, lasers, self._choice.topics, config)
        for role in roles:
            is_tilting = role in tilting
            fits = [name for name in lasers if (name in moved) == is_tilting]
            what = "the only laser that a joint moves" if is_tilting else "the only level laser"
            self._take_only(role, fits, what)

    def find_depth_images(self, config: Config) -> None:
        """Assign the only depth image with a calibration."""
        roles, found = config.sensors.depth_images, self._choice
        if not roles:
            return
        if not all(self._is_absent(role) for role in roles):
            by_topic = {found.topics[role]: role for role in roles}
            self._depth = [d for d in depth_topics(self._reader) if d.topic in by_topic]
            for image in self._depth:
                self._take_calibration(camera_info_topic(by_topic[image.topic]), image)
            return
        images = [d for d in depth_topics(self._reader) if calibration_topic(self._reader, d)]
        self._take_only(
            roles[0],
            [image.topic for image in images],
            "the only depth image with a camera_info",
        )
        self._depth = images
        for image in images if len(images) == 1 else ():
            self._take_calibration(camera_info_topic(roles[0]), image)

    def _take_calibration(self, role: str, image: DepthTopic) -> None:
        """Assign the calibration of an image; report it if it is not next to the image."""
        topic, beside = calibration_topic(self._reader, image), camera_info_topic(image.topic)
        if role in self._choice.named or topic is None:
            return
        self._choice.topics[role] = topic
        if topic != beside:
            self._take(role, topic, f"the only camera info of the frame '{image.frame_id}'")

    def find_clouds(self, config: Config) -> None:
        """Assign the only point cloud; ignore clouds in a depth image's frame, computed from it."""
        roles = config.sensors.point_clouds
        if not roles or not all(self._is_absent(role) for role in roles):
            return
        frames = {image.frame_id for image in self._depth}
        frames |= {config.frames.map_name, config.frames.odom_name}
        clouds = [
            topic
            for topic in self._free(CLOUD_READER.message_type)
            if self._cloud_frame(topic) not in (None, *frames)
        ]
        self._take_only(roles[0], clouds, "the only point cloud")

    def find_pictures(self, config: Config) -> None:
        """Assign the only picture topic with a calibration next to it, raw or compressed.

        Several candidates are reported but are not an error, because a map needs no signs.
        """
        roles = config.sensors.camera_images if config.signs.enabled else ()
        if not roles or not all(self._is_absent(role) for role in roles):
            return
        found = [
            topic
            for topic in picture_topics(self._reader)
            if camera_info_topic(topic) in self._names[CAMERA_INFO_READER.message_type]
        ]
        if len(found) > 1:
            names = " or ".join(f"--remap {roles[0]}:={topic}" for topic in found)
            self._choice.found.append(f"door signs are not looked for, unless you add {names}")
        elif found:
            self._take(roles[0], found[0], "the only pictures with a camera_info")
            self._choice.topics[camera_info_topic(roles[0])] = camera_info_topic(found[0])

    def _cloud_frame(self, topic: str) -> str | None:
        """Return the frame of a point cloud; None if it has no points."""
        message = first_message(self._reader, topic, CLOUD_READER.message_type)
        if message is None:
            return None
        with suppress(MessageError):
            return point_cloud_from_message(message).frame_id
        return None


def _types_of(stream: Stream) -> tuple[str, ...]:
    """Return the message types that a sensor's topic may have."""
    if stream.companion is None:
        return (stream.reader.message_type,)
    return IMAGE_READER.message_type, COMPRESSED_READER.message_type


def tilting_lasers(
    reader: BagReader, lasers: Sequence[str], topics: Mapping[str, str], config: Config
) -> set[str]:
    """Return the laser topics whose sensor is moved by a joint relative to the base.

    Only the first seconds of the bag are read.

    Parameters
    ----------
    reader
        The bag.
    lasers
        Topics of laser scans.
    topics
        Topics of the robot's frames and joints, by role.
    config
        Groups ``frames``, ``rig`` and ``scan``.
    """
    robot = Robot(config, (scan_stream(TILT_SCAN, config),))
    robot_is_described(reader, topics, robot)
    tilts = set()
    for laser in lasers:
        message = first_message(reader, laser, LASER)
        if message is None:
            continue
        with suppress(FrameError):
            frame = frame_name(message.header.frame_id)
            robot.sensors[TILT_SCAN.role].mount.find(frame, final=True)
            tilts.add(laser)
    return tilts


def add_latched(reader: BagReader, topics: Mapping[str, str], robot: Robot) -> None:
    """Give a robot the first description and static transforms of a bag: they hold at any time.

    Refusals are not counted, since all records are given to the robot again.

    Parameters
    ----------
    reader
        The bag.
    topics
        Topics by role.
    robot
        Receives the records.
    """
    known = set()
    with suppress(TccmError):  # the replay itself reports damage
        for role, _, record in reader.records({role: topics[role] for role in LATCHED}):
            what = role, getattr(record, "child", "")
            if what not in known:
                known.add(what)
                with suppress(UrdfError):
                    robot.add(role, record)
    robot.refused.clear()
    reader.dropped.clear()


def robot_is_described(reader: BagReader, topics: Mapping[str, str], robot: Robot) -> bool:
    """Feed a robot with the frames of a bag, and with the joints in its first seconds.

    Parameters
    ----------
    reader
        The bag.
    topics
        Topics by role.
    robot
        Receives the records of the robot's own topics.

    Returns
    -------
    bool
        Whether the bag has a robot description or tf.
    """
    add_latched(reader, topics, robot)
    moving = set(_robot_inputs()) - set(LATCHED)
    of_robot = {role: topic for role, topic in topics.items() if role in moving}
    with suppress(TccmError):  # the replay itself reports damage and wrong types
        for role, log_ns, record in reader.records(of_robot):
            if log_ns - reader.start_ns > MAX_READ_NS:
                break
            robot.add(role, record)
    robot.flush()
    return robot.frames.model is not None or bool(robot.frames.tf)


def sensor_is_base(topic: str, record: type) -> str:
    """Return a line about how a laser or lidar without frames is mapped."""
    sensor, scans = ("laser", "its scans") if record is Scan else ("sensor", "level scans of it")
    return (
        f"{topic} without frames and odometry: the {sensor} is the base, and moves as matching of "
        f"{scans} says"
    )


def with_level_scans(config: Config, choice: TopicChoice) -> Config:
    """Return the configuration; if a point cloud is the only input, level scans are made of it."""
    sensors = [s for s in choice.streams if choice.counts[s.role] and not s.is_occasional]
    is_alone = [sensor.record for sensor in sensors] == [PointCloud]
    if not (choice.is_bare and is_alone) or config.sensors.level_from != "none":
        return config
    made = config.model_copy(deep=True)
    made.sensors.level_from = "points"
    made.sensors.point_clouds = (sensors[0].role,)
    return made


def _robot_inputs() -> Iterator[str]:
    sensors = {stream.role for stream in default_streams()}
    return (role for role in DEFAULT_TOPICS if role not in sensors)


def _absolute(topic: str) -> str:
    return "/" + topic.lstrip("/")
