"""Read bags: rosbag2 folders and single files, mcap and sqlite3, in log order.

Messages are decoded with the definitions of ROS 2 Jazzy, never with code made from the bag. One
that cannot be decoded, or that no processor can use, is counted in `BagReader.dropped` and left
out; damage of the storage ends the reading with a BagError, after all that came before it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import NamedTuple

from tccm_ros.bags.bag_files import (
    StorageFile,
    is_compressed,
    open_storage,
    storage_paths,
    unpack_file,
)
from tccm_ros.bags.merge import Source, merge
from tccm_ros.bags.offered_qos import Qos, parse_profiles, qos_of_profiles
from tccm_ros.bags.storage import ZSTD_MAGIC, Channel, expand_message, reading
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.errors import BagError, MessageError, TopicError, one_line, suggest
from tccm_ros.records.building import Record
from tccm_ros.ros import READERS

__all__ = ["DEFAULT_TOPICS", "BagMessage", "BagReader", "TopicInfo", "remap_topics"]

DEFAULT_TOPICS: Mapping[str, str] = {
    "tilt_scan": "/tilt_scan",
    "joint_states": "/joint_states",
    "odom": "/odom",
    "scan": "/scan",
    "robot_description": "/robot_description",
    "tf": "/tf",
    "tf_static": "/tf_static",
}
"""Topic of each role (DESIGN section 5)."""


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a bag."""

    name: str
    msgtype: str
    count: int


class BagMessage(NamedTuple):
    """A serialised message of a bag (CDR)."""

    topic: str
    msgtype: str
    log_ns: int
    data: bytes


def remap_topics(
    remaps: Iterable[str], defaults: Mapping[str, str] = DEFAULT_TOPICS
) -> dict[str, str]:
    """Apply ``scan:=/base_scan`` remappings to the topics of the roles.

    Raises
    ------
    TopicError
        For text of another form, or a role that there is not.
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


class BagReader:
    """A bag that is read; a context manager.

    Parameters
    ----------
    path
        A rosbag2 folder (mcap or sqlite3, split or not, compressed or not, with or without
        metadata.yaml), or one .mcap or .db3 file.
    readers
        By role of a topic: how its messages become records.

    Attributes
    ----------
    start_ns, end_ns
        Log times of the first and the last message; 0 for a bag without messages.
    dropped
        Messages left out, by topic.
    problems
        Why the first message of a topic was left out.

    Raises
    ------
    BagError
        For a bag that is missing, empty, truncated or damaged.
    """

    def __init__(self, path: Path | str, readers: Mapping[str, MessageReader] = READERS) -> None:
        self.path = Path(path)
        self._readers = readers
        self.dropped: Counter[str] = Counter()
        self.problems: dict[str, str] = {}
        self._types = TypestoreMessages()
        self._folder: TemporaryDirectory[str] | None = None
        self._files: list[StorageFile] = []
        try:
            self._files = [self._open(file) for file in storage_paths(self.path)]
        except BaseException:
            self.close()
            raise
        self._files.sort(key=lambda file: file.start_ns)
        spans = [file for file in self._files if file.end_ns]
        self.start_ns = min((file.start_ns for file in spans), default=0)
        self.end_ns = max((file.end_ns for file in spans), default=0)

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all files."""
        for file in self._files:
            file.close()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    @property
    def duration(self) -> float:
        """Time between the first and the last message, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    def topics(self) -> list[TopicInfo]:
        """Return what is in the bag, by name."""
        counts: Counter[tuple[str, str]] = Counter()
        for file in self._files:
            found = file.counts()
            for number, channel in file.channels.items():
                counts[channel.topic, channel.msgtype] += found[number]
        return [TopicInfo(name, kind, count) for (name, kind), count in sorted(counts.items())]

    def qos(self, topic: str) -> Qos:
        """Return what the publishers of a topic offered, or the topic's default."""
        profiles = [
            profile
            for channel in self._channels()
            if channel.topic == topic
            for profile in parse_profiles(channel.qos)
        ]
        return qos_of_profiles(profiles, topic)

    def missing(self, role: str, topic: str) -> str:
        """Explain that a topic is not here: the message for a TopicError of the pipeline."""
        msgtype = self._readers[role].message_type
        same = sorted({c.topic for c in self._channels() if c.msgtype == msgtype})
        if same:
            hint = f"; of this type there are: {', '.join(same)}; "
            if len(same) == 1:
                hint += f"use --remap {role}:={same[0]}"
            else:
                hint += "'tccm info' suggests --remap options"
        else:
            hint = suggest(topic, {c.topic for c in self._channels()})
        return f"{self.path}: no topic {topic} ({msgtype}){hint}"

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[BagMessage]:
        """Yield serialised messages in log order, of some topics or of all.

        Raises
        ------
        BagError
            At the first damage, after all messages before it.
        TopicError
            Where a topic is not serialised as CDR.
        """
        wanted = None if topics is None else set(topics)
        sources: list[Source] = []
        for file in self._files:
            channels = {
                number: channel
                for number, channel in file.channels.items()
                if wanted is None or channel.topic in wanted
            }
            for channel in channels.values():
                _check_encoding(self.path, channel)
            if channels:
                sources.append((file, channels))
        for file, channels, message in merge(sources):
            channel = channels[message.channel]
            data = message.data
            if data[:4] == ZSTD_MAGIC:
                with reading(file.path):
                    data = expand_message(data)
            yield BagMessage(channel.topic, channel.msgtype, message.log_ns, data)

    def records(
        self, topics: Mapping[str, str] = DEFAULT_TOPICS
    ) -> Iterator[tuple[str, int, Record]]:
        """Yield (role, log time in ns, record) in log order.

        A tf message gives a record per transform. Topics that are not in the bag give nothing;
        whether that matters is the caller's decision (see `missing`).

        Parameters
        ----------
        topics
            Topic of each role; roles are the keys of `readers`.

        Raises
        ------
        TopicError
            Where a topic has another type than its role needs.
        BagError
            At the first damage, after all records before it.
        """
        roles = defaultdict(list)
        for role, topic in topics.items():
            roles[topic].append(role)
        for channel in self._channels():
            for role in roles.get(channel.topic, ()):
                _check_type(self.path, channel, role, self._readers[role].message_type)
        for message in self.messages(roles):
            for role in roles[message.topic]:
                for record in self._read(role, message):
                    yield role, message.log_ns, record

    def _read(self, role: str, message: BagMessage) -> Sequence[Record]:
        try:
            return self._readers[role].read(message.data, self._types.deserialize)
        except MessageError as error:
            self.dropped[message.topic] += 1
            self.problems.setdefault(message.topic, one_line(error))
            return ()

    def _channels(self) -> Iterator[Channel]:
        for file in self._files:
            yield from file.channels.values()

    def _open(self, path: Path) -> StorageFile:
        if not is_compressed(path):
            return open_storage(path)
        if self._folder is None:
            self._folder = TemporaryDirectory()
        try:
            return open_storage(unpack_file(path, Path(self._folder.name)))
        except BagError as error:
            raise BagError(f"{path}: when unpacked: {error}") from None


def _check_encoding(path: Path, channel: Channel) -> None:
    if channel.encoding != "cdr":
        raise TopicError(
            f"{path}: {channel.topic} is serialised as '{channel.encoding}', expected cdr"
        )


def _check_type(path: Path, channel: Channel, role: str, expected: str) -> None:
    if channel.msgtype != expected:
        raise TopicError(
            f"{path}: {channel.topic} is {channel.msgtype}, expected {expected} for {role}"
        )
