"""Read bags: rosbag2 folders and single files, mcap and sqlite3, in log order.

Messages are decoded with the definitions of ROS 2 Jazzy, never with code generated from the bag.
Messages that cannot be decoded, or that no processor can use, are skipped and counted in
`BagReader.dropped`. Damage of the storage ends the reading with a BagError, after all messages
before it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from heapq import merge
from operator import attrgetter
from pathlib import Path
from typing import Any

from tccm_ros.bags.bag_files import storage_paths, unpacked
from tccm_ros.bags.offered_qos import Qos, qos_of_publishers
from tccm_ros.bags.storage import BagMessage, StorageFile, StoredTopic
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.errors import BagError, MessageError, TopicError, one_line, suggest
from tccm_ros.ros.reading import READERS

DEFAULT_TOPICS: Mapping[str, str] = {
    "tilt_scan": "/tilt_scan",
    "joint_states": "/joint_states",
    "odom": "/odom",
    "imu": "/imu",
    "external_pose": "/external_pose",
    "scan": "/scan",
    "robot_description": "/robot_description",
    "tf": "/tf",
    "tf_static": "/tf_static",
}
"""Default topic of each role (docs/reference/files.md, 'Recordings')."""

CDR, ROS1 = "cdr", "ros1"
"""Message encodings: ROS 2's, and that of converted recordings with original ROS 1 messages."""

FROM_ROS1 = "convert the original .bag: rosbags-convert --src FILE.bag --dst FOLDER"

