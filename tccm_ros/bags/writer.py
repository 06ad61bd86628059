"""Write rosbag2 bags: mcap with checksums, byte-identical for the same input.

A bag is written under a temporary name in the same folder and renamed when it is complete.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import yaml
from mcap.writer import CompressionType, Writer

from tccm_ros.atomic import output_file, output_folder
from tccm_ros.bags.offered_qos import Qos, default_qos
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.errors import OutputError, one_line

LIBRARY = "tccm_ros"
"""Written into the file's header instead of a library version, which differs between machines."""

STORAGE_VERSION = 9
"""rosbag2's metadata version of ROS 2 Jazzy."""


@dataclass
class _Topic:
    name: str
    msgtype: str
    channel: int
    profiles: list[dict[str, Any]]
    type_hash: str
    serialization: str
    count: int = 0


class BagWriter:
    """Writes a bag; a context manager.

    The bag is renamed to its final name when the block ends; after an exception no file remains.

    Parameters
    ----------
    path
        A folder (rosbag2: ``name/name.mcap`` and ``metadata.yaml``), or a file ending in .mcap.
    overwrite
        Whether to replace an existing `path` once the new bag is complete.
    typestore
        Message classes for serialising.

    Raises
    ------
    OutputError
        If `path` exists (without `overwrite`) or cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        overwrite: bool = False,
        typestore: TypestoreMessages | None = None,
    ) -> None:
        self.path = Path(path)
        self.types = typestore or TypestoreMessages()
        if self.path.exists() and not overwrite:
            raise OutputError(f"{self.path}: exists already; name another place or remove it")
        self._is_file = self.path.suffix == ".mcap"
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._start_ns: int | None = None
        self._end_ns = 0
        self._temporary: Path
        self._stream: BinaryIO
        self._writer: Writer
        self._open: ExitStack

    @property
    def folder(self) -> Path:
        """The folder under its temporary name; other files in it are renamed with the bag."""
        return self._temporary

    def __enter__(self) -> BagWriter:
        with ExitStack() as stack:
            if self._is_file:
                self._temporary = file = stack.enter_context(output_file(self.path))
            else:
                whole = output_folder(self.path, is_replaced=True)
                self._temporary = stack.enter_context(whole)
                file = self._temporary / f"{self.path.name}.mcap"
            self._stream = stack.enter_context(file.open("xb"))
            self._open = stack.pop_all()
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD, enable_crcs=True)
        self._writer.start(profile="ros2", library=LIBRARY)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if error is not None:
                self._open.__exit__(kind, error, trace)
                return
            with self._open:
                self._finish()
        except OSError as failure:
            raise OutputError(f"{self.path}: cannot be written ({one_line(failure)})") from None

    def add_topic(self, topic: str, msgtype: str, qos: Qos | None = None) -> None:
        """Declare a topic; `write` declares topics itself, with the default quality of service.

        Parameters
        ----------
        topic, msgtype
            Names, such as ``/scan`` and ``sensor_msgs/msg/LaserScan``.
        qos
            Offered QoS; by default reliable, and latched for robot_description and tf_static.
        """
        profiles = [(qos or default_qos(topic)).profile()]
        text, type_hash = self.types.definition(msgtype), self.types.type_hash(msgtype)
        self.add_channel(topic, msgtype, text.encode(), "ros2msg", profiles, type_hash)

    def add_channel(
        self,
        topic: str,
        msgtype: str,
        definition: bytes,
        encoding: str,
        profiles: list[dict[str, Any]],
        type_hash: str = "",
        serialization: str = "cdr",
    ) -> None:
        """Declare a topic with all of its metadata, as a copy of a bag needs.

        Parameters
        ----------
        topic, msgtype
            Names.
        definition, encoding
            The message definition, and its format (``ros2msg``).
        profiles
            Quality of service of the publishers, in the form of rosbag2's metadata.
        type_hash
            REP-2016 hash of the type.
        serialization
            Encoding of the messages.
        """
        if topic in self._topics:
            raise ValueError(f"topic {topic} is declared already")
        if msgtype not in self._schemas:
            self._schemas[msgtype] = self._writer.register_schema(msgtype, encoding, definition)
        offered = yaml.safe_dump(profiles, sort_keys=False) if profiles else ""
        channel = self._writer.register_channel(
            topic,
            serialization,
            self._schemas[msgtype],
            {"offered_qos_profiles": offered, "topic_type_hash": type_hash},
        )
        self._topics[topic] = _Topic(topic, msgtype, channel, profiles, type_hash, serialization)

    def topic_type(self, topic: str) -> str | None:
        """Return the type of a declared topic, None for others."""
        return self._topics[topic].msgtype if topic in self._topics else None

    def write(self, topic: str, msgtype: str, stamp_ns: int, message: Any) -> None:
        """Write one message.

        Parameters
        ----------
        topic, msgtype
            Names; a topic keeps the type of its first message.
        stamp_ns
            Log time and publish time, ns, not negative.
        message
            Message of the typestore, or its CDR bytes.
        """
        if topic not in self._topics:
            self.add_topic(topic, msgtype)
        entry = self._topics[topic]
        if entry.msgtype != msgtype:
            raise ValueError(f"{topic} is {entry.msgtype}, not {msgtype}")
        if not 0 <= stamp_ns < 2**63:
            raise OutputError(f"{self.path}: {topic} has a stamp of {stamp_ns} ns, out of range")
        if not isinstance(message, bytes | bytearray | memoryview):
            message = self.types.serialize(msgtype, message)
        try:
            self._writer.add_message(entry.channel, stamp_ns, bytes(message), stamp_ns, entry.count)
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({one_line(error)})") from None
        entry.count += 1
        self._start_ns = stamp_ns if self._start_ns is None else min(self._start_ns, stamp_ns)
        self._end_ns = max(self._end_ns, stamp_ns)

    def _finish(self) -> None:
        metadata = self._metadata()
        text = yaml.safe_dump(metadata["rosbag2_bagfile_information"], sort_keys=False)
        self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
        self._writer.finish()
        self._stream.close()
        if not self._is_file:
            whole = yaml.safe_dump(metadata, sort_keys=False)
            (self._temporary / "metadata.yaml").write_text(whole, encoding="utf-8")

    def _metadata(self) -> dict[str, Any]:
        name = self.path.name if self._is_file else f"{self.path.name}.mcap"
        count = sum(topic.count for topic in self._topics.values())
        start = self._start_ns or 0
        span = {
            "starting_time": {"nanoseconds_since_epoch": start},
            "duration": {"nanoseconds": max(self._end_ns - start, 0)},
            "message_count": count,
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.msgtype,
                    "serialization_format": topic.serialization,
                    "offered_qos_profiles": topic.profiles,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for topic in self._topics.values()
        ]
        return {
            "rosbag2_bagfile_information": {
                "version": STORAGE_VERSION,
                "storage_identifier": "mcap",
                **span,
                "relative_file_paths": [name],
                "topics_with_message_count": topics,
                "compression_format": "",
                "compression_mode": "",
                "files": [{"path": name, **span}],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }
