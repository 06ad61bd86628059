"""Tilt cycles of recordings and simulated scenes, saved for `ablate_cycles.py`.

    python bench/saved_cycles.py FILE BAG     some cycles of a recording, with its truth
    python bench/saved_cycles.py FILE         situations A to D of the simulator

A cycle is kept with the cuboids of the integration map after it, so that a trial finds planes,
objects and surface messages without reading and binning.
"""

from __future__ import annotations

import json
import pickle
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "bench"), str(ROOT / "test" / "helpers")]

from plane_scenes import REGION, error, eye, part_map_of, subject_fit, subject_points  # noqa: E402
from situation_cycle import Cycle, cycle  # noqa: E402

from tccm_ros.arrays import Float64  # noqa: E402
from tccm_ros.bags.reader import BagReader  # noqa: E402
from tccm_ros.config import Config  # noqa: E402
from tccm_ros.cuboids.caps import no_caps  # noqa: E402
from tccm_ros.cuboids.cuboids import Cuboids  # noqa: E402
from tccm_ros.cuboids.cycle_builder import TiltCycleData  # noqa: E402
from tccm_ros.geometry import transform  # noqa: E402
from tccm_ros.mapping.surface_message import object_boxes, surface_cloud, view_intervals  # noqa: E402
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor  # noqa: E402
from tccm_ros.planes import find_planes  # noqa: E402
from tccm_ros.planes.tracking import PlaneTracker  # noqa: E402
from tccm_ros.records import SurfaceCloud  # noqa: E402
from tccm_ros.replay.run import _plan, add_latched  # noqa: E402
from tccm_ros.robot import Robot  # noqa: E402

CYCLES = 4
"""Cycles of a recording that are kept, evenly over it."""

SEEDS = 8
"""Noise of each situation."""

SIGMAS = 0.0025, 0.005
"""Range noise of the situations, m."""

CELL = 0.05
"""Edge of the cells in which the covered part of a true surface is measured, m."""

MAX_HEIGHT_ERROR, MAX_OUTSIDE = 0.02, 0.03
"""A point is on a true surface within this height and distance from its outline, m."""


@dataclass(frozen=True)
class SavedCycle:
    """A tilt cycle, the map after it, and the true pose of the base."""

    data: TiltCycleData
    cuboids: Cuboids
    T_map_base: Float64


@dataclass(frozen=True)
class Recording:
    """Cycles of a recording, and the content of its truth.json."""

    cycles: list[SavedCycle]
    truth: dict[str, Any]

    def row(self) -> str:
        """Return cover, m2, false points, %, height rms, mm, planes, objects, free intervals."""
        config, tracker = Config(), PlaneTracker(Config())
        covers, clouds, errors, counts = [], [], [], np.zeros(3, int)
        for saved in self.cycles:
            cycle_data, view = saved.data, saved.data.T_odom_sensor()[:3, 3]
            T = cycle_data.T_odom_base()
            fits = find_planes(saved.cuboids, config, view)
            planes = tracker.update(fits)
            cloud = surface_cloud(cycle_data, fits, T, view, "base", True, config)
            boxes = object_boxes(cycle_data, fits, planes, config, T, "base", True)
            free = view_intervals(cycle_data, config, T, "base")
            counts += len(fits), len(boxes.points), len(free.intervals)
            cover, is_true, off = self._compared(saved, cloud)
            covers.append(cover)
            clouds.append(is_true)
            errors.append(off)
        false = 100.0 * (1.0 - np.concatenate(clouds).mean())
        rms = 1e3 * np.sqrt((np.concatenate(errors) ** 2).mean())
        numbers = " ".join(map(str, counts))
        return f"{np.mean(covers):.3f} {false:.2f} {rms:.2f} {numbers}"

    def _compared(self, saved: SavedCycle, cloud: SurfaceCloud) -> tuple[float, Any, Float64]:
        """Return the covered area, m2, which points off the floor are true, and height errors."""
        points = transform(saved.T_map_base, cloud.points.astype(np.float64))
        floor = float(self.truth.get("floor", self.truth.get("floor_z") or 0.0))
        points = points[points[:, 2] > floor + 0.1]
        is_true, errors, area = np.zeros(len(points), bool), [], 0.0
        for surface in self.truth["surfaces"]:
            if surface["label"] == "floor":
                continue
            ring = np.array(surface["boundary"])
            height = surface.get("height", ring[0, -1])
            outline = shapely.Polygon(ring[:, :2]).buffer(MAX_OUTSIDE)
            on = np.abs(points[:, 2] - height) <= MAX_HEIGHT_ERROR
            on[on] = shapely.contains_xy(outline, *points[on, :2].T)
            is_true |= on
            errors.append(points[on, 2] - height)
            area += len(np.unique(np.floor(points[on, :2] / CELL), axis=0)) * CELL**2
        return area, is_true, np.concatenate(errors)


