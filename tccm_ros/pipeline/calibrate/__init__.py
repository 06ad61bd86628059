"""Calibrate the rig from what it sees, and check it while running."""

from tccm_ros.pipeline.calibrate.calibration import Calibration, calibrate
from tccm_ros.pipeline.calibrate.layout import Trust
from tccm_ros.pipeline.calibrate.rig_check import Finding, RigCheck

__all__ = ["Calibration", "Finding", "RigCheck", "Trust", "calibrate"]
