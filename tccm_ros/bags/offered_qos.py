"""What publishers offer, as rosbag2 stores it beside each topic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import yaml

__all__ = ["Qos", "default_qos", "parse_profiles", "qos_of_profiles"]

LATCHED = ("robot_description", "tf_static")
"""Topics that late subscribers must see, in any namespace."""

FOREVER = {"sec": 9223372036, "nsec": 854775807}

_NAMES = {
    "history": {1: "keep_last", 2: "keep_all", 3: "unknown"},
    "reliability": {1: "reliable", 2: "best_effort", 3: "unknown"},
    "durability": {1: "transient_local", 2: "volatile", 3: "unknown"},
    "liveliness": {1: "automatic", 3: "manual_by_topic", 4: "unknown"},
}
"""Numbers that rosbag2 wrote before Jazzy (rmw's enumerations)."""

MAX_PROFILES = 100
MAX_DEPTH = 10_000


@dataclass(frozen=True)
class Qos:
    """What a topic's publisher offers; players publish with it again."""

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
    """Return what is offered for a topic of which nothing is known."""
    if topic.rsplit("/", 1)[-1] in LATCHED:
        return Qos(latched=True, depth=1)
    return Qos()


def parse_profiles(text: str) -> list[dict[str, Any]]:
    """Return the profiles of a topic with names for numbers; none where the text is damaged."""
    try:
        tree = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError):
        return []
    if not isinstance(tree, list):
        return []
    return [_named(item) for item in tree[:MAX_PROFILES] if isinstance(item, dict)]


def qos_of_profiles(profiles: list[dict[str, Any]], topic: str) -> Qos:
    """Return what satisfies all of a topic's publishers, or the topic's default if there are none.

    Several publishers may have offered different things: the weakest reliability and the
    strongest durability are taken, as rosbag2's player does.
    """
    if not profiles:
        return default_qos(topic)
    depths = [p["depth"] for p in profiles if isinstance(p.get("depth"), int)]
    return Qos(
        reliable=all(p.get("reliability") != "best_effort" for p in profiles),
        latched=all(p.get("durability") == "transient_local" for p in profiles),
        depth=min(max([1, *depths]), MAX_DEPTH),
    )


def _named(profile: dict[Any, Any]) -> dict[str, Any]:
    result = {}
    for key, value in profile.items():
        names = _NAMES.get(str(key), {})
        result[str(key)] = names.get(value, value) if isinstance(value, int) else value
    return result
