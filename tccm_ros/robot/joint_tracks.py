"""The positions of all joints over time, from any number of publishers."""

from __future__ import annotations

import math

from tccm_ros.records import JointSample
from tccm_ros.robot.tracks import ScalarTrack

MAX_JOINTS = 1024
"""Joints that are kept; further ones are left out. Chosen: more than any robot has."""


class JointTracks:
    """A track for each joint name.

    Parameters
    ----------
    time_offset_ns
        Added to the stamps of the samples.
    """

    def __init__(self, time_offset_ns: int):
        self._time_offset_ns = time_offset_ns
        self._tracks: dict[str, ScalarTrack] = {}

    def __len__(self) -> int:
        return len(self._tracks)

    def add(self, sample: JointSample) -> int:
        """Take a sample of some joints; return how many positions are left out as late.

        Positions that are not finite numbers are skipped.
        """
        late = 0
        stamp_ns = sample.stamp_ns + self._time_offset_ns
        for name, position in zip(sample.names, sample.positions.tolist()):
            if not math.isfinite(position):
                continue
            track = self._tracks.get(name)
            if track is None:
                if len(self._tracks) >= MAX_JOINTS:
                    continue
                track = self._tracks[name] = ScalarTrack()
            late += not track.append(stamp_ns, position)
        return late

    def of(self, name: str) -> ScalarTrack:
        """Return the track of a joint, an empty one if nothing was heard of it yet."""
        return self._tracks.setdefault(name, ScalarTrack())

    def heard(self) -> list[str]:
        """Return the names of the joints that have samples, sorted."""
        return sorted(name for name, track in self._tracks.items() if len(track))

    def clear(self) -> None:
        """Forget all samples."""
        for track in self._tracks.values():
            track.clear()