BagPaths = Path | str | Sequence[Path | str]
"""A recording: one bag, or several that are read as one recording."""


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a bag, with its messages of one type.

    Attributes
    ----------
    name, msgtype
        Names.
    count
        Number of messages.
    encoding
        Encoding of the messages; only ``cdr`` can be decoded.
    """

    name: str
    msgtype: str
    count: int
    encoding: str = CDR

    def why_not_read(self, expected: str) -> str:
        """Return why a role cannot read these messages; empty if it can.

        Parameters
        ----------
        expected
            Message type of the role.
        """
        if self.encoding.startswith(ROS1):
            return f"{self.name} holds ROS 1 messages ('{self.encoding}'); {FROM_ROS1}"
        if self.msgtype != expected:
            return f"{self.name} is {self.msgtype}, expected {expected}"
        if self.encoding != CDR:
            return f"{self.name} is serialised as '{self.encoding}', expected {CDR}"
        return ""


def remap_topics(
    remaps: Iterable[str], defaults: Mapping[str, str] = DEFAULT_TOPICS
) -> dict[str, str]:
    """Apply ``scan:=/base_scan`` remappings to the topics of the roles.

    Raises
    ------
    TopicError
        If a remapping is malformed, or its role unknown.
    """
    topics = dict(defaults)
    for remap in remaps:
        role, arrow, topic = remap.partition(":=")
        role = role.strip().lstrip("/")
        if not arrow or not topic.strip():
            raise TopicError(f"'{remap}' is not a remapping; write scan:=/base_scan")
        if role not in topics:
            raise TopicError(f"no topic '{role}' to remap" + suggest(role, topics))
        topics[role] = "/" + topic.strip().lstrip("/")
    return topics


def bag_paths(bag: BagPaths) -> list[Path]:
    """Return the bags of a recording."""
    return [Path(bag)] if isinstance(bag, Path | str) else [Path(path) for path in bag]


class BagReader:
    """Reads a bag; a context manager.

    Parameters
    ----------
    bag
        A rosbag2 folder (mcap or sqlite3, split or not, compressed or not, with or without
        metadata.yaml), or one .mcap or .db3 file; or several of these, in any order, which are read
        as one recording.
    readers
        Message readers by role.

    Attributes
    ----------
    path
        Name of the bag in error messages.
    start_ns, end_ns
        Log times of the first and the last message, ns; 0 for a bag without messages.
    dropped
        Number of skipped messages, by topic.
    problems
        Reason for the first skipped message of a topic.

    Raises
    ------
    BagError
        If a bag is missing, empty, truncated, damaged or named twice.
    """

    def __init__(self, bag: BagPaths, readers: Mapping[str, MessageReader] = READERS) -> None:
        paths = bag_paths(bag)
        self.path = ", ".join(map(str, paths))
        self._readers = readers
        self.dropped: Counter[str] = Counter()
        self.problems: dict[str, str] = {}
        self._types = TypestoreMessages()
        with ExitStack() as stack:
            self._files = [
                stack.enter_context(closing(StorageFile(stack.enter_context(unpacked(file)), file)))
                for file in _all_files(paths)
            ]
            self._files.sort(key=lambda file: file.start_ns)
            self._open_files = stack.pop_all()
        spans = [file for file in self._files if file.end_ns]
        self.start_ns = min((file.start_ns for file in spans), default=0)
        self.end_ns = max((file.end_ns for file in spans), default=0)

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all files."""
        self._open_files.close()

    def add_readers(self, readers: Mapping[str, MessageReader]) -> None:
        """Add message readers by role, replacing existing ones."""
        self._readers = {**self._readers, **readers}

    @property
    def duration(self) -> float:
        """Time between the first and the last message, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    def topics(self) -> list[TopicInfo]:
        """Return the topics by name; a topic with two types appears twice."""
        counts: Counter[tuple[str, str, str]] = Counter()
        for topic in self._stored():
            counts[topic.topic, topic.msgtype, topic.encoding] += topic.count
        return [
            TopicInfo(name, kind, count, encoding)
            for (name, kind, encoding), count in sorted(counts.items())
        ]

    def qos(self, topic: str) -> Qos:
        """Return the quality of service of a topic's publishers, or the topic's default."""
        return qos_of_publishers(
            [qos for stored in self._stored() if stored.topic == topic for qos in stored.qos], topic
        )

    def missing(self, role: str, topic: str) -> str:
        """Return the message of a TopicError for a topic that is missing or cannot be read."""
        msgtype = self._readers[role].message_type
        unread = [info.why_not_read(msgtype) for info in self.topics() if info.name == topic]
        if unread:
            return f"{self.path}: {unread[0]}"
        same = sorted({info.name for info in self.topics() if not info.why_not_read(msgtype)})
        if same:
            hint = f"; of this type there are: {', '.join(same)}; "
            if len(same) == 1:
                hint += f"use --remap {role}:={same[0]}"
            else:
                hint += "'tccm info' suggests --remap options"
        else:
            hint = suggest(topic, {info.name for info in self.topics()})
        return f"{self.path}: no topic {topic} ({msgtype}){hint}"

    def messages(
        self, topics: Iterable[str] | None = None, msgtype: str | None = None
    ) -> Iterator[BagMessage]:
        """Yield serialised messages in log order, only those encoded as CDR.

        Parameters
        ----------
        topics
            Names of topics; None for all.
        msgtype
            Message type; None for any.

        Raises
        ------
        BagError
            At the first damage, after all messages before it.
        """
        wanted = None if topics is None else frozenset(topics)
        yield from self._messages(
            lambda stored: (
                (wanted is None or stored.topic in wanted) and msgtype in (None, stored.msgtype)
            )
        )

    def records(self, topics: Mapping[str, str] = DEFAULT_TOPICS) -> Iterator[tuple[str, int, Any]]:
        """Yield (role, log time in ns, record) in log order.

        A tf message gives a record per transform. Missing topics, and messages of another type or
        encoding than their role needs, give no records and no error; see `missing` and
        `TopicInfo.why_not_read`.

        Parameters
        ----------
        topics
            Topic of each role; roles are the keys of `readers`.

        Raises
        ------
        BagError
            At the first damage, after all records before it.
        """
        roles = defaultdict(list)
        for role, topic in topics.items():
            roles[topic, self._readers[role].message_type].append(role)
        for message in self._messages(lambda stored: (stored.topic, stored.msgtype) in roles):
            for role in roles[message.topic, message.msgtype]:
                for record in self._read(role, message):
                    yield role, message.log_ns, record

    def _messages(self, is_wanted: Callable[[StoredTopic], bool]) -> Iterator[BagMessage]:
        files = (_begun_when_due(file, is_wanted) for file in self._files)
        for message in merge(*files, key=attrgetter("log_ns")):
            if message.topic:
                yield message

    def _read(self, role: str, message: BagMessage) -> Sequence[Any]:
        try:
            return self._readers[role].read(message.data, self._types.deserialize)
        except MessageError as error:
            self.dropped[message.topic] += 1
            self.problems.setdefault(message.topic, one_line(error))
            return ()

    def _stored(self) -> Iterator[StoredTopic]:
        for file in self._files:
            yield from file.topics


def _all_files(paths: Sequence[Path]) -> list[Path]:
    """Return the storage files of several bags."""
    files = [file for path in paths for file in storage_paths(path)]
    for file, count in Counter(file.resolve() for file in files).items():
        if count > 1:
            raise BagError(f"{file}: named {count} times; name each bag of a recording once")
    return files


def _begun_when_due(
    file: StorageFile, is_wanted: Callable[[StoredTopic], bool]
) -> Iterator[BagMessage]:
    """Yield a message without topic at the start time of a file, then the file's messages.

    The file is not read before its start time, so that only one split of a recording is in memory.
    """
    yield BagMessage("", "", file.start_ns, b"")
    yield from file.messages([t for t in file.topics if t.encoding == CDR and is_wanted(t)])
