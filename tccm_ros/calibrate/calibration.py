"""`tccm calibrate`: estimate the rig from recordings and write it as a configuration."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.arrays import Float64
from tccm_ros.calibrate.agreement import Agreement, compare
from tccm_ros.calibrate.beam_timing import BeamTiming, read_beam_timing
from tccm_ros.calibrate.combine_recordings import combine_recordings
from tccm_ros.calibrate.estimate import estimate
from tccm_ros.calibrate.layout import AssumptionSigmas
from tccm_ros.calibrate.observability import UNITS, Observability, assess_observability
from tccm_ros.calibrate.reading import CORRECTIONS, MAX_CYCLES, read_recording
from tccm_ros.calibrate.recording import CalibrationRecording
from tccm_ros.calibrate.room import FloorAndCeiling, rooms
from tccm_ros.config import Config, RigConfig
from tccm_ros.errors import BagError
from tccm_ros.progress import Bars

MAX_CYCLES_OF_ALL, MIN_CYCLES = 48, 4
"""Maximum number of tilt cycles from all bags, and minimum per bag (chosen: limits the computing
time)."""

Pose6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The corrected parameters of a rig, and their basis.

    Attributes
    ----------
    bags
        Names of the bags.
    rig
        The corrected parameters of the group `rig`; undetermined ones are as configured.
    before
        The configured parameters.
    observability
        Quantities with standard deviations and covariance, and why others were not estimated.
    recording
        The data used.
    rooms
        Floor and ceiling of each bag.
    agreement
        Agreement of several bags on the rig; None for a single bag.
    assumptions
        Assumptions of the result, one sentence each.
    beams
        Corrected beam times of the level laser; None if the configured ones are correct.
    """

    bags: tuple[str, ...]
    rig: RigConfig
    before: RigConfig
    observability: Observability
    recording: CalibrationRecording
    rooms: tuple[FloorAndCeiling, ...]
    agreement: Agreement | None
    assumptions: tuple[str, ...]
    beams: BeamTiming | None = None

    def to_json(self) -> dict[str, Any]:
        """Return all values as plain numbers, rounded to 1e-6."""
        names = self.observability.determined
        return {
            "format": "tccm_ros/calibration",
            "version": 2,
            "bags": list(self.bags),
            "rig": self.rig.model_dump(mode="json", include=set(CORRECTIONS)),
            "quantities": {
                q.name: {
                    "value": round(q.value, 6),
                    "sigma": None if q.sigma is None else round(q.sigma, 6),
                    "determined": q.is_determined,
                    "reason": q.reason,
                }
                for q in self.observability.quantities
            },
            "covariance": {
                "order": list(names),
                "matrix": [
                    [float(f"{v:.6e}") for v in row] for row in self.observability.covariance
                ],
            },
            "rooms": [room.to_json() for room in self.rooms],
            "agreement": None if self.agreement is None else self.agreement.to_json(),
            "assumptions": list(self.assumptions),
            "scan": None
            if self.beams is None
            else {"reverse": self.beams.reverse, "time_offset": self.beams.time_offset},
        }

    def text(self) -> str:
        """Return the result as text for users."""
        noun = "depth image" if self.recording.cycles[0].is_image else "tilt cycle"
        lines = [f"{', '.join(self.bags)}: {_count(len(self.recording.cycles), noun)}"]
        for q in self.observability.quantities:
            unit, factor = UNITS[q.name]
            sigma = "" if q.sigma is None else f" +- {q.sigma * factor:.4f}"
            remark = "" if q.is_determined else f"  not estimated: {q.reason}"
            lines.append(f"  {q.name:<18} {q.value * factor:9.4f}{sigma} {unit}".rstrip() + remark)
        for room in self.rooms:
            lines += [f"  {room.bag}" for _ in self.rooms[1:2]] + room.text()
        if self.beams is not None:
            order = "from the last to the first" if self.beams.reverse else "in their order"
            lines.append(
                f"  level laser: beams {order}, stamps {1e3 * self.beams.time_offset:+.0f} ms"
            )
        return "\n".join([*lines, *(f"  {text}" for text in self.assumptions)])

    def yaml(self) -> str:
        """Return a parameter file for ``--config`` and ``--params-file``, with comments."""
        lines = [
            f"# Made by `tccm calibrate {' '.join(self.bags)}`.",
            *(f"# {text}" for text in self.assumptions),
            *(
                f"# {q.name}: not estimated, {q.reason}"
                for q in self.observability.quantities
                if not q.is_determined
            ),
            "/**:",
            "  ros__parameters:",
            *self._tilt_joint_lines(),
            *self._beam_lines(),
            "    rig:",
        ]
        for key, value in self.rig.model_dump(mode="json", include=set(CORRECTIONS)).items():
            text = json.dumps(value)
            lines.append(f"      {key}: {text}{self._comment(key)}")
        return "\n".join(lines) + "\n"

    def _beam_lines(self) -> list[str]:
        """Return the YAML lines with the beam times of the level laser."""
        if self.beams is None:
            return []
        return [
            "    scan:",
            f"      reverse: {json.dumps(self.beams.reverse)}",
            f"      time_offset: {self.beams.time_offset}",
        ]

    def _tilt_joint_lines(self) -> list[str]:
        """Return the YAML lines with the tilt joint of a head, for corrections of a camera."""
        cycle = self.recording.cycles[0]
        if not cycle.is_image:
            return []
        return ["    frames:", f"      tilt_joint: {cycle.chain.parts[cycle.tilt][0].name}"]

    def _comment(self, key: str) -> str:
        parts = {
            "mount_correction": ("roll", "height"),
            "level_correction": ("level_x", "level_y", "level_yaw"),
        }.get(key, (key,))
        notes = []
        for q in self.observability.quantities:
            if q.name in parts and q.sigma is not None:
                unit, factor = UNITS[q.name]
                text = f"{q.name} {q.value * factor:.4f} +- {q.sigma * factor:.4f} {unit}"
                notes.append(text.rstrip())
        return f"  # {', '.join(notes)}" if notes else "  # as it was"


