"""Reasons for dropped scans, with advice."""

from __future__ import annotations

from collections import Counter

from tccm_ros.robot.stamp_guard import ANOTHER_CLOCK
from tccm_ros.robot.stamp_order import LATE, TWICE, ZERO
from tccm_ros.sensors.laser_scan import LIMITS_TOO_FAR, NO_LIMITS, NOTHING_SEEN, OUT_OF_LIMITS

ADVICE = {
    "no joint samples": "joint samples have to bracket each scan: look at 'joint_states', its rate "
    "(50 Hz or more) and its clock",
    "no odometry": "odometry has to bracket each scan: look at 'odom', its rate and its clock",
    "no transform": "transforms have to bracket each scan: look at /tf, its rate and its clock",
    "no way from base to sensor": "publish robot_description and joint_states, or set rig.*",
    "future stamp": "a stamp lies ahead of all others: look at the clock of the laser's driver",
    LATE: "records come later than reorder_window behind their successors: raise it, or "
    "look for two publishers of the scan topic",
    ANOTHER_CLOCK: "stamps went back while those of the other inputs went on: set the clock of "
    "the driver, or qos.stamp to receive",
    "before the start": "the queue was full while kernels were compiled",
    TWICE: "stamps repeat: look for two publishers of the scan topic",
    ZERO: "no time is in the header: have the driver write it, or set qos.stamp to receive",
    "too many streams": "more publishers than any robot has: look for names that change with each "
    "message, in joint_states or tf",
    NOTHING_SEEN: "every range says that nothing is there: look at the sensor, its cover and its "
    "range_max",
    LIMITS_TOO_FAR: "look at range_min and range_max of the laser's driver: both are in m",
    NO_LIMITS: "look at range_min and range_max of the laser's driver: both are in m",
    OUT_OF_LIMITS: "look at range_min and range_max of the laser's driver: they and the ranges are "
    "in m",
    "malformed": "angles and times have to be finite numbers: look at the laser's driver",
    "empty": "scans have no beams: look at the laser's driver",
    "no camera info": "each depth image needs a calibration beside it: look at 'camera_info', or "
    "remap it",
    "camera info of another frame": "the calibration has another frame_id than the image: look at "
    "the camera's driver",
    "image and camera info of different sizes": "the calibration is of another size than the "
    "image: look at the camera's driver",
    "unknown distortion model": "lenses of plumb_bob and rational_polynomial are known: take "
    "rectified images",
    "no depths": "depth images hold nothing: look at the camera, its cover and its range",
    "overload": "more comes in than can be processed: fewer beams, a slower laser or a faster CPU",
}


PAUSED = "paused"
"""Reason for records dropped while the node is paused."""

ORDINARY = ("short tilt cycle", "joint rests", "clock jump", PAUSED)
"""Reasons that are no problem: the laser came to rest, a new map began, which was logged, or the
node is paused."""

MIN_NEW = 3
"""Minimum number of new drops between two diagnostics that is a problem. Chosen: starts and ends of
streams drop one or two."""


class DropWatch:
    """Finds the drops since the previous check."""

    def __init__(self) -> None:
        self._seen: Counter[str] = Counter()

    def problems(self, dropped: Counter[str]) -> list[str]:
        """Return one line for each reason with new drops."""
        new = {why: n for why, n in (dropped - self._seen).items() if why not in ORDINARY}
        self._seen = Counter(dropped)
        many = sorted(why for why, n in new.items() if n >= MIN_NEW)
        return [f"scans are dropped, {why}{_advice(why)}" for why in many]


def _advice(why: str) -> str:
    return f": {ADVICE[why]}" if why in ADVICE else ""
