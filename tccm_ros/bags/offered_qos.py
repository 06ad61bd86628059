"""Quality of service of publishers, as rosbag2 stores it for each topic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rosbags import interfaces
from rosbags.interfaces import QosDurability, QosReliability

LATCHED = ("robot_description", "tf_static")
"""Topics that late subscribers must see, in any namespace."""

FOREVER = {"sec": 9223372036, "nsec": 854775807}

MAX_DEPTH = 10_000
"""Maximum queue depth taken from a bag. Chosen: it bounds the memory."""


@dataclass(frozen=True)
class Qos:
    """Quality of service of a topic's publisher; players offer the same.

    Attributes
    ----------
    reliable, latched
        Whether it is reliable (else best effort), and transient local (else volatile).
    depth
        Queue depth, messages.
    """

    reliable: bool = True
    latched: bool = False
    depth: int = 10

    def profile(self) -> dict[str, Any]:
        """Return the profile in the form of rosbag2's metadata, version 9."""
        return {
            "history": "keep_last",
            "depth": self.depth,
            "reliability": "reliable" if self.reliable else "best_effort",
            "durability": "transient_local" if self.latched else "volatile",
            "deadline": dict(FOREVER),
            "lifespan": dict(FOREVER),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(FOREVER),
            "avoid_ros_namespace_conventions": False,
        }


def default_qos(topic: str) -> Qos:
    """Return the default quality of service of a topic without publishers in the metadata."""
    if topic.rsplit("/", 1)[-1] in LATCHED:
        return Qos(latched=True, depth=1)
    return Qos()


def qos_of_publishers(offered: Sequence[interfaces.Qos], topic: str) -> Qos:
    """Return the quality of service of a topic's publishers, or the topic's default without any.

    Publishers may differ: the result has the weakest reliability and the strongest durability, as
    in rosbag2's player.
    """
    if not offered:
        return default_qos(topic)
    return Qos(
        reliable=all(qos.reliability != QosReliability.BEST_EFFORT for qos in offered),
        latched=all(qos.durability == QosDurability.TRANSIENT_LOCAL for qos in offered),
        depth=min(max([1, *(qos.depth for qos in offered)]), MAX_DEPTH),
    )
