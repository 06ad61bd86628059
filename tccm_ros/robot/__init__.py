"""The one intake: from records to posed events, by all that is known of the robot."""

from tccm_ros.robot.chain_finder import MountKind
from tccm_ros.robot.robot import Robot
from tccm_ros.robot.streams import Stream

__all__ = ["MountKind", "Robot", "Stream"]
