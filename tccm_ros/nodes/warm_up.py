"""Kernels are compiled (or read from numba's cache) before the first message, not in it.

A throw-away processor gets a small made-up room: a floor, two walls, a table with a box on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor
from tccm_ros.records import JointSample, Odometry, Scan
from tccm_ros.surfaces.surface_slam import SurfaceSlam

__all__ = ["warm_up_slam", "warm_up_tccm"]

START_NS = 1_000_000_000_000
PERIOD_NS = 25_000_000
SCANS = 110
"""Two sweeps and a half."""

BEAMS = 161
HEIGHT = 1.5
"""Of the tilting laser, m."""

Array = NDArray[np.float64]


def warm_up_tccm(config: Config) -> None:
    """Run some sweeps through a throw-away TCCM processor; once in a process for what is alike."""
    _sweep_once(config.model_dump_json())


def warm_up_slam(config: Config) -> None:
    """Drive a throw-away SLAM processor through a room; once in a process for what is alike."""
    _drive_once(config.model_dump_json())


@cache
def _sweep_once(config_json: str) -> tuple[CycleResult, ...]:
    processor = TccmProcessor(_rig_of(Config.model_validate_json(config_json)))
    results: list[CycleResult] = []
    for record in _sweeps():
        results += processor.add(record)
    results += processor.finish()
    processor.map.cuboids()
    return tuple(results)


@cache
def _drive_once(config_json: str) -> None:
    slam = SurfaceSlam(_rig_of(Config.model_validate_json(config_json)))
    for record in _drive():
        slam.add(record)
    for result in _sweep_once(config_json):
        slam.add(result.surfaces)
        slam.add(result.view)
    slam.finish()
    slam.solve()


def _rig_of(config: Config) -> Config:
    """Return the configuration with a rig of our own in place of the robot's."""
    made = config.model_copy(deep=True)
    for key, value in {
        "kinematics": "rig",
        "tilt_laser": (0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0),
        "tilt_center": None,
        "tilt_axis": (0.0, 1.0, 0.0),
        "level_laser": (0.0, 0.0, 0.3, 0.0, 0.0, 0.0),
    }.items():
        setattr(made.rig, key, value)
    made.frames.tilt_joint, made.frames.base = "tilt", "base"
    return made


def _sweeps() -> Iterator[Odometry | JointSample | Scan]:
    """Yield sweeps of a tilting laser over the room, each scan between two samples."""
    bearings = np.linspace(-1.2, 1.2, BEAMS)
    for k in range(SCANS):
        stamp_ns = START_NS + k * PERIOD_NS
        tilt = float(0.7 + 0.5 * np.sin(2.0 * np.pi * k / (SCANS / 1.3)))
        yield Odometry(stamp_ns, "odom", "base", np.eye(4))
        yield JointSample(stamp_ns, ("tilt",), np.array([tilt]))
        yield _scan(stamp_ns, bearings, _room_ranges(bearings, tilt))


def _scan(stamp_ns: int, bearings: Array, ranges: Array) -> Scan:
    step = float(bearings[1] - bearings[0])
    return Scan(
        stamp_ns, "laser", float(bearings[0]), step, 0.0, 0.05, 30.0, ranges.astype(np.float32)
    )


def _room_ranges(bearings: Array, tilt: float) -> Array:
    """Return ranges (B,) of beams from (0, 0, HEIGHT) that are tilted down."""
    x, y = np.cos(bearings) * np.cos(tilt), np.sin(bearings)
    z = -np.cos(bearings) * np.sin(tilt)
    with np.errstate(divide="ignore"):
        ranges = np.minimum(3.0 / np.abs(x), 3.0 / np.abs(y))
        ranges = np.minimum(ranges, np.where(z < 0.0, HEIGHT / -z, np.inf))
        for top, (x0, x1), half_width in ((0.7, (0.4, 1.4), 0.5), (0.85, (0.8, 0.95), 0.1)):
            far = np.where(z < 0.0, (HEIGHT - top) / -z, np.inf)
            hit = (far * x > x0) & (far * x < x1) & (np.abs(far * y) < half_width)
            ranges = np.where(hit, np.minimum(ranges, far), ranges)
    return ranges


def _drive() -> Iterator[Odometry | Scan]:
    """Yield level scans of a drive of two metres in a room of 7 by 5 m."""
    bearings = np.linspace(-2.0, 2.0, BEAMS)
    for k in range(SCANS):
        stamp_ns, x = START_NS + k * PERIOD_NS, 2.0 * k / SCANS
        T_odom_base = np.eye(4)
        T_odom_base[0, 3] = x
        yield Odometry(stamp_ns, "odom", "base", T_odom_base)
        if k % 3 == 0:
            c, s = np.cos(bearings), np.sin(bearings)
            ahead = np.where(c > 0.0, 4.0 - x, 3.0 + x) / np.maximum(np.abs(c), 1e-9)
            yield _scan(stamp_ns, bearings, np.minimum(ahead, 2.5 / np.maximum(np.abs(s), 1e-9)))
