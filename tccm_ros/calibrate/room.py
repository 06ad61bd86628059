"""Tilt, flatness and parallelism of floor and ceiling of each recording, before and after."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tccm_ros.calibrate.model import CycleBeams
from tccm_ros.calibrate.observability import Observability
from tccm_ros.calibrate.quality import Flatness, HitMasks, all_beams, flatness, select
from tccm_ros.calibrate.recording import CalibrationRecording
from tccm_ros.results.numbers import plain


@dataclass(frozen=True, slots=True)
class FloorAndCeiling:
    """Floor and ceiling of one recording.

    Attributes
    ----------
    bag, cycles, places
        Name of the recording, and numbers of used tilt cycles and places.
    floor, ceiling
        Flatness (before, after) of the same hits; None with too few hits.
    parallel
        Angle between floor and ceiling (before, after), rad; None without both.
    """

    bag: str
    cycles: int
    places: int
    floor: tuple[Flatness | None, Flatness | None]
    ceiling: tuple[Flatness | None, Flatness | None]
    parallel: tuple[float, float] | None

    def to_json(self) -> dict[str, Any]:
        """Return all values as plain numbers, rounded to 1e-6."""
        content: dict[str, Any] = plain(self)
        for surface in filter(None, content["floor"] + content["ceiling"]):
            del surface["normal"]
        return content

    def text(self) -> list[str]:
        """Return lines of text for users."""
        lines = []
        for name, (before, after) in (("floor", self.floor), ("ceiling", self.ceiling)):
            if before is not None and after is not None:
                flat = ""
                if before.rms is not None and after.rms is not None:
                    flat = f", flat to {before.rms * 1e3:.1f} -> {after.rms * 1e3:.1f} mm"
                lines.append(
                    f"  {name:<18} tilted by {np.rad2deg(before.tilt):.2f} -> "
                    f"{np.rad2deg(after.tilt):.2f} deg{flat} in {after.cells} cells"
                )
        if self.parallel is not None:
            a, b = np.rad2deg(self.parallel)
            lines.append(f"  floor and ceiling  parallel to {a:.2f} -> {b:.2f} deg")
        return lines


def rooms(
    observability: Observability, recording: CalibrationRecording
) -> tuple[FloorAndCeiling, ...]:
    """Return floor and ceiling of each recording, from all its hits."""
    return tuple(_room(observability, recording, bag) for bag in range(len(recording.bags)))


def hits_of_bag(
    observability: Observability,
    recording: CalibrationRecording,
    bag: int,
    cycles: slice | None = None,
) -> tuple[CycleBeams, HitMasks]:
    """Return hits of a bag, and masks of floor and ceiling.

    Parameters
    ----------
    observability, recording
        The calibration and its input.
    bag
        Index of the bag.
    cycles
        Tilt cycles of the bag to use; None for all.
    """
    found = observability.estimate
    layout, x = found.problem.layout, found.solution.x
    first, last = recording.cycles_of(bag)
    mine = recording.cycles[first:last][cycles or slice(None)]
    beams = all_beams(mine, first)
    at = layout.ceiling(bag).start
    floor = float(x[layout.floor]) if found.free[layout.floor] else None
    ceiling = float(x[at]) if found.free[at] else None
    heights = found.problem.model.transform_points(beams, found.values)[:, 2]
    return beams, select(mine, heights, floor, ceiling)


def _room(
    observability: Observability, recording: CalibrationRecording, bag: int
) -> FloorAndCeiling:
    found = observability.estimate
    beams, seen = hits_of_bag(observability, recording, bag)
    both = []
    for values in (found.configured, found.values):
        points = found.problem.model.transform_points(beams, values)
        both.append((flatness(points[seen.floor]), flatness(points[seen.ceiling])))
    (floor_before, ceiling_before), (floor_after, ceiling_after) = both
    angles = [
        float(np.arccos(min(abs(np.dot(floor.normal, ceiling.normal)), 1.0)))
        for floor, ceiling in both
        if floor is not None and ceiling is not None
    ]
    first, last = recording.cycles_of(bag)
    return FloorAndCeiling(
        recording.bags[bag],
        last - first,
        int((recording.bag == bag).sum()),
        (floor_before, floor_after),
        (ceiling_before, ceiling_after),
        (angles[0], angles[1]) if len(angles) == 2 else None,
    )
