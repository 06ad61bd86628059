"""Description of the robot in a node's log line at its start."""

from __future__ import annotations

from collections.abc import Collection

from tccm_ros.robot import Robot


def found_on(robot: Robot, roles: Collection[str]) -> str:
    """Return a description of the known sensors and odometry.

    Parameters
    ----------
    robot
        The robot as known from its records.
    roles
        Roles of the sensors to describe.
    """
    parts = []
    for role in sorted(roles):
        mount = robot.sensors[role].mount
        if mount.base is not None:
            joint = f", joint '{mount.tilt_joint}'" if mount.tilt_joint else ""
            parts.append(f"{role} on base '{mount.base}'{joint}")
    source = robot.motion.source
    if source is not None:
        parts.append(f"odometry: {source.value} in '{robot.motion.odom_frame}'")
    return ", ".join(parts) or "nothing is known of the robot yet"
