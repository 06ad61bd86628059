"""Estimates the delay of a tilting laser's joint while a node runs, from its first tilt cycles."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from tccm_ros.calibrate.joint_timing import READ_TIME, JointTimer, JointTiming
from tccm_ros.config import Config
from tccm_ros.records import MapReset, PosedScan


class JointTimingWatch:
    """Estimates once whether the stamps of a laser and its joint agree.

    The estimate takes 0.3 s, and 3 s where they do not, in a separate thread: planes are
    published meanwhile.

    Parameters
    ----------
    config
        Configuration with which the scans are posed.
    role
        Role of the tilting laser.
    report
        Called in the thread with a sentence if the stamps contradict each other.

    Attributes
    ----------
    is_done
        Whether the estimate is done; it holds for the drivers, not for a map, and is not repeated.
    """

    def __init__(self, config: Config, role: str, report: Callable[[str], object]) -> None:
        self._config, self._role, self._report = config, role, report
        self._timing: JointTiming | None = None
        self.is_done = False
        self._begin()

    def _begin(self) -> None:
        self._timer: JointTimer | None = JointTimer(self._config, self._role)
        self._first_ns: int | None = None

    @property
    def problems(self) -> tuple[str, ...]:
        """The finding as a line for /diagnostics; empty if there is none."""
        timing = self._timing
        if timing is None or not timing.is_significant:
            return ()
        return (f"{timing.text()}; set it and start the node again",)

    def add(self, event: Any) -> None:
        """Add an event in stamp order; scans and tilt angles of the laser are used.

        After a jump of the clock, and where the joint has hardly moved for `READ_TIME`, the
        collection begins anew.
        """
        timer = self._timer
        if timer is None:
            return
        if isinstance(event, MapReset):
            self._begin()
            return
        timer.add(event)
        if timer.is_full:
            self._timer = None
            estimate = partial(self._estimate, timer)
            threading.Thread(target=estimate, name="joint timing", daemon=True).start()
        elif isinstance(event, PosedScan):
            self._first_ns = self._first_ns or event.scan.stamp_ns
            if event.scan.stamp_ns - self._first_ns > READ_TIME * 1e9:
                self._begin()

    def _estimate(self, timer: JointTimer) -> None:
        self._timing = timer.estimate()
        self.is_done = True
        for problem in self.problems:
            self._report(problem)
