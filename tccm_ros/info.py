"""`tccm info`: what is in a bag, and what a replay of it would miss."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tccm_ros.io.bags import DEFAULT_TOPICS, BagReader, TopicInfo
from tccm_ros.messages import READERS

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
        One line for each input of a replay that is not there under its usual name.
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
    """Read what is in a bag, without reading its messages.

    Raises
    ------
    BagError
        For a bag that is missing, empty or damaged.
    """
    with BagReader(path) as reader:
        topics = reader.topics()
        return BagInfo(Path(path), reader.duration, topics, _notes(topics))


def _notes(topics: list[TopicInfo]) -> list[str]:
    names = {topic.name for topic in topics if topic.count}
    notes = []
    for role, topic in DEFAULT_TOPICS.items():
        if topic in names or not MEANING[role]:
            continue
        wanted = READERS[role][0]
        others = [
            t.name for t in topics if t.msgtype == wanted and t.name not in DEFAULT_TOPICS.values()
        ]
        remap = f"; try --remap {role}:={others[0]}" if others else ""
        notes.append(f"no {topic}: {MEANING[role]}{remap}")
    return notes
