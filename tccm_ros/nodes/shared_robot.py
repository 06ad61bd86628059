"""The `Robot` of a process: the intake feeds it, the workers get what it brings out.

A record is checked in the thread of the intake, which takes some tens of microseconds; the
processors, whose steps are long, have threads of their own. So two nodes in one process share one
robot, and neither waits for the other. They share the intake as well: two would take their topics
at different speeds, and one topic far ahead of the others passes for time that has gone on.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from typing import Any

from tccm_ros.config import Config
from tccm_ros.errors import ConfigError, FrameError
from tccm_ros.nodes.intake import Intake
from tccm_ros.records import Event
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams

SHARED_GROUPS = frozenset({"frames", "rig", "scan", "sensors", "qos", "sync_timeout", "clock_jump"})
"""What the nodes of one process must have in common."""


class SharedRobot:
    """A robot that one intake feeds and several listeners hear.

    Parameters
    ----------
    config
        Of the node that receives what is known of the robot.
    intake
        Of that node.
    is_odometry_published
        Whether somebody publishes odometry, asked before the first scan is placed.

    Attributes
    ----------
    robot
        What is known.
    lock
        Held while a record is checked and its events are given out: who holds it comes before or
        after all events of a record.
    """

    def __init__(self, config: Config, intake: Intake, is_odometry_published: Callable[[], bool]):
        self.intake = intake
        self.robot = Robot(config, default_streams(config))
        self.lock = threading.RLock()
        self._config = config
        self._is_odometry_published = is_odometry_published
        self._listeners: list[Callable[[Sequence[Event]], None]] = []

    def listen(self, listener: Callable[[Sequence[Event]], None]) -> None:
        """Have a function called with the events of each record."""
        with self.lock:
            self._listeners.append(listener)

    @property
    def is_shared(self) -> bool:
        """Whether several nodes of this process hear it."""
        return len(self._listeners) > 1

    def add(self, role: str, record: Any) -> None:
        """Take a record and give out what it brings out.

        Raises
        ------
        UrdfError
            For a robot description that cannot be read.
        """
        with self.lock:
            if role in self.robot.sensors and self.robot.motion.source is None:
                self.robot.expects_odometry = self._is_odometry_published()
            self._give(self.robot.add(role, record))

    def flush(self) -> None:
        """Pose or drop what waits, as at the end of a bag."""
        with self.lock:
            self._give(self.robot.flush())

    def dropped(self, roles: Collection[str]) -> Counter[str]:
        """Return the records of some streams that were not posed, by reason."""
        sensors = self.robot.sensors
        return sum((sensors[role].dropped for role in roles), Counter())

    def problems(self, roles: Collection[str]) -> list[FrameError]:
        """Return why sensors could not be placed."""
        found = (self.robot.sensors[role].problem for role in sorted(roles))
        return [problem for problem in found if problem is not None]

    def check_shared(self, config: Config) -> None:
        """Check that another node of this process sees the same robot.

        Raises
        ------
        ConfigError
            Where a parameter of the robot differs.
        """
        ours, others = (c.model_dump(include=set(SHARED_GROUPS)) for c in (self._config, config))
        different = sorted(name for name in ours if ours[name] != others[name])
        if different:
            raise ConfigError(
                f"{', '.join(different)}: nodes in one process share one robot, but their "
                "parameters differ; set them under /** for both"
            )

    def _give(self, events: Sequence[Event]) -> None:
        if events:
            for listener in self._listeners:
                listener(events)
