"""The `Robot` of a process: the intake feeds it, the workers get what it brings out.

A record is checked in the thread of the intake, which takes some tens of microseconds; the
processors, whose steps are long, have threads of their own. So two nodes in one process share one
robot, and neither waits for the other. They share the intake as well: two would take their topics
at different speeds, and one topic far ahead of the others passes for time that has gone on.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from typing import Any

from tccm_ros.config import Config
from tccm_ros.errors import ConfigError, FrameError, TccmError
from tccm_ros.nodes.intake import Intake
from tccm_ros.records import Event
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams

SHARED_GROUPS = frozenset(
    {"frames", "rig", "scan", "sensors", "localisation", "qos"}
    | {"sync_timeout", "reorder_window", "clock_jump"}
)
"""What the nodes of one process must have in common."""


MAX_EARLY = 20_000
"""Records that are kept while kernels are compiled, at most: 100 s of a laser, joints and odometry.
Chosen: 60 MB of scans of a thousand beams."""

BUSY_S = 0.01
"""Rest of who works on kept records while a worker has enough to do, s."""

DRAIN = 50
"""Records of those that are worked on before the workers are looked at."""


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
    too_early
        Records that were dropped while kernels were compiled, by role.
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
        self._busy: list[Callable[[], bool]] = []
        self._holders = 0
        self._early: deque[tuple[str, Any]] = deque()
        self.too_early: Counter[str] = Counter()

    def listen(
        self, listener: Callable[[Sequence[Event]], None], is_busy: Callable[[], bool]
    ) -> None:
        """Have a function called with the events of each record; `is_busy` asks for a rest."""
        with self.lock:
            self._listeners.append(listener)
            self._busy.append(is_busy)

    def hold(self) -> None:
        """Keep records until `release` is called as often as this."""
        with self.lock:
            self._holders += 1

    def release(self, refuse: Callable[[str, Exception], None]) -> None:
        """Work on the records that were kept, as fast as the listeners can.

        `refuse` is called with the role and the error of one that cannot be used.
        """
        with self.lock:
            self._holders -= 1
        while True:
            with self.lock:
                if self._holders or not self._early:
                    return
                for role, record in (
                    self._early.popleft() for _ in range(min(DRAIN, len(self._early)))
                ):
                    try:
                        self._pass_on(role, record)
                    except TccmError as error:
                        refuse(role, error)
            while any(is_busy() for is_busy in self._busy):
                time.sleep(BUSY_S)

    @property
    def early(self) -> int:
        """How many records are kept."""
        return len(self._early)

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
            if not self._holders and not self._early:
                self._pass_on(role, record)
            elif len(self._early) < MAX_EARLY or role == "robot_description":
                self._early.append((role, record))
            else:
                self.too_early[role] += 1

    def _pass_on(self, role: str, record: Any) -> None:
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
        early = Counter({"before the start": sum(self.too_early[role] for role in roles)})
        return sum((sensors[role].dropped for role in roles), +early)

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
