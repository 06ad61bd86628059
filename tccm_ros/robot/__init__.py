"""Where the lasers are: robot description, tf or rig, joint samples, and the moving base."""

from tccm_ros.robot.laser import LaserKinematics, NotBracketed

__all__ = ["LaserKinematics", "NotBracketed"]
