"""Find depth image topics in a bag and their calibrations; explain unusable ones."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tccm_ros.bags.reader import BagReader, TopicInfo
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.errors import MessageError
from tccm_ros.records.building import frame_name
from tccm_ros.sensors.cloud_messages import CLOUD_READER
from tccm_ros.sensors.compressed_depth import PLUGIN, is_depth_format
from tccm_ros.sensors.depth_image import COMPRESSED, camera_info_topic, uncompressed
from tccm_ros.sensors.depth_messages import (
    CAMERA_INFO_READER,
    COMPRESSED_READER,
    DEPTH_ENCODINGS,
    IMAGE_READER,
    camera_info_from_message,
)

IMAGE, PACKED = IMAGE_READER.message_type, COMPRESSED_READER.message_type
INFO, CLOUD = CAMERA_INFO_READER.message_type, CLOUD_READER.message_type
READERS = {r.message_type: r for r in (IMAGE_READER, COMPRESSED_READER, CLOUD_READER)}
"""Readers by message type."""

_NUMBERS = re.compile(r"(\d+[USF]C1)?")
"""Image encodings with one number per pixel, as those of depth images, or none."""


@dataclass(frozen=True, slots=True)
class DepthTopic:
    """A topic of depth images in a bag.

    Attributes
    ----------
    topic, frame_id
        Name of the topic, and the frame of its first image.
    size
        Width and height, pixels; None if the images are compressed.
    """

    topic: str
    frame_id: str
    size: tuple[int, int] | None


def depth_topics(reader: BagReader) -> list[DepthTopic]:
    """Return the topics of depth images in a bag, with or without a calibration."""
    found = []
    for topic, message in first_messages(reader, IMAGE, PACKED):
        is_compressed = topic.msgtype == PACKED
        if is_compressed and is_depth_format(str(message.format), message.data):
            size = None
        elif not is_compressed and str(message.encoding) in DEPTH_ENCODINGS:
            size = int(message.width), int(message.height)
        else:
            continue
        frame = frame_name(message.header.frame_id)
        found.append(DepthTopic(topic.name, frame, size))
    best: dict[str, DepthTopic] = {}
    for image in found:
        kept = best.setdefault(uncompressed(image.topic), image)
        if _preference(image) < _preference(kept):
            best[uncompressed(image.topic)] = image
    return [image for image in found if image in best.values()]


def _preference(image: DepthTopic) -> int:
    """Return the rank of a topic among those of one image; the smallest is preferred."""
    last = image.topic.rsplit("/", 1)[-1]
    return COMPRESSED.index(last) + 1 if last in COMPRESSED else 0


def first_messages(reader: BagReader, *msgtypes: str) -> Iterator[tuple[TopicInfo, Any]]:
    """Yield the topics of some types with their first message, if it can be decoded."""
    for topic in reader.topics():
        if topic.msgtype in msgtypes:
            message = first_message(reader, topic.name, topic.msgtype)
            if message is not None:
                yield topic, message


def first_message(reader: BagReader, topic: str, msgtype: str) -> Any | None:
    """Return the first message of a topic and type; None if it cannot be decoded."""
    types = TypestoreMessages()
    for message in reader.messages([topic], msgtype):
        with suppress(MessageError):
            return types.deserialize(message.msgtype, message.data)
        return None
    return None


def calibration_topic(reader: BagReader, image: DepthTopic) -> str | None:
    """Return the camera_info topic of depth images, or None if it is ambiguous.

    It is the topic next to the images, or the only one with their frame and size.
    """
    infos = [t.name for t in reader.topics() if t.count and not t.why_not_read(INFO)]
    beside = camera_info_topic(image.topic)
    if beside in infos:
        return beside
    fitting = [name for name in infos if _fits(reader, name, image)]
    return fitting[0] if len(fitting) == 1 else None


def _fits(reader: BagReader, info: str, image: DepthTopic) -> bool:
    message = first_message(reader, info, INFO)
    if message is None or frame_name(message.header.frame_id) != image.frame_id:
        return False
    with suppress(MessageError):
        return image.size in (None, camera_info_from_message(message).image_size)
    return False


def unreadable_topics(reader: BagReader, named: set[str]) -> list[str]:
    """Return a line for each topic of depth images or points that cannot be read, with the reason.

    Parameters
    ----------
    reader
        The bag.
    named
        Topics that the configuration or the user names as depth images; other images are ignored
        if their encoding has colours.
    """
    notes = []
    for topic, message in first_messages(reader, IMAGE, PACKED, CLOUD):
        if topic.msgtype == PACKED:
            text = str(message.format)
            seems = text.startswith(("16UC1", "32FC1")) or topic.name.endswith(PLUGIN)
            is_depth = seems and not is_depth_format(text, message.data)
        elif topic.msgtype == IMAGE:
            is_depth = topic.name in named or _NUMBERS.fullmatch(str(message.encoding)) is not None
        else:
            is_depth = True
        if is_depth:
            try:
                READERS[topic.msgtype].of_message(message)
            except MessageError as error:
                notes.append(f"{topic.name}: {error}")
    return notes
