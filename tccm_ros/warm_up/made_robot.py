"""The synthetic robot whose recordings call the kernels before the first record, and its drive."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import Event, Odometry, RobotDescription, Scan
from tccm_ros.records.building import scan_record
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams

START_NS = 1_000_000_000_000
PERIOD_NS = 25_000_000
BEAMS = 161

HEIGHT = 1.5
"""Height of the tilting laser, m."""

BEAM_S = 2e-5
"""Time between two beams, s, during which base and joints move."""

DRIVE_SCANS, DRIVE_STEP = 150, 0.15
"""Number of level scans, and maximum distance between two of them, m."""

LEVEL = "level_laser"
"""Frame of the level laser; that of the tilting one is `laser`."""

ROBOT = RobotDescription(
    f"""<robot name="warm_up">
    <link name="base"><collision><origin xyz="0 0 0.1"/>
      <geometry><box size="0.4 0.4 0.2"/></geometry></collision></link>
    <link name="laser"><collision><geometry><cylinder radius="0.02" length="0.04"/></geometry>
      </collision></link>
    <link name="{LEVEL}"/>
    <joint name="tilt" type="revolute"><parent link="base"/><child link="laser"/>
      <origin xyz="0 0 {HEIGHT}"/><axis xyz="0 1 0"/>
      <limit lower="-2" upper="2" effort="1" velocity="9"/></joint>
    <joint name="level" type="fixed"><parent link="base"/><child link="{LEVEL}"/>
      <origin xyz="0 0 0.3"/></joint></robot>"""
)


def with_own_robot(config: Config) -> Config:
    """Return the configuration for the synthetic robot instead of the user's."""
    made = config.model_copy(deep=True)
    made.rig.kinematics = "urdf"
    made.frames.tilt_joint, made.frames.base = "tilt", "base"
    made.localisation.source = "slam"
    return made


def events_of(records: Iterable[tuple[str, Any]], config: Config) -> Iterator[Event]:
    """Yield the events of records by role, posed by the synthetic robot."""
    robot = Robot(config, default_streams(config))
    for role, record in records:
        yield from robot.add(role, record)


def made_scan(stamp_ns: int, frame: str, bearings: Float64, ranges: Float64) -> Scan:
    """Return a scan whose beams are measured one after another.

    Parameters
    ----------
    stamp_ns, frame
        Stamp of the first beam, and the frame of the laser.
    bearings, ranges
        float64 (B,), evenly spaced, rad, and m.
    """
    first, step = float(bearings[0]), float(bearings[1] - bearings[0])
    end, duration = float(bearings[-1]), BEAM_S * len(bearings)
    numbers = (first, end, step, BEAM_S, duration, 0.05, 30.0)
    return scan_record(stamp_ns, frame, numbers, ranges.astype(np.float32))


def level_drive() -> Iterator[tuple[str, RobotDescription | Odometry | Scan]]:
    """Yield the level scans of a drive back and forth in a room of 7 by 5 m, with loops.

    The wall ahead has a step, so that two walls face the same way.
    """
    yield "robot_description", ROBOT
    bearings = np.linspace(-2.0, 2.0, BEAMS)
    for k in range(DRIVE_SCANS):
        stamp_ns, x = START_NS + k * PERIOD_NS, 1.5 * float(np.sin(DRIVE_STEP / 1.5 * k))
        T_odom_base = np.eye(4)
        T_odom_base[0, 3] = x
        yield "odom", Odometry(stamp_ns, "odom", "base", T_odom_base)
        c, s = np.cos(bearings), np.sin(bearings)
        wall = np.where(s > 0.0, 3.5, 4.0)
        ahead = np.where(c > 0.0, wall - x, 3.0 + x) / np.maximum(np.abs(c), 1e-9)
        ranges = np.minimum(ahead, 2.5 / np.maximum(np.abs(s), 1e-9))
        yield "scan", made_scan(stamp_ns, LEVEL, bearings, ranges)