@dataclass(frozen=True)
class Situations:
    """Simulated tilt cycles over the situations A to D, with the cuboids of each."""

    cycles: list[tuple[str, Cycle, Cuboids]]

    def row(self) -> str:
        """Return the rms error, mm, of each situation in part maps, then in integration maps."""
        texts, misses = [], 0
        for has_caps in (True, False):
            errors: dict[str, list[float]] = {}
            for name, simulated, cuboids in self.cycles:
                own = cuboids if has_caps else without_caps(cuboids)
                middle = subject_points(simulated).mean(axis=0)
                fit = subject_fit(find_planes(own, Config(), eye(simulated)), simulated, middle)
                if fit is None:
                    misses += 1
                    continue
                mm, _ = error(fit.normal, fit.offset, simulated, middle)
                errors.setdefault(name, []).append(mm)
            texts += [f"{np.sqrt(np.mean(np.square(mm))):.3f}" for mm in errors.values()]
        return " ".join((*texts, str(misses)))


def without_caps(cuboids: Cuboids) -> Cuboids:
    """Return cuboids as those of an integration map."""
    return replace(cuboids, caps=no_caps())


class _Recorder(TccmProcessor):
    """A processor that keeps its tilt cycles, with the map after each."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.cycles: list[tuple[TiltCycleData, Cuboids]] = []

    def _result(self, cycle: TiltCycleData, *args: Any) -> CycleResult:
        result = super()._result(cycle, *args)
        self.cycles.append((cycle, self.map.cuboids()))
        return result


def record(bag: Path) -> Recording:
    """Return some cycles of a recording."""
    with BagReader(bag) as reader:
        config, choice, _ = _plan(reader, Config(), ())
        robot = Robot(config, choice.streams, expects_odometry=choice.counts["odom"] > 0)
        recorder = _Recorder(config)
        add_latched(reader, choice.topics, robot)
        for role, _, message in reader.records(choice.topics):
            for event in robot.add(role, message):
                recorder.add(event)
    for event in robot.flush():
        recorder.add(event)
    recorder.finish()
    poses = np.loadtxt(bag / "truth.tum")
    cycles = recorder.cycles
    chosen = np.unique(np.linspace(0, len(cycles) - 1, CYCLES + 2).astype(int)[1:-1])
    saved = [
        SavedCycle(cycles[k][0], cycles[k][1], pose_at(poses, cycles[k][0].stamp_ns))
        for k in chosen
    ]
    return Recording(saved, json.loads((bag / "truth.json").read_text()))


def pose_at(poses: Float64, stamp_ns: int) -> Float64:
    """Return the pose (4, 4) of a TUM trajectory nearest in time."""
    row = poses[np.abs(poses[:, 0] - stamp_ns * 1e-9).argmin()]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(row[4:]).as_matrix(), row[1:4]
    return T


def simulate() -> Situations:
    """Return simulated tilt cycles."""
    cycles = []
    for name in "abcd":
        for sigma in SIGMAS:
            for seed in range(SEEDS):
                simulated = cycle(name, sigma, seed, room=True)
                cycles.append((name, simulated, part_map_of(simulated, Config(), REGION)))
    return Situations(cycles)


def load(path: Path) -> Recording | Situations:
    """Return what was saved."""
    # The classes are those of this module, whichever program saved them.
    sys.modules.setdefault("saved_cycles", sys.modules[__name__])
    found: Recording | Situations = pickle.loads(path.read_bytes())
    return found


if __name__ == "__main__":
    import saved_cycles

    target = Path(sys.argv[1])
    found = saved_cycles.record(Path(sys.argv[2])) if sys.argv[2:] else saved_cycles.simulate()
    target.write_bytes(pickle.dumps(found))
