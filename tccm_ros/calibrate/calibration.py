"""`tccm calibrate`: estimate the rig from a bag and write it as a configuration."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tccm_ros.calibrate.estimate import estimate
from tccm_ros.calibrate.judge import UNITS, Judgement, judge
from tccm_ros.calibrate.layout import Trust
from tccm_ros.calibrate.quality import Flatness, all_beams, flatness, select
from tccm_ros.calibrate.reading import read_recording
from tccm_ros.calibrate.sweeps import Recording
from tccm_ros.config import Config, Rig
from tccm_ros.progress import Bars, Silent

__all__ = ["Calibration", "calibrate"]


Pose6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What a recording says of a rig.

    Attributes
    ----------
    bag
        Name of the bag.
    rig
        The corrected parameters of the group `rig`; what is not determined is as configured.
    before
        The configured ones.
    judgement
        Quantities with standard deviations and covariance, and why others were left alone.
    recording
        What was used.
    floor, ceiling
        Flatness (before, after) of the same hits, None where too little was seen.
    parallel
        Angle between floor and ceiling (before, after), rad, None without both.
    assumptions
        What the result rests on, one sentence each.
    """

    bag: str
    rig: Rig
    before: Rig
    judgement: Judgement
    recording: Recording
    floor: tuple[Flatness | None, Flatness | None]
    ceiling: tuple[Flatness | None, Flatness | None]
    parallel: tuple[float, float] | None
    assumptions: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain numbers, rounded to 1e-6."""
        names = self.judgement.determined
        return {
            "format": "tccm_ros/calibration",
            "version": 1,
            "bag": self.bag,
            "rig": _changed(self.rig),
            "quantities": {
                q.name: {
                    "value": round(q.value, 6),
                    "sigma": None if q.sigma is None else round(q.sigma, 6),
                    "determined": q.is_determined,
                    "reason": q.reason,
                }
                for q in self.judgement.quantities
            },
            "covariance": {
                "order": list(names),
                "matrix": [[float(f"{v:.6e}") for v in row] for row in self.judgement.covariance],
            },
            "floor": [_flatness_json(f) for f in self.floor],
            "ceiling": [_flatness_json(f) for f in self.ceiling],
            "parallel": None if self.parallel is None else [round(a, 6) for a in self.parallel],
            "sweeps": len(self.recording.sweeps),
            "places": int(self.recording.places.max()) + 1,
            "assumptions": list(self.assumptions),
        }

    def text(self) -> str:
        """Return the result for people."""
        lines = [f"{self.bag}: {_count(len(self.recording.sweeps), 'sweep')}"]
        for q in self.judgement.quantities:
            unit, factor = UNITS[q.name]
            sigma = "" if q.sigma is None else f" +- {q.sigma * factor:.4f}"
            state = "" if q.is_determined else f"  left alone: {q.reason}"
            lines.append(f"  {q.name:<18} {q.value * factor:9.4f}{sigma} {unit}".rstrip() + state)
        for name, (before, after) in (("floor", self.floor), ("ceiling", self.ceiling)):
            if before is not None and after is not None:
                flat = ""
                if before.rms is not None and after.rms is not None:
                    flat = f", flat to {before.rms * 1e3:.1f} -> {after.rms * 1e3:.1f} mm"
                lines.append(
                    f"  {name:<18} level to {np.rad2deg(before.tilt):.2f} -> "
                    f"{np.rad2deg(after.tilt):.2f} deg{flat} in {after.cells} cells"
                )
        if self.parallel is not None:
            a, b = np.rad2deg(self.parallel)
            lines.append(f"  floor and ceiling  parallel to {a:.2f} -> {b:.2f} deg")
        return "\n".join([*lines, *(f"  {text}" for text in self.assumptions)])

    def yaml(self) -> str:
        """Return a parameter file for ``--config`` and ``--params-file``, with comments."""
        lines = [
            f"# Made by `tccm calibrate {self.bag}`.",
            *(f"# {text}" for text in self.assumptions),
            *(
                f"# {q.name}: left alone, {q.reason}"
                for q in self.judgement.quantities
                if not q.is_determined
            ),
            "/**:",
            "  ros__parameters:",
            "    rig:",
        ]
        for key, value in _changed(self.rig).items():
            text = json.dumps(value)
            lines.append(f"      {key}: {text}{self._comment(key)}")
        return "\n".join(lines) + "\n"

    def _comment(self, key: str) -> str:
        parts = {
            "mount_correction": ("roll", "height"),
            "level_correction": ("level_x", "level_y", "level_yaw"),
        }.get(key, (key,))
        notes = []
        for q in self.judgement.quantities:
            if q.name in parts and q.sigma is not None:
                unit, factor = UNITS[q.name]
                text = f"{q.name} {q.value * factor:.4f} +- {q.sigma * factor:.4f} {unit}"
                notes.append(text.rstrip())
        return f"  # {', '.join(notes)}" if notes else "  # as it was"


def calibrate(
    bag: Path | str,
    config: Config | None = None,
    remap: Sequence[str] = (),
    *,
    floor_z: float | None = None,
    trust: Trust | None = None,
    bars: Bars | None = None,
) -> Calibration:
    """Estimate what is wrong with a rig from a recording of a floor, and perhaps ceiling and walls.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file.
    config
        What the rig is believed to be; what is not determined stays so.
    remap
        ``scan:=/base_scan`` for topics with other names.
    floor_z
        Height of the floor in the base frame, m. None: 0 where a frame whose name ends in
        ``footprint`` says so, else the height of the laser stays.
    trust
        What is taken for granted of buildings and bases.
    bars
        Where progress is shown.

    Raises
    ------
    BagError, TopicError, FrameError, UrdfError
        Where the bag cannot be read, the laser cannot be placed, or nothing flat was seen.
    """
    config, trust, bars = config or Config(), trust or Trust(), bars or Silent()
    recording = read_recording(bag, config, remap, bars)
    floor_z = recording.footprint_z if floor_z is None else floor_z
    judgement = judge(estimate(recording, config, floor_z, trust, bars), floor_z)
    rig = _rig(judgement, config.rig)
    floor, ceiling, parallel = _flatness(judgement, recording)
    return Calibration(
        Path(bag).name, rig, config.rig, judgement, recording, floor, ceiling, parallel,
        _assumptions(recording, trust),
    )  # fmt: skip


def _assumptions(recording: Recording, trust: Trust) -> tuple[str, ...]:
    places = int(recording.places.max()) + 1
    where = "one place" if places == 1 else f"{places} places"
    lean = (
        f"A leaning base looks like a wrong tilt zero or roll: the base is taken to stand level "
        f"within {np.rad2deg(trust.lean):.2g} deg at each of {where}; more places and headings "
        f"average it out."
    )
    if not recording.moving:
        return (lean,)
    return (lean, "The base moved during all sweeps: odometry errors are in the result.")


def _rig(judgement: Judgement, configured: Rig) -> Rig:
    found = judgement.estimate
    layout, x = found.problem.layout, found.solution.x
    values = found.values
    mount = _rpy(found.problem.model.mount(values))
    level = configured.level_correction
    for hits in found.problem.level[:1]:
        T = found.problem.level_mount(x[layout.level], hits.scans.T_base_laser)
        level = _rpy(T)
    updates = {
        "tilt_offset": round(values.tilt_offset, 6),
        "tilt_scale": round(values.tilt_scale, 6),
        "joint_time_offset": round(values.joint_time_offset, 6),
        "mount_correction": mount,
        "level_correction": level,
    }
    return configured.model_copy(update=updates)


def _rpy(T: NDArray[np.float64]) -> Pose6:
    """Return x, y, z, roll, pitch, yaw of a pose, without negative zeros."""
    angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    x, y, z, roll, pitch, yaw = (round(float(v), 6) + 0.0 for v in (*T[:3, 3], *angles))
    return x, y, z, roll, pitch, yaw


def _changed(rig: Rig) -> dict[str, Any]:
    return {
        "tilt_offset": rig.tilt_offset,
        "tilt_scale": rig.tilt_scale,
        "joint_time_offset": rig.joint_time_offset,
        "mount_correction": list(rig.mount_correction),
        "level_correction": list(rig.level_correction),
    }


def _flatness(judgement: Judgement, recording: Recording) -> tuple[Any, Any, Any]:
    found = judgement.estimate
    layout, model, x = found.problem.layout, found.problem.model, found.solution.x
    beams = all_beams(recording.sweeps)
    floor = float(x[layout.floor]) if found.free[layout.floor] else None
    ceiling = float(x[layout.ceiling.start]) if found.free[layout.ceiling.start] else None
    heights = model.place(beams, found.values)[:, 2]
    seen = select(recording.sweeps, heights, floor, ceiling)
    both = []
    for values in (found.configured, found.values):
        points = model.place(beams, values)
        both.append((flatness(points[seen.floor]), flatness(points[seen.ceiling])))
    (floor_before, ceiling_before), (floor_after, ceiling_after) = both
    parallel = tuple(
        float(np.arccos(min(abs(np.dot(f.normal, c.normal)), 1.0)))
        for f, c in both
        if f is not None and c is not None
    )
    return (
        (floor_before, floor_after),
        (ceiling_before, ceiling_after),
        parallel if len(parallel) == 2 else None,
    )


def _flatness_json(found: Flatness | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "tilt": round(found.tilt, 6),
        "rms": None if found.rms is None else round(found.rms, 6),
        "height": round(found.height, 6),
        "cells": found.cells,
    }


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")
