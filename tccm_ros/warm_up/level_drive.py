"""Level scans of the synthetic robot in a synthetic room."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tccm_ros.records import Odometry, RobotDescription, Scan
from tccm_ros.warm_up.made_robot import (
    BEAMS,
    LEVEL,
    PERIOD_NS,
    ROBOT,
    START_NS,
    made_scan,
)

DRIVE_SCANS, DRIVE_STEP = 150, 0.15
"""Number of level scans, and maximum distance between two of them, m."""


def level_drive() -> Iterator[tuple[str, RobotDescription | Odometry | Scan]]:
    """Yield the level scans of a drive back and forth in a room of 7 by 5 m, with loops."""
    yield "robot_description", ROBOT
    bearings = np.linspace(-2.0, 2.0, BEAMS)
    for k in range(DRIVE_SCANS):
        stamp_ns, x = START_NS + k * PERIOD_NS, 1.5 * float(np.sin(DRIVE_STEP / 1.5 * k))
        T_odom_base = np.eye(4)
        T_odom_base[0, 3] = x
        yield "odom", Odometry(stamp_ns, "odom", "base", T_odom_base)
        c, s = np.cos(bearings), np.sin(bearings)
        ahead = np.where(c > 0.0, 4.0 - x, 3.0 + x) / np.maximum(np.abs(c), 1e-9)
        ranges = np.minimum(ahead, 2.5 / np.maximum(np.abs(s), 1e-9))
        yield "scan", made_scan(stamp_ns, LEVEL, bearings, ranges)
