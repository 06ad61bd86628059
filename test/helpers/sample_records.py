"""Sample records for tests of readers and writers."""

import numpy as np

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import Scan

STAMP = 1_700_000_000_123_456_789
T = pose_from_rpy([1.0, -2.0, 0.5, 0.1, -0.2, 3.0])


def make_scan(ranges):
    return Scan(STAMP, "laser", -1.5, 0.25, 0.0001, 0.05, 30.0, np.asarray(ranges, np.float32))
