"""Roll and pitch of the base at views by its IMU, relative to the mean over the whole run.

When a tilt cycle is posed, later drives are unknown. A solution uses all drives, so that views of
the first stop have roll and pitch as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.records import RollPitch
from tccm_ros.robot.roll_pitch import significant
from tccm_ros.robot.tracks import Track, bracket

MAX_GAP_NS = 500_000_000
"""Maximum gap between samples for interpolation (chosen)."""

QUANTUM = 0.00025
"""Quantisation step of the usual roll and pitch, rad. Chosen: 0.75 mm at 3 m; avoids small motions
of all views after each drive."""

UNBOUNDED_NS = 2**62
"""History of the samples: unlimited, as all views of a run may be solved again."""


class RollPitchTrack:
    """Samples of roll and pitch in stamp order."""

    def __init__(self) -> None:
        self._samples = Track(3, UNBOUNDED_NS)
        self._usual: Float64 | None = None

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: RollPitch) -> None:
        """Add a sample; one that is not newer than the previous one is dropped."""
        is_newer = self._samples.append(sample.stamp_ns, np.array([*sample.measured, sample.sigma]))
        if is_newer and sample.usual is not None:
            self._usual = np.round(np.array(sample.usual) / QUANTUM) * QUANTUM

    def at(self, stamps_ns: Sequence[int]) -> Float64:
        """Return roll and pitch relative to the usual value at V stamps, rad, float64 (V, 2).

        They are exactly 0 where they are insignificant or unknown.
        """
        found = np.zeros((len(stamps_ns), 2))
        if self._usual is None:
            return found
        times, values = self._samples.stamps_ns, self._samples.values
        for v, stamp in enumerate(stamps_ns):
            if not self._samples.brackets(stamp, stamp, MAX_GAP_NS):
                continue
            first, last, fraction = bracket(times, stamp)
            mixed = values[first, :2] + fraction * (values[last, :2] - values[first, :2])
            found[v] = significant(mixed - self._usual, max(values[first, 2], values[last, 2]))
        return found
