"""Combine several recordings of one rig into one.

Each recording keeps its own time base, joint samples and places. Only the rig is common, so the
lasers must be mounted identically in all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.calibrate.recording import CalibrationRecording, CycleScans, LevelScans
from tccm_ros.errors import FrameError
from tccm_ros.robot.chain import JointReading

MOUNT_TOLERANCE = 1e-4
"""Tolerance of equal fixed transforms, m and 1 (chosen: rounding in robot descriptions)."""


def combine_recordings(recordings: Sequence[CalibrationRecording]) -> CalibrationRecording:
    """Return all recordings as one.

    Raises
    ------
    FrameError
        If a laser is mounted differently in two bags.
    """
    first = recordings[0]
    for other in recordings[1:]:
        _check_same_rig(first, other)
    ends = np.cumsum([0, *(len(recording.bag) for recording in recordings)]).tolist()
    level: dict[int, LevelScans] = {}
    for start, recording in zip(ends, recordings):
        level |= {start + place: scans for place, scans in recording.level.items()}
    return CalibrationRecording(
        _names([name for recording in recordings for name in recording.bags]),
        [cycle for recording in recordings for cycle in recording.cycles],
        np.concatenate([start + r.places for start, r in zip(ends, recordings)]),
        np.concatenate([number + r.bag for number, r in enumerate(recordings)]),
        np.concatenate([recording.poses for recording in recordings]),
        level,
        first.base,
        first.footprint_z,
        moving=any(recording.moving for recording in recordings),
    )


def _names(names: Sequence[str]) -> tuple[str, ...]:
    """Return unique names: bags of equal name get a number."""
    return tuple(
        name if names.count(name) == 1 else f"{name} ({number})"
        for number, name in enumerate(names, 1)
    )


def _check_same_rig(first: CalibrationRecording, other: CalibrationRecording) -> None:
    where = f"{other.bags[0]} is not of the rig of {first.bags[0]}"
    if other.base != first.base:
        raise FrameError(f"{where}: its base is '{other.base}', not '{first.base}'")
    difference = _difference(first.cycles[0], other.cycles[0])
    if difference is not None:
        raise FrameError(f"{where}: {difference}")
    mounts = [scans.T_base_laser for scans in (*first.level.values(), *other.level.values())]
    if any(np.abs(T - mounts[0]).max() > MOUNT_TOLERANCE for T in mounts):
        raise FrameError(f"{where}: the level laser is mounted elsewhere")
    if first.footprint_z != other.footprint_z:
        raise FrameError(f"{where}: the footprint is at another height")


def _difference(a: CycleScans, b: CycleScans) -> str | None:
    """Return how the chains to the tilting laser differ; None if they are equal."""
    names = [[part.name for part, _ in cycle.chain.parts] for cycle in (a, b)]
    if names[0] != names[1]:
        return f"its tilting laser is moved by {names[1]}, not by {names[0]}"
    kinds = [[type(part) for part, _ in cycle.chain.parts] for cycle in (a, b)]
    if kinds[0] != kinds[1]:
        return "joints come from /joint_states in one and from /tf in the other"
    for (one, _), (two, _) in zip(a.chain.parts, b.chain.parts):
        if (
            isinstance(one, JointReading)
            and isinstance(two, JointReading)
            and np.abs(one.axis - two.axis).max() > MOUNT_TOLERANCE
        ):
            return f"joint '{one.name}' turns about another axis"
    off = np.abs(a.chain.fixed - b.chain.fixed).max(axis=(1, 2))
    if (off > MOUNT_TOLERANCE).any():
        names[0].append("the laser")
        return f"the transform before {names[0][int(np.argmax(off))]} is another one"
    return None
