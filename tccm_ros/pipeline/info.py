"""`tccm info`: the topics of a bag, and the inputs that a replay of it would lack."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader, TopicInfo
from tccm_ros.config import Config
from tccm_ros.errors import FrameError, TccmError
from tccm_ros.records import Scan
from tccm_ros.robot import Robot
from tccm_ros.ros.reading import READERS
from tccm_ros.sensors.registry import default_streams

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

LASERS = ("tilt_scan", "scan")

MAX_READ_NS = 5_000_000_000
"""Part of a bag that is read to find which laser a joint moves, ns; chosen: a few tilt cycles."""


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
        One line for each input of a replay that is missing under its usual name; the last one has
        the remappings to try.
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

    Messages are read only where the topic of a laser has another name than usual, and only those of
    the first seconds.

    Raises
    ------
    BagError
        If the bag is missing, empty or damaged.
    """
    with BagReader(path) as reader:
        return BagInfo(Path(path), reader.duration, reader.topics(), _notes(reader))


def _notes(reader: BagReader) -> list[str]:
    """Return a line for each missing input, and a line with the remappings to try."""
    counts = {topic.name: topic.count for topic in reader.topics()}
    missing = [role for role, topic in DEFAULT_TOPICS.items() if not counts.get(topic)]
    notes = [
        f"no {DEFAULT_TOPICS[role]}: {CONSEQUENCES[role]}" for role in missing if CONSEQUENCES[role]
    ]
    remaps = _suggestions(reader, missing)
    if remaps:
        notes.append("try " + " ".join(f"--remap {role}:={t}" for role, t in remaps.items()))
    return notes


def _suggestions(reader: BagReader, missing: Sequence[str]) -> dict[str, str]:
    """Return a topic for each missing role that has one of its type, no topic twice."""
    free = defaultdict(list)
    for topic in reader.topics():
        if topic.count and topic.name not in DEFAULT_TOPICS.values():
            free[topic.msgtype].append(topic.name)
    found = {
        role: free[READERS[role].message_type][0]
        for role in missing
        if role not in LASERS and free[READERS[role].message_type]
    }
    lasers = free[READERS["scan"].message_type]
    if lasers and any(role in missing for role in LASERS):
        tilts = _tilting(reader, lasers, found)
        for role in LASERS:
            fits = [name for name in lasers if (name in tilts) == (role == "tilt_scan")]
            if role in missing and fits:
                found[role] = fits[0]
    return {role: found[role] for role in DEFAULT_TOPICS if role in found}


def _tilting(reader: BagReader, lasers: Sequence[str], remaps: Mapping[str, str]) -> set[str]:
    """Return the topics of those lasers that a joint moves against the base."""
    topics = {**DEFAULT_TOPICS, **remaps}
    robot = Robot(Config(), default_streams())
    frames: dict[str, str] = {}
    roles = {role: topic for role, topic in topics.items() if role not in LASERS}
    with suppress(TccmError):  # a replay reports what is damaged or of another type
        for role, log_ns, record in reader.records(roles):
            if log_ns - reader.start_ns > MAX_READ_NS:
                break
            robot.add(role, record)
    robot.flush()
    for laser in lasers:
        with suppress(TccmError):
            _, _, scan = next(reader.records({"scan": laser}))
            frames[laser] = cast(Scan, scan).frame_id
    tilts = set()
    for laser, frame in frames.items():
        with suppress(FrameError):
            robot.sensors["tilt_scan"].mount.find(frame, final=True)
            tilts.add(laser)
    return tilts
