"""`tccm info`: what is in a bag, and what a replay of it would miss."""

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
from tccm_ros.ros import READERS
from tccm_ros.sensors.registry import default_streams

__all__ = ["BagInfo", "bag_info"]

MEANING = {
    "tilt_scan": "no surfaces",
    "scan": "no walls, the map hangs on odometry",
    "joint_states": "the tilting laser must be placed by tf",
    "odom": "from tf, or the base is taken to stand still",
    "robot_description": "the lasers must be placed by tf or rig parameters",
    "tf": "",
    "tf_static": "",
}
"""What follows when an input is missing."""

LASERS = ("tilt_scan", "scan")

FIRST_NS = 5_000_000_000
"""So much of a bag tells which laser a joint moves."""


@dataclass(frozen=True, slots=True)
class BagInfo:
    """What is in a bag.

    Attributes
    ----------
    path
        The bag.
    duration
        s.
    topics
        By name.
    notes
        One line for each input of a replay that is not there under its usual name; the last one
        has the remappings to try.
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
        """Return a table for people."""
        width = max((len(topic.name) for topic in self.topics), default=0)
        rows = [f"{t.name:<{width}}  {t.count:>8}  {t.msgtype}" for t in self.topics]
        return "\n".join([f"{self.path}: {self.duration:.1f} s", *rows, *self.notes])


def bag_info(path: Path | str) -> BagInfo:
    """Read what is in a bag; of its messages only the first seconds, and those only if a laser's
    topic has another name than usual.

    Raises
    ------
    BagError
        For a bag that is missing, empty or damaged.
    """
    with BagReader(path) as reader:
        return BagInfo(Path(path), reader.duration, reader.topics(), _notes(reader))


def _notes(reader: BagReader) -> list[str]:
    """Return a line for each input that is missing, and the remappings to try in one line."""
    counts = {topic.name: topic.count for topic in reader.topics()}
    missing = [role for role, topic in DEFAULT_TOPICS.items() if not counts.get(topic)]
    notes = [f"no {DEFAULT_TOPICS[role]}: {MEANING[role]}" for role in missing if MEANING[role]]
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
    with suppress(TccmError):  # what is damaged or of another type is told by a replay
        for role, log_ns, record in reader.records(roles):
            if log_ns - reader.start_ns > FIRST_NS:
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
