"""An interrupted run: what the processors were in the middle of when a map was saved.

A recording that comes in several files is one run. Where the next file goes on with the clock and
the odometry of the one before, the processors go on as if nothing had been between: open sweep,
window, local map, waiting scans and loop candidates are what they were. Anything else is a new
session, whose place in the map has to be found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tccm_ros.config import Config
from tccm_ros.geometry import between2, planar
from tccm_ros.records import Odometry, Scan
from tccm_ros.snapshot import Arrays, freeze, software, thaw

__all__ = ["Continuation", "LastSample", "last_sample"]

LIVE_GROUPS = frozenset({"qos", "tf", "save", "markers"})
"""Groups of the configuration that no result depends on."""

START = (0.1, 0.1)
"""Odometry (m, rad) that a robot may have done in no time: rounding and slip."""

FASTEST = (3.0, 3.0)
"""Speed (m/s, rad/s) that no robot of this kind has: odometry that was faster began anew."""


@dataclass(frozen=True, slots=True)
class LastSample:
    """A sample by which one tells whether records go on with a run.

    Attributes
    ----------
    stamp_ns
        Its stamp.
    frames
        Frame and child frame of odometry; frame of a scan.
    pose
        Planar pose (x, y, yaw) of odometry; none of a scan.
    """

    stamp_ns: int
    frames: tuple[str, ...]
    pose: tuple[float, ...]

    def to_json(self) -> list[Any]:
        """Return plain data."""
        return [self.stamp_ns, list(self.frames), list(self.pose)]

    @classmethod
    def from_json(cls, data: Any) -> LastSample:
        """Return what `to_json` told."""
        stamp_ns, frames, pose = data
        return cls(int(stamp_ns), tuple(map(str, frames)), tuple(map(float, pose)))


def last_sample(record: Odometry | Scan) -> LastSample:
    """Return what is kept of a record."""
    if isinstance(record, Scan):
        return LastSample(record.stamp_ns, (record.frame_id,), ())
    x, y, yaw = planar(record.T_odom_base).tolist()
    return LastSample(record.stamp_ns, (record.frame_id, record.child_frame_id), (x, y, yaw))


@dataclass(frozen=True, slots=True, eq=False)
class Continuation:
    """The state of processors.

    Attributes
    ----------
    software
        Of the software that made it: other software may keep other state.
    configuration
        Plain data, without what no result depends on.
    last
        The last odometry sample; the last scan where there is no odometry.
    state
        `snapshot.freeze` of the processors by name.
    """

    software: str
    configuration: Mapping[str, Any]
    last: LastSample
    state: Arrays

    @classmethod
    def of(cls, processors: Mapping[str, Any], last: LastSample, config: Config) -> Continuation:
        """Freeze processors as they are now, before the end of the input closes what is open."""
        state = freeze(dict(processors), config)
        return cls(software(), _relevant(config), last, state)

    def refusal(self, config: Config, first: LastSample | None) -> str:
        """Return why records do not go on with this run; nothing where they do.

        Parameters
        ----------
        config
            Of the run to come.
        first
            The first sample to come, of the kind of `last`; None if there is none.
        """
        if self.software != software():
            return "the map was saved by another version of the software"
        other = _first_difference(self.configuration, _relevant(config))
        if other:
            return f"{other} has another value than when the map was saved"
        if first is None or first.frames != self.last.frames:
            return "the map was saved by a run with other inputs"
        seconds = (first.stamp_ns - self.last.stamp_ns) * 1e-9
        if not -config.sync_timeout <= seconds <= config.clock_jump:
            return f"it begins {seconds:.1f} s after the saved run ended"
        if not _within_reach(self.last.pose, first.pose, abs(seconds)):
            return "its odometry began anew"
        return ""

    def processors(self, config: Config) -> dict[str, Any]:
        """Return the processors as they were.

        Raises
        ------
        MapError
            For a damaged state.
        """
        made: dict[str, Any] = thaw(self.state, config)
        return made


def _relevant(config: Config) -> dict[str, Any]:
    return config.model_dump(mode="json", exclude=set(LIVE_GROUPS))


def _first_difference(a: Mapping[str, Any], b: Mapping[str, Any]) -> str:
    """Return the dotted name of the first parameter that differs, if one does."""
    for name in sorted({*a, *b}):
        one, other = a.get(name), b.get(name)
        if one == other:
            continue
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            return f"{name}.{_first_difference(one, other)}"
        return name
    return ""


def _within_reach(start: tuple[float, ...], end: tuple[float, ...], seconds: float) -> bool:
    """Return whether a robot can have gone from a planar pose to another in a time."""
    if not start:
        return True
    x, y, yaw = between2(np.array(start), np.array(end))
    reach, turn = (s + v * seconds for s, v in zip(START, FASTEST))
    return bool(np.hypot(x, y) <= reach and abs(yaw) <= turn)
