"""Check for missing or old inputs, without which the base must not move.

They are localisation, odometry, level scans and the obstacles of the integration map: tops beside
and behind the base are in no level scan.
"""

from __future__ import annotations

import math

from tccm_ros.approach.outcome import Reason
from tccm_ros.approach.readings import Readings

POSE_S, SCAN_S = 0.3, 0.6
"""Maximum ages of odometry and of the level scan, s: older data stop the base. Chosen: six samples
at 20 Hz, six scans at 10 Hz; the base moves 6 cm at 0.2 m/s in the first."""


def missing_input(readings: Readings, patience_s: float) -> tuple[Reason, str] | None:
    """Return reason and message if an input is missing or too old; None if all are current.

    Parameters
    ----------
    readings
        Newest measurements.
    patience_s
        Maximum age of the obstacles, s: they come once a tilt cycle.
    """
    if readings.map_odom is None:
        return Reason.LOST_POSE, f"the robot does not know where it is: {readings.why_lost}"
    if readings.now_s - readings.pose_s > POSE_S:
        return Reason.LOST_POSE, f"no odometry for {readings.now_s - readings.pose_s:.1f} s"
    for what, stamp_s, max_age_s in (
        ("level scan", readings.scan_s, SCAN_S),
        ("~/obstacles of tccm_node", readings.obstacles_s, patience_s),
    ):
        age = readings.now_s - stamp_s
        if age > max_age_s:
            since = f"for {age:.1f} s" if math.isfinite(age) else "yet"
            return Reason.LOST_SCANS, f"no {what} {since}"
    return None
