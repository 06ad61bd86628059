"""The `Robot` of a process: the intake feeds it, and the nodes' workers receive its events.

A record is checked in the intake's thread, which takes some tens of microseconds. The processors,
whose steps take long, have threads of their own. Two nodes in one process can therefore use one
robot without waiting for each other. They also use one intake: two intakes would read topics at
different speeds, and a topic far ahead of the others would look like elapsed time.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from typing import Any

from tccm_ros.config import Config
from tccm_ros.errors import ConfigError, FrameError, TccmError
from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.records import Event
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams

SHARED_GROUPS = frozenset(
    {"frames", "rig", "scan", "sensors", "localisation", "qos"}
    | {"sync_timeout", "reorder_window", "clock_jump"}
)
"""Parameters that must be equal for all nodes of one process."""


MAX_EARLY = 20_000
"""Maximum number of records kept while kernels are compiled: 100 s of a laser, joints and odometry.
Chosen: 60 MB of scans of a thousand beams."""

BUSY_S = 0.01
"""Pause between batches of kept records while a worker is busy, s."""

DRAIN = 50
"""Number of kept records per batch, between checks of the workers' queues."""


class SharedRobot:
    """A robot with one intake and several listeners.

    Parameters
    ----------
    config
        Configuration of the node that owns the intake.
    intake
        Intake of that node.
    is_odometry_published
        Returns whether odometry has a publisher; called before the first scan is posed.

    Attributes
    ----------
    robot
        Poses records.
    too_early
        Counts of records dropped while kernels were compiled, by role.
    lock
        Held while a record is checked and its events are passed on, so that its holder runs before
        or after all events of a record.
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
        """Register a callback for events; while `is_busy` returns True, kept records wait."""
        with self.lock:
            self._listeners.append(listener)
            self._busy.append(is_busy)

    def hold(self) -> None:
        """Keep records until `release` has been called once for each call of this."""
        with self.lock:
            self._holders += 1

    def release(self, refuse: Callable[[str, Exception], None]) -> None:
        """Process the records that were kept, as fast as the listeners can.

        `refuse` is called with the role and the error of a record that cannot be used.
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
        """Number of records kept."""
        return len(self._early)

    @property
    def is_shared(self) -> bool:
        """Whether several nodes of this process listen."""
        return len(self._listeners) > 1

    def add(self, role: str, record: Any) -> None:
        """Pose a record and pass its events to the listeners.

        Raises
        ------
        UrdfError
            If a robot description cannot be read.
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
        """Pose or drop the waiting records, as at the end of a bag."""
        with self.lock:
            self._give(self.robot.flush())

    def dropped(self, roles: Collection[str]) -> Counter[str]:
        """Return the counts of records of some roles that were not posed, by reason."""
        sensors = self.robot.sensors
        early = Counter({"before the start": sum(self.too_early[role] for role in roles)})
        return sum((sensors[role].dropped for role in roles), +early)

    def problems(self, roles: Collection[str]) -> list[FrameError]:
        """Return the reasons why sensors have no pose."""
        found = (self.robot.sensors[role].problem for role in sorted(roles))
        return [problem for problem in found if problem is not None]

    def check_shared(self, config: Config) -> None:
        """Check that the robot's parameters of another node of this process are the same.

        Raises
        ------
        ConfigError
            If one of them differs.
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
