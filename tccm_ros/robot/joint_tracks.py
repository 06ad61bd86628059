"""The positions of all joints over time, from any number of publishers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from tccm_ros.records import JointSample
from tccm_ros.robot.repeated_value import RepeatedValue
from tccm_ros.robot.steps import StepGuard
from tccm_ros.robot.tracks import ScalarTrack

MAX_JOINTS = 1024
"""Maximum number of joints; further ones are ignored. Chosen: more than any robot has."""

LIMIT_SLACK = 0.1
"""Tolerance of the limits in the robot description, as a fraction of the joint's range: joints
overshoot, and limits are rounded."""

STEP_SLACK = 0.005
"""Steps of a joint up to this are plausible at any speed, rad or m: encoder counts of a servo. A
larger first step is accepted only after `steps.LASTING_NS`."""

LATE, OFF_TRACK, REPEATED = "out of order", "outliers", "one value"
"""Reasons of dropped positions."""

Limits = tuple[float, float]


class JointTracks:
    """Tracks of positions by joint name.

    Parameters
    ----------
    time_offset_ns
        Added to the stamps of the samples.
    """

    def __init__(self, time_offset_ns: int):
        self._time_offset_ns = time_offset_ns
        self._tracks: dict[str, ScalarTrack] = {}
        self._guards: dict[str, StepGuard[float]] = {}
        self._repeated: dict[str, RepeatedValue] = {}
        self._limits: Mapping[str, Limits] = {}
        self._within: Counter[str] = Counter()
        self._beyond: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._tracks)

    def set_limits(self, limits: Mapping[str, Limits]) -> None:
        """Set the limits of a robot description by joint; delete samples beyond them."""
        self._limits = limits
        self._guards.clear()
        for name in limits:
            track = self._tracks.get(name)
            if track is not None:
                positions = track.values[:, 0]
                track.keep([self._is_within(name, q) for q in positions.tolist()])

    def add(self, sample: JointSample) -> Counter[str]:
        """Add a sample of some joints; return the number of dropped positions by reason.

        Positions that are not finite numbers are skipped.
        """
        left_out: Counter[str] = Counter()
        stamp_ns = sample.stamp_ns + self._time_offset_ns
        for name, position in zip(sample.names, sample.positions.tolist()):
            if not math.isfinite(position):
                continue
            track = self._tracks.get(name)
            if track is None:
                if len(self._tracks) >= MAX_JOINTS:
                    continue
                track = self._tracks[name] = ScalarTrack()
            if name in self._limits and not self._is_within(name, position):
                left_out[self._contradiction(name)] += 1
                continue
            guard = self._guards.get(name)
            if guard is None:
                guard = self._guards[name] = StepGuard(_joint_step, STEP_SLACK)
                self._repeated[name] = RepeatedValue(STEP_SLACK)
            if self._repeated[name].add(position):
                left_out[f"{REPEATED} of joint '{name}' by a second publisher"] += 1
                continue
            steps = guard.add(stamp_ns, position)
            if steps.refused:
                left_out[f"{OFF_TRACK} of joint '{name}'"] += steps.refused
            for at_ns, q in steps.admitted:
                if not track.append(at_ns, q):
                    left_out[LATE] += 1
        return left_out

    def _is_within(self, name: str, position: float) -> bool:
        """Count a position as within or beyond its joint's limits; return whether to use it.

        If most positions violate the limits, the unit is wrong, and none is used.
        """
        low, high = self._limits[name]
        slack = LIMIT_SLACK * (high - low)
        is_within = low - slack <= position <= high + slack
        (self._within if is_within else self._beyond)[name] += 1
        return is_within and self._beyond[name] <= self._within[name]

    def _contradiction(self, name: str) -> str:
        low, high = self._limits[name]
        return f"positions of joint '{name}' beyond its limits {low:.4g} to {high:.4g}"

    def explain(self, track: ScalarTrack) -> str | None:
        """Return why a track has few or no samples; None if unknown."""
        name = next((name for name, known in self._tracks.items() if known is track), "")
        if self._beyond[name] > self._within[name]:
            return (
                f"{self._beyond[name]} {self._contradiction(name)} in the robot description; are "
                "they in degrees?"
            )
        return None

    def of(self, name: str) -> ScalarTrack:
        """Return the track of a joint; an empty one before the first sample."""
        return self._tracks.setdefault(name, ScalarTrack())

    def heard(self) -> list[str]:
        """Return the names of the joints that have samples, sorted."""
        return sorted(name for name, track in self._tracks.items() if len(track))

    def clear(self) -> None:
        """Forget all samples."""
        for track in self._tracks.values():
            track.clear()
        self._guards.clear()


def _joint_step(a: float, b: float) -> float:
    """Return the step between two positions; a joint that turns may wrap."""
    step = abs(b - a)
    return step if step < math.pi else abs(math.remainder(step, 2.0 * math.pi))
