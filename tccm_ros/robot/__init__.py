"""The intake: converts records to posed events, using frames, joints, odometry and the IMU."""

from tccm_ros.robot.chain_finder import MountKind
from tccm_ros.robot.robot import Robot
from tccm_ros.robot.streams import Stream

__all__ = ["MountKind", "Robot", "Stream"]
