"""Parameters of approach_node: the base, its speeds, and how it comes to surfaces."""

from __future__ import annotations

from tccm_ros.config.parameter import Group, param


class ApproachConfig(Group):
    """Driving to surfaces (approach_node)."""

    footprint: tuple[float, ...] = param(
        (0.25, 0.25, -0.25, 0.25, -0.25, -0.25, 0.25, -0.25),
        "corners of the base, x and y of each, a convex outline around its origin",
        unit="m",
    )
    height: float = param(
        1.3, "height of the robot; obstacles above it are ignored", unit="m", gt=0.0
    )
    reach: float = param(
        0.8, "max horizontal distance of a spot from the base's origin", unit="m", gt=0.0, le=3.0
    )
    gap: float = param(
        0.05, "distance between the footprint and the edge", unit="m", ge=0.02, le=1.0
    )
    staging_distance: float = param(0.4, "straight way up to the edge", unit="m", ge=0.1, le=2.0)
    margin: float = param(
        0.05, "distance to keep from all but the surface", unit="m", ge=0.01, le=0.5
    )
    speed: float = param(0.25, "top speed; half of it up to the edge", unit="m/s", gt=0.0, le=1.0)
    yaw_rate: float = param(0.6, "top rate of turning", unit="rad/s", gt=0.0, le=3.0)
    acceleration: float = param(
        0.3, "acceleration of the base; its deceleration is twice this", unit="m/s2", gt=0.0, le=2.0
    )
    yaw_acceleration: float = param(
        1.0, "as acceleration, of rotations", unit="rad/s2", gt=0.0, le=6.0
    )
    latency: float = param(
        0.1, "between a command and the motion that it makes", unit="s", ge=0.0, le=0.5
    )
    patience: float = param(
        8.0,
        "longest wait for something in the way and for a tilt cycle",
        unit="s",
        gt=0.0,
        le=120.0,
    )
    names: str = param(
        "tccm_map/named_poses.yaml", "file of named spots, read at each use (~/resolve_name)"
    )
    navigator: str = param(
        "navigate_to_pose",
        "action of Nav2's navigator, which drives long distances if it runs; empty: never",
        read_only=True,
    )
    stamped: bool = param(
        False, "send geometry_msgs/TwistStamped on cmd_vel, not Twist", read_only=True
    )