def calibrate(
    bags: Path | str | Sequence[Path | str],
    config: Config | None = None,
    remap: Sequence[str] = (),
    *,
    floor_z: float | None = None,
    assumed: AssumptionSigmas | None = None,
    bars: Bars | None = None,
) -> Calibration:
    """Estimate the errors of a rig from recordings of a floor, and optionally ceiling and walls.

    Parameters
    ----------
    bags
        One or several rosbag2 folders, .mcap or .db3 files, all of one rig.
    config
        Believed parameters of the rig; undetermined ones are kept.
    remap
        Remappings such as ``scan:=/base_scan``.
    floor_z
        Height of the floor in the base frame, m. None: 0 if a frame whose name ends in
        ``footprint`` is at that height, else the configured height of the laser is kept.
    assumed
        Standard deviations of the assumptions on buildings and bases.
    bars
        Progress bars.

    Raises
    ------
    BagError, TopicError, FrameError, UrdfError
        Where a bag cannot be read, the laser has no pose, no plane was observed, or the bags are of
        different rigs.
    """
    config, assumed, bars = config or Config(), assumed or AssumptionSigmas(), bars or Bars()
    paths = [bags] if isinstance(bags, Path | str) else list(bags)
    if len({Path(path).resolve() for path in paths}) < len(paths):
        raise BagError("a bag is named twice; name each bag once")
    max_cycles = int(np.clip(MAX_CYCLES_OF_ALL // len(paths), MIN_CYCLES, MAX_CYCLES))
    recordings = [
        read_recording(path, config, remap, bars, max_cycles=max_cycles) for path in paths
    ]
    recording = combine_recordings(recordings)
    floor_z = recording.footprint_z if floor_z is None else floor_z
    agreement = None
    if len(recordings) > 1:
        alone = [estimate(one, config, floor_z, assumed, bars) for one in recordings]
        agreement = compare(recording.bags, alone)
        agreement.check()
    observability = assess_observability(estimate(recording, config, floor_z, assumed, bars))
    return Calibration(
        recording.bags, _rig(observability, config.rig), config.rig, observability, recording,
        rooms(observability, recording), agreement, _assumptions(recording, assumed),
        _beams(paths, config, remap),
    )  # fmt: skip


def _beams(paths: Sequence[Path | str], config: Config, remap: Sequence[str]) -> BeamTiming | None:
    """Return the beam times of the first bag in which they differ from the configured ones."""
    for path in paths:
        found = read_beam_timing(path, config, remap)
        if found is not None and found.is_significant:
            return found.best
    return None


def _assumptions(recording: CalibrationRecording, assumed: AssumptionSigmas) -> tuple[str, ...]:
    places = int(recording.places.max()) + 1
    where = "one place" if places == 1 else f"{places} places"
    base_tilt = (
        f"A tilted base looks like a wrong tilt zero or roll: the base is assumed to be level "
        f"within {np.rad2deg(assumed.base_tilt):.2g} deg at each of {where}; more places and "
        f"headings average it out."
    )
    if recording.cycles[0].pan is not None:
        base_tilt = f"{base_tilt} The pan zero is relative to the level laser as configured."
    if not recording.moving:
        return (base_tilt,)
    return (base_tilt, "The base moved during all tilt cycles: odometry errors are in the result.")


def _rig(observability: Observability, configured: RigConfig) -> RigConfig:
    found = observability.estimate
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
        "pan_offset": round(values.pan_offset, 6),
        "mount_correction": mount,
        "level_correction": level,
    }
    return configured.model_copy(update=updates)


def _rpy(T: Float64) -> Pose6:
    """Return x, y, z, roll, pitch, yaw of a pose, without negative zeros."""
    angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    x, y, z, roll, pitch, yaw = (round(float(v), 6) + 0.0 for v in (*T[:3, 3], *angles))
    return x, y, z, roll, pitch, yaw


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
