"""What a node says of the robot in the line that tells that it is ready."""

from __future__ import annotations

from collections.abc import Collection

from tccm_ros.robot import Robot


def found_on(robot: Robot, roles: Collection[str]) -> str:
    """Return what is known of a robot, in words.

    Parameters
    ----------
    robot
        What records have told of it.
    roles
        Of the sensors that count.
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
