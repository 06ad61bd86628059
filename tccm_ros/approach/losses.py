"""What the base must not move without: its place, odometry and level scans that are new."""

from __future__ import annotations

import math

from tccm_ros.approach.outcome import Reason
from tccm_ros.approach.senses import Senses

POSE_S, SCAN_S = 0.3, 0.6
"""Age of odometry and of the level scan that stops the base, s. Chosen: six samples of 20 Hz, six
scans of 10 Hz; the base moves 6 cm at 0.2 m/s in the first."""


def loss_of(senses: Senses) -> tuple[Reason, str] | None:
    """Return what is lost, with a sentence; None where nothing is."""
    if senses.map_odom is None:
        return Reason.LOST_POSE, f"the robot does not know where it is: {senses.why_lost}"
    if senses.now_s - senses.pose_s > POSE_S:
        return Reason.LOST_POSE, f"no odometry for {senses.now_s - senses.pose_s:.1f} s"
    age = senses.now_s - senses.scan_s
    if age > SCAN_S:
        told = f"no level scan for {age:.1f} s" if math.isfinite(age) else "no level scan has come"
        return Reason.LOST_SCANS, told
    return None
